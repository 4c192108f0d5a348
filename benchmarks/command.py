"""What ``vibroimpact bench`` does."""

from __future__ import annotations

import inspect
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
) -> None:
    """Run benchmarks, print their tables and, where wanted, keep them and draw the page."""
    for benchmark in benchmarks:
        tables: list[Table] = []
        for function in benchmark.functions():
            about = inspect.cleandoc(function.__doc__ or "")
            tables.append(replace(function(), about=about))
            say(text(tables[-1]) + "\n")
        if save:
            path = history.save(history.run_of(benchmark.name, tables))
            say(f"kept in {path}\n")
    if save:
        draw()


def draw() -> None:
    """Draw the page of the documentation from the results that were kept."""
    from benchmarks import report

    report.draw()
