"""Jobs through the queue: small ones alone, of many, in batches, beside a large one; and sweeps.

Service, workers and clients share the cores of one machine.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final

import numpy as np

from benchmarks.service import load
from benchmarks.service.answers import SHARED
from benchmarks.service.load import Load, Outcome
from benchmarks.service.requests import Request, modes
from benchmarks.service.server import Server, running, seconds
from benchmarks.tables import Figure, Table, figures
from vibroimpact_solvers import sweep, time_history
from vibroimpact_solvers.model import Constraint
from vibroimpact_solvers.presets import chain

_WORKERS: Final = 2
_MANY: Final = 32
_GAPS: Final = np.linspace(0.1, 0.3, 500)
_RESTITUTIONS: Final = np.linspace(0.8, 1.0, 20)
_END: Final = 62.0  # of histories of 21 impacts each, on average


def small_jobs() -> Table:
    """Submit durable jobs of a millisecond, alone, many at once, in batches and beside others."""
    with running(_WORKERS) as server:
        _tiny(server, 10_000)  # workers load their kernels
        alone, many = _tiny(server, 20_000), _tiny(server, 1_000_000, _MANY, 40)
        by_batches, behind = _by_batches(server), _behind_a_large_one(server)
    numbers = [
        Figure("tiny job, p50 [ms]", 1e3 * alone.p50, 8.0),
        Figure("tiny job, p99 [ms]", 1e3 * alone.p99, 20.0),
        Figure(f"tiny jobs of {_MANY} clients [1/s]", many.answers / many.seconds, 300.0, True),
        Figure("requests by batches [1/s]", by_batches, 3000.0, True),
        Figure("tiny job behind a bulk one, p50 [ms]", 1e3 * behind.p50, 15.0),
    ]
    return figures("Small jobs through the queue", numbers, "", {"": SHARED})


def _tiny(server: Server, first: int, clients: int = 1, ahead: int = 1) -> Outcome:
    """Submit tiny jobs over HTTP, each client so many ahead, and wait until they are done."""
    return load.run(Load(server.url, (Request.job(modes()),), clients, 2.0, first, ahead)).proper()


def _by_batches(server: Server, count: int = 6, size: int = 1000) -> float:
    """Return how many requests a second are answered by batches."""

    def batch(number: int) -> None:
        requests = [modes(0.8 + 1e-5 * (number * size + i)) for i in range(size)]
        content = {"kind": "impact-modes", "requests": requests}
        document = server.answered("POST", "/v1/batch", content).json()
        if len(document["answers"]) != size:
            raise RuntimeError(document)

    batch(0)
    started = time.perf_counter()
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(batch, range(1, count + 1)))
    return count * size / (time.perf_counter() - started)


def _behind_a_large_one(server: Server) -> Outcome:
    """Submit tiny jobs while a large one keeps all workers busy."""
    job = server.job(modes(0.6, 3_000_000, 300, ("impulse", "exists")))
    time.sleep(1.0)
    outcome = _tiny(server, 3_000_000)
    server.ask("DELETE", f"/v1/jobs/{job}")
    return outcome


def sweeps() -> Table:
    """Follow 10,000 histories of some 20 impacts, gap by restitution, as a job and in a loop."""
    with running(_WORKERS) as server:
        _swept(server, _GAPS[:20])  # workers load their kernels
        job, began = _spent(lambda: seconds(server.processes())), time.perf_counter()
        _swept(server, _GAPS)
        wall, by_job = time.perf_counter() - began, job()
    alone = _spent(time.process_time)
    _in_process()
    by_loop = alone()
    numbers = [
        Figure("as a job, on two cores [s]", wall, 6.0),
        Figure("as a job, processor time of all [s]", by_job),
        Figure("the same in a loop in a process, processor time [s]", by_loop),
        Figure("the queue takes more, part", by_job / by_loop - 1.0, 0.2),
    ]
    return figures("Ten thousand histories, gap by restitution", numbers, "", {"": SHARED})


def _spent(clock: Callable[[], float]) -> Callable[[], float]:
    """Return a function that tells how much a clock has gone on from now."""
    began = clock()
    return lambda: clock() - began


def _swept(server: Server, gaps: Any) -> None:
    """Compute a sweep as a job."""
    v = [1.0, *[0.0] * 12]
    constraint = {"dof": 5, "gap": 0.2, "restitution": 0.9}
    base = {
        "system": {"preset": "chain", "n": 13, "constraints": [constraint]},
        "initial": {"x": [0.0] * 13, "v": v},
        "t_end": _END,
    }
    axes = [
        {"path": "system.constraints.0.gap", "values": gaps.tolist()},
        {"path": "system.constraints.0.restitution", "values": _RESTITUTIONS.tolist()},
    ]
    request = {"kind": time_history.KIND, "base": base, "axes": axes}
    job = {"kind": sweep.KIND, "request": request}
    server.done(str(server.answered("POST", "/v1/jobs", job, 201).json()["id"]))


def _in_process() -> None:
    """Follow the same motions one after the other, all results kept."""
    v = np.zeros(13)
    v[0] = 1.0
    start, whole = time_history.State(np.zeros(13), v), chain(13, [])
    results = []
    for gap in _GAPS.tolist():
        for restitution in _RESTITUTIONS.tolist():
            system = whole.limited((Constraint.at(5, gap, restitution),))
            problem = time_history.Problem(system, start, _END)
            results.append(time_history.solve(problem, time_history.plan(problem)))
