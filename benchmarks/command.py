"""The command ``vibroimpact bench``: runs benchmarks, prints their tables and stores them."""

from __future__ import annotations

import inspect
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import replace

from benchmarks import registry
from benchmarks.harness import LONGEST, at_most
from benchmarks.registry import Part, named
from benchmarks.report import draw
from benchmarks.results import Measurement
from benchmarks.tables import Table
from benchmarks.writing import text

__all__ = ["draw", "listing", "named", "run"]

Say = Callable[[str], object]


def listing() -> str:
    """Return the names of the benchmarks and of their tables, and what they show."""
    lines = []
    for one in registry.BENCHMARKS:
        lines.append(f"{one.name}: {one.shows}")
        lines += [f"  {part.label}" for part in one.parts]
    return "\n".join(lines)


def run(parts: Sequence[Part], say: Say, *, save: bool, longest: float = LONGEST) -> int:
    """Measure tables, print them and, where wanted, store them and draw the pages.

    A table that fails or takes too long hinders no other. Returns how many failed.
    """
    failed = 0
    started = time.perf_counter()
    for number, part in enumerate(parts, 1):
        say(f"[{number}/{len(parts)}, {time.perf_counter() - started:.0f} s] {part.label} ...")
        outcome = _measured(part, say, longest)
        if isinstance(outcome, Table):
            say(f"{text(outcome)}\n{outcome.seconds:.0f} s\n")
        else:
            failed += 1
        if save:
            say(f"stored in {Measurement.now(part.benchmark, part.name, outcome).save()}\n")
    if save:
        draw()
    count, spent = len(parts), time.perf_counter() - started
    say(f"{count - failed} of {count} tables in {spent:.0f} s")
    return failed


def _measured(part: Part, say: Say, longest: float) -> Table | str:
    """Return the table that a function measured, or its error."""
    started = time.perf_counter()
    try:
        function = part.function()
        with at_most(longest):
            table = function()
    except Exception as error:
        say(f"failed\n{traceback.format_exc()}\n")
        return " ".join(f"{type(error).__name__}: {error}".split())[:500]
    return replace(
        table,
        about=inspect.cleandoc(function.__doc__ or ""),
        seconds=time.perf_counter() - started,
    )
