"""Ends that motions never reach are refused when they are planned; all others are planned."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from vibroimpact_solvers import attractors, ensemble, presets, time_history
from vibroimpact_solvers.errors import ModelError, PlanError
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.time_history import Harmonic, Power, Problem, State

START = State(np.zeros(3), np.array([1.0, 0.0, 0.0]))
CHAIN = presets.chain(3, [Constraint.at(1, 0.2)])
LOSSY = presets.chain(3, [Constraint.at(1, 0.2, 0.8)])
SPRUNG = presets.chain(3, [Constraint((1,), (1.0,), 0.2, 0.2, law=Linear(5.0))])
DAMPED = System(CHAIN.M, CHAIN.K, LOSSY.constraints, C=SymmetricMatrix.diagonal([0.01] * 3))
LOAD = (Harmonic(0, 0.1, 1e-16, 0.0),)
FAR: dict[str, tuple[System, dict[str, Any]]] = {
    "rigid stops": (CHAIN, {}),
    "impacts with losses, which not all modes feel": (LOSSY, {}),
    "linear stops": (SPRUNG, {}),
    "soft limiters": (CHAIN, {"limiter": Power(3.0, 1.0)}),
    "an integrator": (CHAIN, {"method": "RK45"}),
    "many digits": (CHAIN, {"digits": 40}),
    "a load and damping": (DAMPED, {"load": LOAD}),
}


@pytest.mark.parametrize("name", FAR)
@pytest.mark.parametrize("t_end", [1e30, 1e100])
def test_an_end_that_is_never_reached_is_refused(name: str, t_end: float) -> None:
    system, more = FAR[name]
    load = tuple(replace(term, frequency=5.0 / t_end) for term in more.get("load", ()))
    problem = Problem(system, START, t_end, **{**more, "load": load})
    with pytest.raises(PlanError, match="years to compute: ask for less time") as caught:
        time_history.plan(problem)
    assert caught.value.pointer == ("t_end",)
    assert repr(t_end) in caught.value.message
    assert time_history.plan(replace(problem, t_end=100.0, t=None)).seconds < 10.0


@pytest.mark.parametrize("t_end", [1e300, 1e101, 1e-101, 5e-324, 0.0, np.inf, np.nan])
def test_an_end_out_of_range_is_refused(t_end: float) -> None:
    with pytest.raises(ModelError) as caught:
        Problem(CHAIN, START, t_end)
    assert caught.value.pointer == ("t_end",)


@pytest.mark.parametrize(
    ("system", "speed", "t_end"),
    [
        (presets.chain(3, []), 1.0, 1e100),  # nothing is struck: one sum, whatever the time is
        (presets.chain(3, [Constraint.at(1, 5.0)]), 1.0, 1e100),  # nor where no wall is reached
        (DAMPED, 1.0, 1e30),  # it comes to rest
        (presets.oscillator([Constraint.at(0, 0.2, 0.9)], 1.0), 1.0, 1e30),  # also by its impacts
        (presets.oscillator([Constraint.at(0, 0.2)], 1e-29), 1e-30, 1e30),  # a few periods
        (CHAIN, 1.0, 1e-100),
    ],
)
def test_other_ends_are_planned(system: System, speed: float, t_end: float) -> None:
    v = np.zeros(system.n)
    v[0] = speed
    assert time_history.plan(Problem(system, State(np.zeros(system.n), v), t_end)).steps


def test_an_end_that_nothing_bounds_takes_no_longer_than_another() -> None:
    """No wall is reached: the motion until any time is one sum of the modes."""
    free = presets.chain(3, [Constraint.at(1, 5.0)])
    near, far = (
        time_history.solve(problem, time_history.plan(problem))
        for problem in (Problem(free, START, t_end) for t_end in (1.0, 1e30))
    )
    assert near.count_expansions == far.count_expansions == 1


def test_ensembles_are_refused_by_their_end() -> None:
    x, v = np.zeros((2, 3)), np.array([[1.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    with pytest.raises(PlanError, match="years") as caught:
        ensemble.plan(ensemble.Problem(CHAIN, x, v, 1e30))
    assert caught.value.pointer == ("t_end",)


def test_attractors_are_refused_by_the_frequency_of_their_periods() -> None:
    load, still = (attractors.Force((0,), (1.0,), 1.0),), np.zeros((1, 3))
    problem = attractors.Problem(DAMPED, np.array([1e-30]), still, still + 0.1, load)
    with pytest.raises(PlanError, match="periods of the drive are too long: the motion") as caught:
        attractors.plan(problem)
    assert caught.value.pointer == ("frequency",)
    assert attractors.plan(replace(problem, Omega=np.array([0.5]))).steps
