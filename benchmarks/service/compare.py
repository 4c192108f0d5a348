"""The services of two checkouts side by side: the same loads in turns, and the ratios."""

from __future__ import annotations

import itertools
import statistics
import tempfile
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from benchmarks.service import load
from benchmarks.service.load import Load
from benchmarks.service.requests import COMPUTE, Request, modes
from benchmarks.service.server import Server, seconds
from benchmarks.tables import Table

ROUNDS: Final = 5
SECONDS: Final = 2.0
"""How long a load lasts in each round."""
_CLIENTS: Final = {"1 client": 1, "32 clients": 32}
_JOBS: Final = "small jobs, 32 clients"
_AHEAD: Final = 10
"""Jobs that a client submits before it waits for them."""


def loads(stored: str) -> dict[str, Load]:
    """Return the loads by name, without the address of a service; `stored` is a result's path."""
    kinds = {
        "one frequency, uncached": Request.post(COMPUTE, modes()),
        "5,000 frequencies, uncached": Request.post(COMPUTE, modes(num=5000)),
        "one frequency, cached": Request.post(COMPUTE, modes(0.5)),
        "stored result by GET": Request("GET", stored),
    }
    answers = {
        f"{name}, {what}": Load("", (request,), count)
        for (name, request), (what, count) in itertools.product(kinds.items(), _CLIENTS.items())
    }
    jobs = Load("", (Request.job(modes()),), 32, jobs=_AHEAD)
    return {**answers, _JOBS: jobs}


class Side:
    """One of the two services, with its kernels loaded and one result stored."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._first = 1
        self._loads = loads(server.stored(modes(0.5)).headers["content-location"])
        self.measure(_JOBS, 1.0)

    def measure(self, name: str, length: float) -> tuple[float, float]:
        """Return answers per second, and milliseconds of the processor for each."""
        processes = self._server.processes()
        before = seconds(processes)
        part = replace(self._loads[name], url=self._server.url, seconds=length, first=self._first)
        outcome = load.run(part)
        self._first += outcome.sent
        used = seconds(processes) - before
        count = outcome.proper().answers
        return count / outcome.seconds, 1e3 * used / count


def rows(
    sides: tuple[Side, Side], names: list[str], rounds: int, length: float
) -> Iterator[tuple[Any, ...]]:
    """Yield a row for each load: rates of both, ratio, processor time of both, ratio."""
    for name in names:
        measured: tuple[list[tuple[float, float]], ...] = ([], [])
        for _ in range(rounds):
            for side, points in zip(sides, measured, strict=True):
                points.append(side.measure(name, length))
        rates, used = ([[point[i] for point in points] for points in measured] for i in (0, 1))
        yield (
            name,
            *map(statistics.median, rates),
            statistics.median(a / b for a, b in zip(*rates, strict=True)),
            *map(statistics.median, used),
            statistics.median(b / a for a, b in zip(*used, strict=True)),
        )


def against(
    checkout: Path,
    python: Path | None = None,
    only: str = "",
    rounds: int = ROUNDS,
    length: float = SECONDS,
) -> Table:
    """Compare this checkout's service with that of another checkout.

    Parameters
    ----------
    checkout, python : Path
        The other one, and its interpreter; without it that of its ``.venv``.
    only : str
        A part of the names of the loads that are meant.
    rounds, length
        How often each load is put on each service, and for how many seconds.
    """
    names = [name for name in loads("") if only in name]
    if not names:
        raise ValueError(f"no load is called {only}; there is: {'; '.join(loads(''))}")
    with tempfile.TemporaryDirectory() as folder:
        this, other = Path(folder) / "this", Path(folder) / "other"
        lines: list[tuple[Any, ...]] = []
        with closing(Server(this)) as ours, closing(Server(other, 1, checkout, python)) as theirs:
            for row in rows((Side(ours), Side(theirs)), names, rounds, length):
                print(f"[{len(lines) + 1}/{len(names)}] {row[0]}: {row[3]:.2f} times the answers")
                lines.append(row)
    return Table(
        "Service against another checkout",
        (
            "load",
            "this [1/s]",
            "other [1/s]",
            "this over other",
            "this, processor [ms]",
            "other, processor [ms]",
            "other over this",
        ),
        lines,
        f"Medians of {rounds} rounds of {length:g} s, in turns; ratios are medians of those of the "
        "rounds, above 1 where this checkout is faster. Processor: time of the whole service for "
        f"one answer. Other: {checkout}.",
    )
