"""What ``vibroimpact bench`` does."""

from __future__ import annotations

import inspect
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import FunctionType

from benchmarks import history, registry
from benchmarks.history import Failure
from benchmarks.limits import LONGEST, at_most
from benchmarks.tables import Table
from benchmarks.writing import text

Say = Callable[[str], object]


def listing() -> str:
    """Return the names of the benchmarks and what they show."""
    width = max(len(one.name) for one in registry.BENCHMARKS)
    return "\n".join(f"{one.name:{width}}  {one.shows}" for one in registry.BENCHMARKS)


def chosen(names: Sequence[str], *, save: bool = False) -> tuple[registry.Benchmark, ...]:
    """Return the benchmarks of those names, all for none.

    Raises
    ------
    ValueError
        Where one is unknown, or where a table alone should be kept.
    """
    found = registry.named(names)
    for one in found:
        if one.only and save:
            raise ValueError(
                f"Benchmarks are kept whole: --save goes with {one.name}, not {one.name}.{one.only}"
            )
    return found


def run(
    benchmarks: Sequence[registry.Benchmark], say: Say, *, save: bool, longest: float = LONGEST
) -> int:
    """Run benchmarks, print their tables and, where wanted, keep them and draw the page.

    One that fails or takes too long hinders no other. Returns how many tables failed.
    """
    failed = 0
    started = time.perf_counter()
    parts = [(one, *_parts(one)) for one in benchmarks]
    count = sum(max(1, len(functions)) for _, functions, _ in parts)
    done = 0
    for benchmark, functions, broken in parts:
        tables: list[Table] = []
        failures = list(broken)
        for failure in broken:
            done += 1
            say(f"{benchmark.name} failed: {failure.error}\n")
        for function in functions:
            done += 1
            spent = time.perf_counter() - started
            say(f"[{done}/{count}, {spent:.0f} s] {benchmark.name}.{function.__name__} ...")
            found = _table(function, say, longest)
            if isinstance(found, Table):
                tables.append(found)
                say(f"{text(found)}\n{found.seconds:.0f} s\n")
            else:
                failures.append(found)
        failed += len(failures)
        if save:
            path = history.save(history.run_of(benchmark.name, tables, failures))
            say(f"kept in {path}\n")
    if save:
        draw()
    say(f"{count - failed} of {count} tables in {time.perf_counter() - started:.0f} s")
    return failed


def _parts(
    benchmark: registry.Benchmark,
) -> tuple[tuple[FunctionType, ...], tuple[Failure, ...]]:
    try:
        return benchmark.functions(), ()
    except Exception as error:
        return (), (Failure("", f"{type(error).__name__}: {error}"),)


def _table(function: FunctionType, say: Say, longest: float) -> Table | Failure:
    """Return what a function measured, or how it failed."""
    started = time.perf_counter()
    try:
        with at_most(longest):
            table: Table = function()
    except Exception as error:
        say(f"failed\n{traceback.format_exc()}\n")
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        return Failure(function.__name__, reason[:500])
    return replace(
        table,
        about=inspect.cleandoc(function.__doc__ or ""),
        part=function.__name__,
        seconds=time.perf_counter() - started,
    )


def draw() -> None:
    """Draw the page of the documentation from the results that were kept."""
    from benchmarks import report

    report.draw()
