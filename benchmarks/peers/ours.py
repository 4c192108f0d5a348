"""Vibroimpact as the integrators it is compared with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.peers.scene import Outcome, Scene
from vibroimpact_solvers import time_history
from vibroimpact_solvers.time_history import Problem, Result, State


def problem(scene: Scene, tolerance: float | None = None, *, estimate: bool = True) -> Problem:
    """Return the problem of a scene: the impacts, and the state at the end."""
    rigid = {"impacts", "contacts"} if scene.limiter is None else set()
    return Problem(
        scene.system,
        _state(scene),
        scene.t_end,
        t=np.array([scene.t_end]),
        outputs=frozenset({"x", "v"} | rigid),
        tolerance=tolerance,
        load=scene.load,
        limiter=scene.limiter,
        estimate=estimate,
    )


def whole(scene: Scene, tolerance: float | None = None) -> Outcome:
    """Plan and solve, as the service does, with estimates of errors."""
    motion_problem = problem(scene, tolerance)
    return _outcome(time_history.solve(motion_problem, time_history.plan(motion_problem)))


def prepared(
    scene: Scene, tolerance: float | None = None, *, estimate: bool = False
) -> Callable[[], Outcome]:
    """Return what solves a motion that was planned and prepared beforehand, as peers are.

    Parameters
    ----------
    scene : Scene
    tolerance : float, optional
    estimate : bool
        Whether errors are estimated, which no peer does.
    """
    motion_problem = problem(scene, tolerance, estimate=estimate)
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
    return Outcome(tuple(times), np.concatenate((result.x[0], result.v[0])))
