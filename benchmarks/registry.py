"""The benchmarks there are: a table of modules.

To add one:

1. Write a module in this folder. Its functions take nothing and return a `tables.Table`;
   their docstrings say what is measured. `harness.measure` does the timing.
2. List the functions in the module's `TABLES`.
3. Add a line to `BENCHMARKS` below. The modules are imported only when they run, so that one
   whose peers are not installed hinders no other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Final

from benchmarks.tables import Table


@dataclass(frozen=True, slots=True)
class Benchmark:
    """One benchmark: its name on the command line, its module and what it shows."""

    name: str
    module: str
    shows: str

    def functions(self) -> Iterator[Callable[[], Table]]:
        """Yield the functions of the module."""
        yield from import_module(self.module).TABLES


BENCHMARKS: Final[tuple[Benchmark, ...]] = (
    Benchmark(
        "impact-modes",
        "benchmarks.impact_modes",
        "time of one impulse, against numpy, large structures, run time against error",
    ),
    Benchmark(
        "existence-bands",
        "benchmarks.existence_bands",
        "certified bands against scans, and the bands that scans miss",
    ),
    Benchmark(
        "slow-flows",
        "benchmarks.slow_flows",
        "closed forms at a million times, run time against error of every variant",
    ),
    Benchmark(
        "time-histories",
        "benchmarks.time_histories",
        "run time against error and impacts missed, against heyoka, scipy, CVODE, diffrax",
    ),
    Benchmark("skips", "benchmarks.skips", "what plans leave out: counters and the time saved"),
    Benchmark(
        "scaling",
        "benchmarks.scaling",
        "cost against size, frequencies and threads; cold starts",
    ),
    Benchmark("floors", "benchmarks.floors", "hot kernels over what the hardware allows"),
    Benchmark(
        "service",
        "benchmarks.service",
        "start and memory of the service, latency and throughput against clients, workers",
    ),
    Benchmark("http", "benchmarks.http_load", "answers a second, 200 clients, large results"),
    Benchmark("jobs", "benchmarks.job_queue", "small jobs, chunks, fairness, listing, idling"),
    Benchmark(
        "scheduler", "benchmarks.scheduler", "ten million chunks on a thousand workers, simulated"
    ),
    Benchmark("guard", "benchmarks.guard", "hot kernels over reference loops"),
)


def named(names: list[str]) -> tuple[Benchmark, ...]:
    """Return the benchmarks of those names, all for none.

    Raises
    ------
    KeyError
        With the first name that is not one.
    """
    table = {one.name: one for one in BENCHMARKS}
    return tuple(table[name] for name in names) if names else BENCHMARKS
