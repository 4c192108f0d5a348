"""The benchmarks there are: a table of modules.

To add one:

1. Write a module in this folder. Its functions take nothing and return a `tables.Table`;
   their docstrings say what is measured. `harness.measure` does the timing.
2. List the functions in the module's `TABLES`.
3. Add a line to `BENCHMARKS` below. The modules are imported only when they run, so that one
   whose peers are not installed hinders no other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from importlib import import_module
from types import FunctionType
from typing import Final


@dataclass(frozen=True, slots=True)
class Benchmark:
    """One benchmark: its name on the command line, its module and what it shows.

    Parameters
    ----------
    name, module, shows : str
    only : str
        The only function that is meant; all where it is empty.
    """

    name: str
    module: str
    shows: str
    only: str = ""

    def functions(self) -> tuple[FunctionType, ...]:
        """Return the functions of the module, each of which makes a table.

        Raises
        ------
        ImportError
            Where something that it needs is not installed.
        """
        found = import_module(self.module).TABLES
        return tuple(each for each in found if self.only in ("", each.__name__))


class UnknownNameError(ValueError):
    """Nothing is called that; the message names what comes near, or all there is."""

    def __init__(self, name: str, known: Iterable[str]) -> None:
        near = get_close_matches(name, list(known)) or list(known)
        super().__init__(f"No benchmark is called {name}. There is: {', '.join(near)}.")


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
        "run time against error, impacts missed: heyoka, scipy, CVODE, diffrax, Siconos",
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


def named(names: Sequence[str]) -> tuple[Benchmark, ...]:
    """Return the benchmarks of those names, all for none.

    Parameters
    ----------
    names : sequence of str
        Such as ``scaling``, or ``scaling.memory`` for one of its tables.

    Raises
    ------
    UnknownNameError
        Where there is no such benchmark or table.
    """
    return tuple(_one(name) for name in dict.fromkeys(names)) if names else BENCHMARKS


def _one(name: str) -> Benchmark:
    table = {one.name: one for one in BENCHMARKS}
    first, _, last = name.partition(".")
    if first not in table:
        raise UnknownNameError(name, table)
    if not last:
        return table[first]
    parts = [f"{first}.{function.__name__}" for function in table[first].functions()]
    if name not in parts:
        raise UnknownNameError(name, parts)
    return replace(table[first], only=last)
