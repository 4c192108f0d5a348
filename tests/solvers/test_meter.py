"""What a computation uses is counted: the memory of its events, the time of its helpers."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from vibroimpact_solvers import attractors, ensemble, meter
from vibroimpact_solvers.attractors import Force
from vibroimpact_solvers.errors import Cancelled
from vibroimpact_solvers.meter import Held, Helpers, processor_time
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Plan

ONE = SymmetricMatrix.diagonal([1.0])
RATTLING = System(
    ONE, SymmetricMatrix.diagonal([1e6]), (Constraint((0,), (1.0,), 0.001, 0.001, 1.0 - 1e-9),),
    C=SymmetricMatrix.diagonal([2e-3]),
)  # fmt: skip
ROWS = 2**17
"""Bytes of some 1600 impacts; each of the motions has as many."""


@pytest.fixture
def little(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Held, "most", ROWS)


@pytest.mark.usefixtures("little")
@pytest.mark.needs("compiled kernels")
def test_impacts_that_no_plan_knows_of_are_counted_as_they_grow() -> None:
    """A cheap plan of a motion that strikes a thousand times as often as its load turns."""
    x, v = np.zeros((8, 1)), np.linspace(5.0, 6.0, 8)[:, np.newaxis]
    load = (Force((0,), (1.0,), 1.0),)
    problem = attractors.Problem(
        RATTLING, np.array([10.0]), x, v, load, settle=1, observe=8, longest=1
    )
    with pytest.raises(MemoryError, match="its events take"):
        attractors.solve(problem, attractors.plan(problem))


@pytest.mark.usefixtures("little")
@pytest.mark.needs("compiled kernels")
def test_motions_of_an_ensemble_count_together() -> None:
    x, v = np.zeros((8, 1)), np.linspace(5.0, 6.0, 8)[:, np.newaxis]

    def of(motions: int) -> ensemble.Problem:
        return ensemble.Problem(RATTLING, x[:motions], v[:motions], t_end=0.3)

    one = of(1)
    assert ensemble.solve(one, ensemble.plan(one)).impact_time.size * 80 > 0.3 * ROWS
    for tick in (None, lambda done, total: None):
        with pytest.raises(MemoryError):
            ensemble.solve(of(8), ensemble.plan(of(8)), tick)


@pytest.mark.usefixtures("little")
def test_rows_are_held_until_they_are_released() -> None:
    held = list[int]()

    @meter.metered
    def inner(problem: int, plan: Plan, tick: object) -> None:
        meter.hold(problem)

    @meter.metered
    def outer(problem: int, plan: Plan, tick: object) -> None:
        with meter.released():
            inner(problem, plan)
            inner(problem, plan)
        inner(problem, plan)
        held.append(problem)

    nothing = Plan("kind", ())
    outer(ROWS // 2, nothing)
    assert held == [ROWS // 2]
    with pytest.raises(MemoryError):
        outer(ROWS // 2 + 1, nothing)
    meter.hold(10 * ROWS)  # outside of a computation nobody counts


def spin(seconds: float) -> None:
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        meter.look()


def test_processor_time_is_also_that_of_threads_that_help() -> None:
    began, own = processor_time(), time.thread_time()
    helpers = Helpers(lambda done, total: None)
    threads = [threading.Thread(target=helpers.run, args=(spin, 0.1)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    helpers.collect()
    spent, own = processor_time() - began, time.thread_time() - own
    assert spent - own >= 0.2
    helpers.collect()
    assert processor_time() - began - (time.thread_time() - own) < spent + 0.1


def test_loops_in_threads_that_help_look_at_their_signal() -> None:
    def stop(done: int, total: int) -> None:
        if stopped.is_set():
            raise Cancelled

    stopped, ended = threading.Event(), list[bool]()
    helpers = Helpers(stop)

    def work() -> None:
        with pytest.raises(Cancelled):
            helpers.run(spin, 60.0)
        ended.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    stopped.set()
    thread.join(30.0)
    assert ended == [True]


@pytest.mark.needs("compiled kernels")
def test_motions_in_threads_count_as_time_of_their_computation() -> None:
    """A limit of processor time is one of all threads, by which its caller waits."""
    count = 400
    x, v = np.zeros((count, 1)), np.linspace(1.0, 2.0, count)[:, np.newaxis]
    system = System(ONE, ONE, (Constraint((0,), (1.0,), 0.1, 0.1, 1.0),))
    problem = ensemble.Problem(system, x, v, t_end=500.0, outputs=frozenset({"impacts"}))
    own, both = time.thread_time(), processor_time()
    ensemble.solve(problem, ensemble.plan(problem))
    own, both = time.thread_time() - own, processor_time() - both
    assert both > 2.0 * own
