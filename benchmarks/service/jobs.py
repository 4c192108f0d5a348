"""Jobs through the queue: small ones alone, of many, in batches, beside a large one; and sweeps.

Service, workers and clients share the cores of one machine.
"""

from __future__ import annotations

import itertools
import multiprocessing
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from typing import Any, Final

import numpy as np

from benchmarks.periodic_motions import driven_beam
from benchmarks.service import load
from benchmarks.service.answers import SHARED
from benchmarks.service.load import Load, Outcome
from benchmarks.service.requests import Request, modes
from benchmarks.service.server import Server, running, seconds
from benchmarks.tables import Figure, Table, figures
from vibroimpact_solvers import periodic_motions, sweep, time_history
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import Constraint
from vibroimpact_solvers.presets import chain

_WORKERS: Final = 2
_MANY: Final = 32
_GAPS: Final = np.linspace(0.1, 0.3, 500)
_RESTITUTIONS: Final = np.linspace(0.8, 1.0, 20)
_END: Final = 62.0  # of histories of 21 impacts each, on average
_STOP: Final = {"dof": 5, "gap": 0.2, "restitution": 0.9}
_LOOPS: Final = "The loops keep all results in memory; the job stores them and joins them."


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
    """Follow 10,000 histories of some 20 impacts, gap by restitution, as a job and in loops."""
    base = {
        "system": {"preset": "chain", "n": 13, "constraints": [dict(_STOP)]},
        "initial": {"x": [0.0] * 13, "v": [1.0, *[0.0] * 12]},
        "t_end": _END,
    }
    numbers = _as_a_job(time_history.KIND, base, _GAPS, _follow, 6.0)
    return figures("Ten thousand histories, gap by restitution", numbers, _LOOPS, {"": SHARED})


def beams_in_a_sweep() -> Table:
    """Find the driven motions of 2,000 beams of 50 degrees of freedom, as a job and in loops."""
    problem = driven_beam(25)
    system, force = problem.system, problem.load[0]
    C = system.C
    assert C is not None
    matrices = {"M": system.M, "K": system.K, "C": C}
    base = {
        "system": {name: matrix.to_dense().tolist() for name, matrix in matrices.items()}
        | {"constraints": [{**_STOP, "dof": force.dofs[0]}]},
        "frequency": {"values": [float(problem.Omega[20])]},
        "load": [{"dof": force.dofs[0], "amplitude": force.amplitude}],
    }
    gaps = np.linspace(0.005, 0.02, 100)
    numbers = _as_a_job(periodic_motions.KIND, base, gaps, _drive, None)
    return figures("Two thousand driven beams, gap by restitution", numbers, _LOOPS, {"": SHARED})


Loop = Callable[[list[float]], float]


def _as_a_job(
    kind: str, base: dict[str, Any], gaps: Floats, loop: Loop, goal: float | None
) -> list[Figure]:
    """Return what a sweep takes as a job, and what its motions take one after the other.

    The loops run in as many processes as the service has workers, as processor time depends on
    what the other cores do.
    """
    axes = [
        {"path": "system.constraints.0.gap", "values": gaps.tolist()},
        {"path": "system.constraints.0.restitution", "values": _RESTITUTIONS.tolist()},
    ]
    with running(_WORKERS) as server:
        few = {"path": axes[0]["path"], "values": (0.999 * gaps[:20]).tolist()}
        _swept(server, {"kind": kind, "base": base, "axes": [few, axes[1]]})  # kernels are loaded
        job, began = _spent(lambda: seconds(server.processes())), time.perf_counter()
        before = _on_disk(server)
        _swept(server, {"kind": kind, "base": base, "axes": axes})
        wall, by_job, size = time.perf_counter() - began, job(), _on_disk(server) - before
    spawned = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(_WORKERS, spawned) as pool:
        list(pool.map(loop, [gaps[:2].tolist()] * _WORKERS))
        by_loop = sum(pool.map(loop, [gaps[k::_WORKERS].tolist() for k in range(_WORKERS)]))
    count = gaps.size * _RESTITUTIONS.size
    return [
        Figure("as a job, on two cores [s]", wall, goal),
        Figure("variants [1/s]", count / wall),
        Figure("chunks and result on disk [MB]", size / 1e6),
        Figure("as a job, processor time of all processes [s]", by_job),
        Figure("in loops in two processes, processor time [s]", by_loop),
        Figure("the queue takes more, part", by_job / by_loop - 1.0, 0.2),
    ]


def _spent(clock: Callable[[], float]) -> Callable[[], float]:
    """Return a function that tells how much a clock has gone on from now."""
    began = clock()
    return lambda: clock() - began


def _swept(server: Server, request: dict[str, Any]) -> None:
    """Compute a sweep as a job."""
    job = {"kind": sweep.KIND, "request": request}
    server.done(str(server.answered("POST", "/v1/jobs", job, 201).json()["id"]))


def _on_disk(server: Server) -> int:
    """Return the bytes of all files of a service."""
    return sum(path.stat().st_size for path in server.data.rglob("*") if path.is_file())


def _follow(gaps: list[float]) -> float:
    """Follow the histories of some gaps one after the other; return the processor time."""
    v = np.zeros(13)
    v[0] = 1.0
    start, whole = time_history.State(np.zeros(13), v), chain(13, [])
    results, spent = [], _spent(time.process_time)
    for gap, restitution in itertools.product(gaps, _RESTITUTIONS.tolist()):
        system = whole.limited((Constraint.at(5, gap, restitution),))
        problem = time_history.Problem(system, start, _END)
        results.append(time_history.solve(problem, time_history.plan(problem)))
    return spent()


def _drive(gaps: list[float]) -> float:
    """Find the driven motions of beams with some gaps; return the processor time."""
    first = driven_beam(25)
    first, dof = first.at(first.Omega[20:21]), first.load[0].dofs[0]
    results, spent = [], _spent(time.process_time)
    for gap, restitution in itertools.product(gaps, _RESTITUTIONS.tolist()):
        stops = (Constraint.at(dof, gap, restitution),)
        problem = replace(first, system=first.system.limited(stops))
        results.append(periodic_motions.solve(problem, periodic_motions.plan(problem)))
    return spent()
