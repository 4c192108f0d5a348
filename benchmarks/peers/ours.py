"""Vibroimpact as the integrators it is compared with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.peers.scene import Outcome, Scene
from vibroimpact_solvers import time_history
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.time_history import Problem, Result, State


def problem(
    scene: Scene,
    tolerance: float | None = None,
    *,
    estimate: bool = True,
    times: Floats | None = None,
) -> Problem:
    """Return the problem of a scene: the impacts, and the state at the end, or at some times."""
    rigid = {"impacts", "contacts"} if scene.limiter is None else set()
    return Problem(
        scene.system,
        _state(scene),
        scene.t_end,
        t=np.array([scene.t_end]) if times is None else times,
        outputs=frozenset({"x", "v"} | rigid),
        tolerance=tolerance,
        load=scene.load,
        limiter=scene.limiter,
        estimate=estimate,
    )


def whole(scene: Scene, tolerance: float | None = None, *, times: Floats | None = None) -> Outcome:
    """Plan and solve, as the service does, with estimates of errors."""
    motion_problem = problem(scene, tolerance, times=times)
    return _outcome(time_history.solve(motion_problem, time_history.plan(motion_problem)))


def prepared(
    scene: Scene,
    tolerance: float | None = None,
    *,
    estimate: bool = False,
    times: Floats | None = None,
) -> Callable[[], Outcome]:
    """Return what solves a motion that was planned and prepared beforehand, as peers are.

    Parameters
    ----------
    scene : Scene
    tolerance : float, optional
    estimate : bool
        Whether errors are estimated, which no peer does.
    times : array, optional
        Output times; absent: the end.
    """
    motion_problem = problem(scene, tolerance, estimate=estimate, times=times)
    motion = time_history.prepare(motion_problem, time_history.plan(motion_problem))
    # The peers get their state anew each time; so does this.
    again = _state(scene)
    return lambda: _outcome(motion.solve(again))


def _state(scene: Scene) -> State:
    return State(scene.state[: scene.n].copy(), scene.state[scene.n :].copy())


def _outcome(result: Result) -> Outcome:
    assert result.x is not None
    assert result.v is not None
    times = [] if result.impact_time is None else result.impact_time.tolist()
    rests = result.contact_rest
    if rests is not None and rests.size:
        times += rests.tolist()
    return Outcome(tuple(times), np.concatenate((result.x[-1], result.v[-1])))
