"""Derivatives of motions with impacts: against differences to 77 digits; where there are none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.truth import motion_derivatives as truth
from vibroimpact_solvers import time_history
from vibroimpact_solvers.derivatives import LoadRate, MatrixRate, Parameter, StopRate
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Stage
from vibroimpact_solvers.presets import bouncing_ball, oscillator
from vibroimpact_solvers.time_history import Harmonic, Power, Problem, Sampled, State
from vibroimpact_solvers.time_history.derivatives import Reason

pytestmark = pytest.mark.needs("compiled kernels")

GAP = Parameter("gap", "length", stops=(StopRate(0, 1.0, 1.0),))
UPPER = Parameter("gap.upper", "length", stops=(StopRate(0, upper=1.0),))
STIFFNESS = Parameter("K.scale", K=MatrixRate(1.0))
SPEED = Parameter("initial.v.0", "length time-1", v=np.ones(1))
ALL = frozenset({"x", "v", "energy", "impacts"})


def solved(problem: Problem) -> time_history.Result:
    return time_history.solve(problem, time_history.plan(problem))


def problem(
    system: System, x: float, v: float, t: Any, *parameters: Parameter, **more: Any
) -> Problem:
    state, times = State(np.array([x]), np.array([v])), np.array(t, dtype=np.float64)
    return Problem(
        system, state, float(times[-1]), t=times, outputs=ALL, parameters=parameters, **more
    )


def reasons(result: time_history.Result) -> tuple[list[Reason], list[Reason]]:
    assert result.derivative_reason is not None
    assert result.derivative_impact_reason is not None
    return (
        [Reason(code) for code in result.derivative_reason],
        [Reason(code) for code in result.derivative_impact_reason],
    )


@pytest.mark.parametrize("seeds", [range(8 * k, 8 * k + 8) for k in range(4)], ids=str)
def test_random_motions(seeds: range) -> None:
    """Full, free and unstable structures, damped and driven, by numbers of all sorts."""
    found = [one for seed in seeds for one in truth.compared(seed)[0]]
    assert len(found) > 40
    assert [one for one in found if not one.within] == []
    moved = [one for one in found if one.size]
    assert max(one.wrong / one.size for one in moved) < 1e-10
    assert np.median([one.over for one in moved]) < 250.0


def test_two_impacts_in_closed_form() -> None:
    """A free mass between walls: all is known by its speeds u, k u, k^2 u."""
    system = System(
        SymmetricMatrix.dense([[2.0]]), SymmetricMatrix.dense([[0.0]]),
        (Constraint.at(0, gap=0.5, restitution=0.8),),
    )  # fmt: skip
    bounce = Parameter("restitution", stops=(StopRate(0, restitution=1.0),))
    start = Parameter("initial.x.0", x=np.ones(1))
    result = solved(problem(system, 0.1, 1.0, [0.2, 1.0, 2.0], GAP, bounce, start, SPEED))
    # t1 = (g - x)/u, t2 = t1 + 2 g/(k u), x(2) = -g + k^2 u (2 - t2)
    assert result.derivative_impact_time == pytest.approx(
        np.array([[1.0, 0.0, -1.0, -0.4], [3.5, -1.5625, -1.0, -1.65]]), rel=1e-13
    )
    later = -1.0 - 0.64 * 3.5, 1.6 * 0.35 + 1.0, 0.64, 0.64 * (0.35 + 1.65)
    assert result.derivative_x is not None
    assert result.derivative_x[2, 0] == pytest.approx(np.array(later), rel=1e-12)
    assert result.derivative_x[0, 0].tolist() == pytest.approx([0.0, 0.0, 1.0, 0.2], rel=1e-14)
    # m (1 + k) u and m (1 + k) k u
    assert result.derivative_impact_impulse == pytest.approx(
        np.array([[0.0, 2.0, 0.0, 3.6], [0.0, 5.2, 0.0, 2.88]]), abs=1e-13
    )
    # E = m u^2/2, times k^2 at each impact
    assert result.derivative_energy is not None
    assert result.derivative_energy[1] == pytest.approx([0.0, 1.6, 0.0, 1.28], abs=1e-13)


def test_frequency_of_a_load_in_resonance() -> None:
    """x = t sin(t)/2 by cos(w t) at w = 1, where dx/dw = (t^2 cos t - t sin t)/4."""
    times = np.linspace(0.5, 20.0, 5)
    by = Parameter("load.0.frequency", loads=(LoadRate(0, 1.0, sine=1.0),))
    result = solved(
        problem(oscillator([], 1.0), 0.0, 0.0, times, by, load=(Harmonic(0, 1.0, 1.0),))
    )
    expected = 0.25 * (times**2 * np.cos(times) - times * np.sin(times))
    assert result.derivative_x is not None
    assert result.derivative_x[:, 0, 0] == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_constant_loads_of_frequency_zero() -> None:
    by = Parameter("amplitude", loads=(LoadRate(0, 0.0, 1.0),))
    result = solved(
        problem(oscillator([], 2.0), 0.0, 0.0, [0.5, 1.0], by, load=(Harmonic(0, 1.0, 0.0),))
    )
    assert result.derivative_x is not None
    expected = 0.25 * (1.0 - np.cos([1.0, 2.0]))
    assert result.derivative_x[:, 0, 0] == pytest.approx(expected, rel=1e-13)


def test_an_output_at_an_event_has_none() -> None:
    """x has two slopes there; before and after it both sides agree."""
    system = oscillator([Constraint.at(0, gap=1.0, restitution=0.5)], Omega0=1.0)
    first = float(solved(problem(system, 0.0, 2.0, [3.0])).impact_time[0])  # type: ignore[index]
    result = solved(problem(system, 0.0, 2.0, [0.5, first, 0.6], GAP))
    assert reasons(result)[0] == [Reason.OK, Reason.EVENT, Reason.OK]
    assert result.derivative_x is not None
    assert np.isnan(result.derivative_x[1]).all()
    assert result.derivative_x[0, 0, 0] == 0.0
    assert result.derivative_x[2, 0, 0] == pytest.approx(1.5, rel=0.1)


def test_none_after_a_contact_begins() -> None:
    ball = bouncing_ball([Constraint((0,), (1.0,), 0.0, None, 0.5)], g=1.0)
    floor = Parameter("gap.lower", stops=(StopRate(0, lower=1.0),))
    result = solved(problem(ball, 1.0, 0.0, [1.0, 2.0, 8.0], floor))
    assert reasons(result)[0] == [Reason.OK, Reason.OK, Reason.CONTACT]
    assert result.derivative_x is not None
    assert np.isnan(result.derivative_x[2]).all()
    of_impacts = reasons(result)[1]
    # The last bounces are so slow that their errors decide whether they are there.
    assert of_impacts[:10] == [Reason.OK] * 10
    assert set(of_impacts[10:]) <= {Reason.OK, Reason.GRAZING, Reason.CONTACT}


def test_none_after_coupled_impacts_at_one_instant() -> None:
    system = System(
        SymmetricMatrix.dense(np.eye(2)), SymmetricMatrix.dense([[2.0, -1.0], [-1.0, 2.0]]),
        (Constraint((0,), (1.0,), 0.5, 0.5, 0.8), Constraint((0, 1), (0.5, 0.5), 0.5, 0.5, 0.8)),
    )  # fmt: skip
    state = State(np.zeros(2), np.ones(2))
    result = solved(Problem(
        system, state, 2.0, t=np.array([0.2, 1.5]), outputs=ALL, parameters=(GAP,)
    ))  # fmt: skip
    assert reasons(result)[0] == [Reason.OK, Reason.ORDER]
    assert set(reasons(result)[1]) == {Reason.ORDER}


def test_none_where_the_motion_is_unpredictable() -> None:
    system = oscillator([Constraint.at(0, gap=0.3)], Omega0=1.0)
    times = np.linspace(1.0, 3000.0, 50)
    load = (Harmonic(0, 1.0, 1.3),)
    result = solved(problem(system, 0.1, 0.7, times, GAP, load=load))
    assert result.error_predictable_until < 3000.0
    beyond = times >= result.error_predictable_until
    of_times, of_impacts = reasons(result)
    assert beyond.any()
    assert all((of is Reason.UNPREDICTABLE) for of in np.array(of_times, object)[beyond])
    assert of_impacts[-1] is Reason.UNPREDICTABLE
    assert result.derivative_x is not None
    assert np.isnan(result.derivative_x[beyond]).all()
    assert result.derivative_x_error is not None
    assert np.isnan(result.derivative_x_error[beyond]).all()


def test_none_where_a_wall_is_grazed() -> None:
    """The first turning point is at the wall: there, derivatives are infinite on one side."""
    system = oscillator([Constraint.at(0, gap=1.0)], Omega0=1.0)
    result = solved(problem(system, 0.0, 1.0, [0.5, 3.0], UPPER))
    assert Reason.GRAZING in reasons(result)[0]
    assert result.derivative_x is not None
    assert np.isnan(result.derivative_x[1]).all()


def test_none_where_the_motion_starts_with_an_impact() -> None:
    system = oscillator([Constraint.at(0, gap=1.0, restitution=0.5)], Omega0=1.0)
    result = solved(problem(system, 1.0, 1.0, [0.5, 1.0], GAP))
    assert reasons(result) == ([Reason.START] * 2, [Reason.START] * len(reasons(result)[1]))


def test_the_distance_to_a_grazing() -> None:
    """The velocity at the first wall is (v^2 - g^2)^(1/2): zero where the gap is v."""
    system = oscillator([Constraint((0,), (1.0,), None, 1.0, 1.0)], Omega0=1.0)
    result = solved(problem(system, 0.0, 1.001, [3.0], UPPER))
    assert result.derivative_distance is not None
    assert result.derivative_distance[0] == pytest.approx(0.001, rel=2e-3)


def test_what_does_not_change_has_a_derivative_of_zero() -> None:
    one = SymmetricMatrix.diagonal([1.0, 1.0])
    system = System(one, one, (Constraint.at(0, gap=1.0), Constraint.at(1, gap=2.0)))
    state, other = State(np.zeros(2), np.array([1.5, 0.5])), StopRate(1, 1.0, 1.0)
    result = solved(Problem(
        system, state, 3.0, t=np.array([3.0]), outputs=ALL,
        parameters=(Parameter("gap", stops=(other,)),),
    ))  # fmt: skip
    assert result.derivative_x is not None
    assert result.derivative_x_error is not None
    assert (result.derivative_x == 0.0).all()
    assert (result.derivative_x_error == 0.0).all()


def test_histories_longer_than_a_block_of_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    from vibroimpact_solvers.time_history.derivatives import following

    system = oscillator([Constraint.at(0, gap=0.4, restitution=0.7)], Omega0=1.0, zeta=0.05)
    of = problem(system, 0.0, 1.0, np.linspace(0.1, 20.0, 60), GAP, STIFFNESS)
    whole = solved(of)
    monkeypatch.setattr(following, "_BLOCK", 150)
    parts = solved(of)
    for name in ("x", "v", "energy", "impact_time", "x_error", "energy_error"):
        one, other = (getattr(each, f"derivative_{name}") for each in (whole, parts))
        assert np.array_equal(one, other, equal_nan=True), name


def test_nothing_is_added_without_parameters() -> None:
    system = oscillator([Constraint.at(0, gap=0.4)], Omega0=1.0)
    plain, asked = (solved(problem(system, 0.0, 1.0, [3.0], *p)) for p in ((), (GAP,)))
    assert plain.derivative_x is None
    assert plain.derivative_impact_time is None
    assert plain.parameter is None
    assert plain.x is not None
    assert asked.x is not None
    assert plain.x.tolist() == asked.x.tolist()
    assert "derivatives" in {skip.what for skip in time_history.plan(
        problem(system, 0.0, 1.0, [3.0])
    ).skips}  # fmt: skip
    step = time_history.plan(problem(system, 0.0, 1.0, [3.0], GAP)).step(Stage.DERIVATIVES)
    assert step is not None
    assert "1 parameter:" in step.reason


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "soft limiters": ({"limiter": Power(3.0, 1.0, 1.0)}, "finite stiffness"),
    "integrators": ({"method": "RK45"}, "integrators"),
    "digits": ({"digits": 30}, "double precision only"),
    "sampled loads": (
        {"load": (Sampled(np.ones(1), np.array([0.0, 9.0]), np.zeros(2)),)}, "sampled loads"
    ),
    "impact modes": ({"initial": time_history.ImpactMode(2.0)}, "give x and v"),
    "no errors": ({"estimate": False}, "need the errors"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_has_no_derivatives(name: str) -> None:
    changed, message = REFUSED[name]
    plain = problem(oscillator([Constraint.at(0, gap=1.0)], Omega0=1.0), 0.0, 1.5, [3.0])
    with pytest.raises(ModelError, match=message) as caught:
        replace(plain, parameters=(GAP,), **changed)
    assert caught.value.pointer == ("derivatives",)
    assert caught.value.code == "not_possible"


def test_entries_of_structures_with_parts_without_mass() -> None:
    system = System(
        SymmetricMatrix.diagonal([1.0, 0.0]), SymmetricMatrix.dense([[2.0, -1.0], [-1.0, 2.0]]), ()
    )
    entry = MatrixRate(entries=SymmetricMatrix.diagonal([1.0, 0.0]))
    state = State(np.array([0.1, 0.0]), np.zeros(2))
    with pytest.raises(ModelError, match="without mass") as caught:
        Problem(system, state, 1.0, parameters=(STIFFNESS, Parameter("K.0.0", K=entry)))
    assert caught.value.pointer == ("derivatives", 1)
