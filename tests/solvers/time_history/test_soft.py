"""Soft limiters and the integrators that are there to compare with."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from vibroimpact_solvers import presets
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.errors import ConvergenceError, ModelError
from vibroimpact_solvers.model import Constraint

ALL = frozenset(th.OUTPUTS)
HISTORY = frozenset({"x", "v", "energy"})


def solve(problem: th.Problem) -> th.Result:
    return th.solve(problem, th.plan(problem))


def test_period_of_a_soft_oscillator_against_quadrature() -> None:
    """x'' + x + b (x/s)^17 = 0 from rest: the period is a quadrature of the energy integral."""
    law = th.Power(17.0, 0.8, 0.97)
    gap, turn = 0.5, 0.52
    size = 0.97 * gap
    mp.mp.dps = 30

    def energy(x: mp.mpf) -> mp.mpf:
        return x**2 / 2 + mp.mpf("0.8") * size * (x / size) ** 18 / 18

    top = energy(mp.mpf(turn))
    # x = turn sin(a) takes the singularity at the turn away.
    quarter = mp.quad(
        lambda a: turn * mp.cos(a) / mp.sqrt(2 * (top - energy(turn * mp.sin(a)))),
        [0, mp.pi / 4, mp.pi / 2 - mp.mpf(10) ** -12],
    )
    period = float(4 * quarter)
    problem = th.Problem(
        presets.oscillator([Constraint.at(0, gap)], 1.0),
        th.State(np.array([turn]), np.zeros(1)),
        5.0 * period,
        t=period * np.array([0.0, 0.25, 0.5, 1.0, 5.0]),
        outputs=ALL,
        limiter=law,
        tolerance=1e-11,
    )
    result = solve(problem)
    assert result.x is not None
    np.testing.assert_allclose(result.x[:, 0], [turn, 0, -turn, turn, turn], rtol=0, atol=2e-10)
    assert result.error_energy_drift is not None
    assert result.error_energy_drift < 1e-11
    assert result.error_difference is not None
    assert result.error_difference < 32e-11
    assert result.count_impacts == 0
    np.testing.assert_allclose(result.error_penetration, turn / size, rtol=1e-3)


def test_soft_limiters_of_a_damped_driven_chain_against_an_integrator() -> None:
    system = presets.chain(5, [Constraint.at(1, 0.2), Constraint((3,), (1.0,), 0.3, None)])
    v = np.array([0.4, 0.9, -0.3, 0.5, 0.1])
    common = {
        "system": system,
        "initial": th.State(np.zeros(5), v),
        "t_end": 30.0,
        "t": np.linspace(0.0, 30.0, 16),
        "outputs": HISTORY,
        "load": (th.Harmonic(0, 0.3, 0.8, 0.1),),
        "limiter": th.Power(7.0, 2.0, 1.0),
    }
    ours = solve(th.Problem(**common, tolerance=1e-11))  # type: ignore[arg-type]
    theirs = solve(th.Problem(**common, tolerance=1e-12, method="DOP853"))  # type: ignore[arg-type]
    assert ours.x is not None
    assert theirs.x is not None
    assert ours.v is not None
    np.testing.assert_allclose(ours.x, theirs.x, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(ours.v, theirs.v, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(ours.energy, theirs.energy, rtol=0.0, atol=1e-8)
    assert ours.error_energy_drift is None


def test_the_integrator_and_the_exact_flight_agree_where_nothing_is_missed() -> None:
    system = presets.two_mass([Constraint.at(0, 0.5, 0.9)], 1.0, 0.4, 0.02)
    common = {
        "system": system,
        "initial": th.State(np.array([0.1, 0.0]), np.array([1.5, -0.4])),
        "t_end": 12.0,
        "t": np.linspace(0.0, 12.0, 13),
        "outputs": ALL,
    }
    ours = solve(th.Problem(**common))  # type: ignore[arg-type]
    theirs = solve(th.Problem(**common, method="DOP853", tolerance=1e-12))  # type: ignore[arg-type]
    assert ours.count_impacts == theirs.count_impacts > 3
    np.testing.assert_allclose(ours.x, theirs.x, rtol=0.0, atol=1e-8)  # type: ignore[arg-type]
    np.testing.assert_allclose(ours.impact_time, theirs.impact_time, rtol=1e-9)  # type: ignore[arg-type]
    np.testing.assert_allclose(ours.impact_impulse, theirs.impact_impulse, rtol=1e-8)  # type: ignore[arg-type]
    assert "miss" in theirs.error_statement


@pytest.mark.parametrize(
    ("limiter", "gap", "field"),
    [
        (th.Power(0.5, 1.0), 0.2, ("limiter", "exponent")),
        (th.Power(17.0, 0.0), 0.2, ("limiter", "stiffness")),
        (th.Power(17.0, 1.0, math.nan), 0.2, ("limiter", "scale")),
        (th.Power(17.0, 1.0), -0.2, ("system", "constraints", 0, "gap")),
    ],
)
def test_faults_of_soft_limiters(
    limiter: th.Power, gap: float, field: tuple[str | int, ...]
) -> None:
    system = presets.oscillator([Constraint((0,), (1.0,), 0.5, gap)], 1.0)
    with pytest.raises(ModelError) as caught:
        th.Problem(system, th.State(np.zeros(1), np.ones(1)), 1.0, limiter=limiter)
    assert caught.value.pointer == field


def test_plans_say_what_is_left_out() -> None:
    system = presets.chain(3, [Constraint.at(0, 0.1), Constraint.at(2, 5.0)])
    problem = th.Problem(system, th.State(np.zeros(3), np.array([0.3, 0.0, 0.0])), 5.0)
    plan = th.plan(problem)
    what = {skip.what for skip in plan.skips}
    assert {"constraint 1", "x", "v", "energy", "contacts"} <= what
    assert "constraint 0" not in what
    result = solve(problem)
    assert result.x is None
    assert result.contact_start is None
    assert result.impact_constraint is not None
    assert set(result.impact_constraint.tolist()) == {0}


@pytest.mark.parametrize("x", [1e12, 1e50])
def test_limiters_that_are_too_stiff_to_be_followed_are_refused(x: float) -> None:
    system = presets.oscillator([Constraint((0,), (1.0,), 1.0, 1.0)], 1.0)
    law = th.Power(17.0, 1.0)
    state = th.State(np.array([x]), np.zeros(1))
    problem = th.Problem(system, state, 10.0, limiter=law)
    with pytest.raises(ConvergenceError, match="stiff"):
        th.solve(problem, th.plan(problem))
