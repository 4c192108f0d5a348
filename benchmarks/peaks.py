"""The largest memory of one problem: a process that has loaded all forks a child for each."""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

from benchmarks.cases import chain, grid, random_structure, solve
from vibroimpact_schema.requests import TimeHistoryRequest
from vibroimpact_service import chunks as job_chunks
from vibroimpact_service.documents import digest, requests
from vibroimpact_service.store import Store
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.model import System

_REQUEST, _RESULT = "1" * 64, "2" * 64
_MEBI: Final = 1024.0  # kibibytes
_DOFS: Final = 13
FULL: Final = "N, full M and K"
CHAIN: Final = "N, chain"
FREQUENCIES: Final = "frequencies, N = 13"
TIMES: Final = "times of a long motion, N = 13"


def impact_modes(make: Callable[[int], System], n: int, points: int) -> None:
    """Solve for impact modes of a structure whose natural modes are not known yet."""
    spectrum.CACHE.clear()
    solve(make(n), grid(0.2, 3.0, points), frozenset({"impulse", "energy"}))


def _full(n: int) -> System:
    return random_structure(n, 1)


def history(times: int) -> None:
    """Follow a motion as a job does, window by window, into a store; 13 masses at many times."""
    content = {
        "system": {"preset": "chain", "n": _DOFS, "constraints": [{"dof": 5, "gap": 0.2}]},
        "initial": {"x": [0.0] * _DOFS, "v": [0.2] * _DOFS},
        "t_end": 100.0,
        "t": {"num": times},
        "outputs": ["x", "v"],
    }
    request = TimeHistoryRequest.model_validate(content)
    with tempfile.TemporaryDirectory() as folder:
        store = Store(folder)
        block = requests.stored_form("local", digest.canonical(request))
        store.requests.put(_REQUEST, block)
        job = (store.url, "time-history", _REQUEST, _RESULT)
        chunks = job_chunks.split(*job)
        job_chunks.solve(*job, range(len(chunks)))
        job_chunks.join(*job, chunks)


def cases() -> list[tuple[str, int, Callable[[], None]]]:
    """Return what grows, how far, and the work."""
    problems: list[tuple[str, int, Callable[[], None]]] = []
    for n in (300, 1000, 2000):
        problems.append((FULL, n, partial(impact_modes, _full, n, 300)))
    for n in (300, 1000, 3000):
        problems.append((CHAIN, n, partial(impact_modes, chain, n, 300)))
    for points in (10**5, 3 * 10**5, 10**6):
        problems.append((FREQUENCIES, points, partial(impact_modes, chain, 13, points)))
    for times in (10**5, 3 * 10**5, 10**6):
        problems.append((TIMES, times, partial(history, times)))
    return problems


def peak(work: Callable[[], None]) -> float:
    """Return by how many mebibytes a forked child grows at most while it does some work."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            before = _status("VmRSS")
            work()
            os.write(writing, f"{_status('VmHWM') - before}".encode())
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as pipe:
        said = pipe.read()
    os.waitpid(child, 0)
    return float(said)


def _status(field: str) -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(field)) / _MEBI


def main() -> None:
    """Print memory before all problems, and of each."""
    impact_modes(chain, _DOFS, 100)
    history(1000)
    rows: list[Any] = [[what, size, peak(work)] for what, size, work in cases()]
    json.dump({"before": _status("VmRSS"), "rows": rows}, sys.stdout)


if __name__ == "__main__":
    main()
