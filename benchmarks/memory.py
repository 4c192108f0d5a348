"""The largest memory of one problem, each in a process of its own."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Final

from benchmarks.cases import chain, grid, random_structure, solve
from benchmarks.harness import Work
from benchmarks.tables import Plot, Table, Trend
from vibroimpact_schema.requests import TimeHistoryRequest
from vibroimpact_service.documents import digest, requests
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import chunks as job_chunks
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.model import System

_REQUEST, _RESULT = "1" * 64, "2" * 64
_MEBI: Final = 1024.0  # kibibytes
_DOFS: Final = 13
_FULL: Final = "N, full M and K"
_CHAIN: Final = "N, chain"
_FREQUENCIES: Final = "frequencies, N = 13"
_TIMES: Final = "times of a long motion, N = 13"


def memory() -> Table:
    """Measure the largest memory of one problem each, beside what the libraries take.

    Expected: no more than the matrices, which are quadratic in N; linear in the frequencies,
    which are the result; and nearly flat for long motions, which are stored window by window:
    ten times as many times take less than twice as much.
    """
    if not Path("/proc/self/status").exists():
        raise RuntimeError("the system does not tell the memory of a process")
    # A process serves for one problem: the largest memory of the next one would be hidden.
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as pool:
        rows = [(what, size, pool.submit(_grown, work).result()) for what, size, work in _works()]
    x, y, by = "size", "memory [MB]", "what grows"
    return Table(
        "Memory",
        (by, x, y),
        rows,
        "Chain with one constraint, the result included; beside that of libraries and kernels.",
        plots=(Plot(x, y, by=by),),
        trends=(
            Trend(x, y, 2.1, by, (_FULL,)),
            Trend(x, y, 1.1, by, (_CHAIN,)),
            Trend(x, y, 1.15, by, (_FREQUENCIES,)),
            Trend(x, y, 0.25, by, (_TIMES,)),
        ),
    )


def _works() -> Iterator[tuple[str, int, Work]]:
    """Yield what grows, how far, and the work."""
    for n in (300, 1000, 2000):
        yield _FULL, n, partial(_impact_modes, _full, n, 300)
    for n in (300, 1000, 3000):
        yield _CHAIN, n, partial(_impact_modes, chain, n, 300)
    for points in (10**5, 3 * 10**5, 10**6):
        yield _FREQUENCIES, points, partial(_impact_modes, chain, _DOFS, points)
    for times in (10**5, 3 * 10**5, 10**6):
        yield _TIMES, times, partial(_history, times)


def _grown(work: Work) -> float:
    """Return by how many mebibytes this process grows at most while it does some work."""
    _impact_modes(chain, _DOFS, 100)
    _history(1000)
    before = status("VmRSS")
    work()
    return status("VmHWM") - before


def status(field: str) -> float:
    """Return the mebibytes that the system says of this process: ``VmRSS``, at most ``VmHWM``."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(field)) / _MEBI


def _impact_modes(make: Callable[[int], System], n: int, points: int) -> None:
    """Solve for impact modes of a structure whose natural modes are not known yet."""
    spectrum.CACHE.clear()
    solve(make(n), grid(0.2, 3.0, points), frozenset({"impulse", "energy"}))


def _full(n: int) -> System:
    return random_structure(n, 1)


def _history(times: int) -> None:
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
