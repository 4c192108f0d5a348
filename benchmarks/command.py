"""What ``vibroimpact bench`` does."""

from __future__ import annotations

import inspect
import time
import traceback
from collections.abc import Callable, Iterable
from dataclasses import replace

from benchmarks import history, registry
from benchmarks.tables import Table, text


def listing() -> str:
    """Return the names of the benchmarks and what they show."""
    width = max(len(one.name) for one in registry.BENCHMARKS)
    return "\n".join(f"{one.name:{width}}  {one.shows}" for one in registry.BENCHMARKS)


def chosen(names: list[str]) -> tuple[registry.Benchmark, ...]:
    """Return the benchmarks of those names, all for none."""
    return registry.named(names)


def run(
    benchmarks: Iterable[registry.Benchmark], say: Callable[[str], object], *, save: bool
) -> int:
    """Run benchmarks, print their tables and, where wanted, keep them and draw the page.

    One that fails hinders no other. Returns how many failed.
    """
    failed = 0
    for benchmark in benchmarks:
        tables: list[Table] = []
        for function in benchmark.functions():
            about = inspect.cleandoc(function.__doc__ or "")
            started = time.perf_counter()
            try:
                tables.append(replace(function(), about=about))
            except Exception:
                failed += 1
                name = getattr(function, "__name__", "")
                say(f"{benchmark.name}: {name} failed\n{traceback.format_exc()}\n")
                continue
            say(text(tables[-1]))
            say(f"{time.perf_counter() - started:.0f} s\n")
        if save and tables:
            path = history.save(history.run_of(benchmark.name, tables))
            say(f"kept in {path}\n")
    if save:
        draw()
    return failed


def draw() -> None:
    """Draw the page of the documentation from the results that were kept."""
    from benchmarks import report

    report.draw()
