"""How times are measured: warmed up, in turns, as medians, with a limit, on a described machine.

Functions that are compared take turns in one run, so that whatever else the machine does
hits all of them; a ratio is the median over the rounds of the ratio in each round. Beside the
time on the clock stands that of the processor, which neighbours on a shared machine
lengthen less.
"""

from __future__ import annotations

import gc
import math
import os
import platform
import signal
import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import FrameType
from typing import Any

from vibroimpact_solvers.kernels.threads import cores

Work = Callable[[], object]

SAMPLE = 0.02
"""Seconds that a sample should take at least: quick functions are repeated inside it."""
LONGEST = 240.0
"""Seconds that one table may take."""


@dataclass(frozen=True, slots=True)
class Timing:
    """Seconds of one call.

    Parameters
    ----------
    wall, processor : float
        Medians over the rounds.
    rounds : tuple of float
        Time of the processor in each round.
    """

    wall: float
    processor: float
    rounds: tuple[float, ...]


def measure(rounds: int = 7, sample: float = SAMPLE, **functions: Work) -> dict[str, Timing]:
    """Time functions in turns.

    Parameters
    ----------
    rounds : int
        How often each has its turn.
    sample : float
        Seconds of one turn, at least.
    functions
        What is timed, by name; each is called once before, which compiles and fills caches.
    """
    repeats = {name: _repeats(function, sample) for name, function in functions.items()}
    wall: dict[str, list[float]] = {name: [] for name in functions}
    processor: dict[str, list[float]] = {name: [] for name in functions}
    collects = gc.isenabled()
    gc.disable()
    try:
        for _ in range(rounds):
            for name, function in functions.items():
                clock, used = time.perf_counter(), time.process_time()
                for _ in range(repeats[name]):
                    function()
                processor[name].append((time.process_time() - used) / repeats[name])
                wall[name].append((time.perf_counter() - clock) / repeats[name])
    finally:
        if collects:
            gc.enable()
    return {
        name: Timing(
            statistics.median(wall[name]),
            statistics.median(processor[name]),
            tuple(processor[name]),
        )
        for name in functions
    }


def _repeats(function: Work, sample: float) -> int:
    function()
    start = time.perf_counter()
    function()
    once = time.perf_counter() - start
    return max(1, math.ceil(sample / max(once, 1e-7)))


def ratio(slow: Timing, fast: Timing) -> float:
    """Return how many times faster the second is: the median of the ratios in each round."""
    return statistics.median(a / b for a, b in zip(slow.rounds, fast.rounds, strict=True))


def machine() -> dict[str, Any]:
    """Describe the machine and what is installed on it."""
    path = Path("/proc/cpuinfo")
    text = path.read_text().split("\n\n", 1)[0] if path.exists() else ""
    pairs = (line.partition(":") for line in text.splitlines())
    facts = {name.strip(): value.strip() for name, _, value in pairs}
    name, megahertz = facts.get("model name", platform.processor()), facts.get("cpu MHz", "")
    family = f"family {facts.get('cpu family')} model {facts.get('model')}"
    flags = facts.get("flags", "").split()
    return {
        "processor": f"{name}, {family}, {megahertz} MHz",
        "cores": cores(),
        "vectors": next((v for v in ("avx512f", "avx2", "sse2") if v in flags), "unknown"),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "packages": versions("vibroimpact", "numpy", "scipy", "numba", "llvmlite"),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
    }


def versions(*packages: str) -> Mapping[str, str]:
    """Return the versions of the packages that are installed."""
    there = {}
    for package in packages:
        with suppress(PackageNotFoundError):
            there[package] = version(package)
    return there


class TooLongError(Exception):
    """A part took longer than it may."""


@contextmanager
def at_most(seconds: float = LONGEST) -> Iterator[None]:
    """Raise `TooLongError` in the block after that time, and again until it ends.

    The services that it started are stopped on the way out, as they are when the process is
    asked to terminate. Where there are no such signals nothing is limited.
    """
    if not hasattr(signal, "SIGALRM"):
        yield
        return

    def late(number: int, frame: FrameType | None) -> None:
        raise TooLongError(f"not done after {seconds:g} s")

    def terminate(number: int, frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    alarm = signal.signal(signal.SIGALRM, late)
    end = signal.signal(signal.SIGTERM, terminate)
    # What hangs while it cleans up is woken again.
    signal.setitimer(signal.ITIMER_REAL, seconds, max(1.0, 0.5 * seconds))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, alarm)
        signal.signal(signal.SIGTERM, end)
