"""Contacts, chatter, simultaneous impacts, grazings: what a motion may not stumble over."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import scipy.integrate

from vibroimpact_solvers import presets
from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError, ModelError
from vibroimpact_solvers.kernels.impact_law import impulses
from vibroimpact_solvers.kernels.rigid_motion import Stop
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Stage
from vibroimpact_solvers.time_history import rigid_motions, run

ALL = frozenset(th.OUTPUTS)


def solve(
    system: System, x: Floats, v: Floats, t_end: float, num: int = 11, **fields: object
) -> th.Result:
    problem = th.Problem(
        system,
        th.State(np.asarray(x, dtype=float), np.asarray(v, dtype=float)),
        t_end,
        t=np.linspace(0.0, t_end, num),
        outputs=ALL,
        **fields,  # type: ignore[arg-type]
    )
    return th.solve(problem, th.plan(problem))


def test_without_restitution_a_ball_stays_on_the_floor() -> None:
    ball = presets.bouncing_ball([Constraint((0,), (1.0,), 0.0, None, 0.0)])
    result = solve(ball, [1.0], [0.0], 2.0)
    fall = math.sqrt(2.0 / 9.81)
    assert result.count_impacts == 1
    np.testing.assert_allclose(result.contact_start, [fall], rtol=1e-15)
    np.testing.assert_allclose(result.contact_rest, [fall], rtol=1e-15)
    assert result.x is not None
    np.testing.assert_array_equal(result.x[-8:], 0.0)


def test_a_mass_is_released_when_its_contact_force_vanishes() -> None:
    """x'' + x = F cos(w t + phase), k = 0: pressed on while x + w^2-free force > gap.

    On the wall x = g the wall's force is g - F cos(w t + phase); the mass leaves where it
    vanishes, which is known in closed form.
    """
    gap, F, w, phase = 0.3, 0.8, 0.4, 0.2
    system = presets.oscillator([Constraint((0,), (1.0,), None, gap, 0.0)], 1.0)
    load = (th.Harmonic(0, F, w, phase),)
    result = solve(system, [gap], [0.0], 60.0, load=load)
    assert result.contact_stop is not None
    assert result.contact_rest is not None
    expected = (math.acos(gap / F) - phase) / w
    np.testing.assert_allclose(result.contact_stop[0], expected, rtol=1e-14)
    turn = 2.0 * math.pi / w
    later = [(t + phase / w) % turn * w for t in result.contact_stop[1:-1]]
    np.testing.assert_allclose(later, math.acos(gap / F), rtol=1e-13)
    assert len(later) > 2


def test_chatter_of_a_driven_oscillator_ends_where_its_series_does() -> None:
    """Impacts listed before the rest shrink like k; their sum is the time of rest."""
    system = presets.oscillator([Constraint((0,), (1.0,), None, 0.1, 0.6)], 1.0, 0.05)
    load = (th.Harmonic(0, 0.8, 0.3),)
    result = solve(system, [0.0], [0.0], 80.0, load=load)
    assert result.contact_rest is not None
    assert result.contact_start is not None
    assert result.impact_time is not None
    assert result.contact_rest.size >= 3
    for start, rest in zip(result.contact_start, result.contact_rest, strict=True):
        times = result.impact_time[result.impact_time <= start][-4:]
        intervals = np.diff(times)
        np.testing.assert_allclose(intervals[1:] / intervals[:-1], 0.6, rtol=1e-5)
        np.testing.assert_allclose(rest - start, intervals[-1] * 0.6 / 0.4, rtol=1e-5)
        assert rest - start < 1e-6


def test_two_masses_at_rest_on_their_walls_against_integration() -> None:
    """Contacts of a structure with C, released one after the other; compared with solve_ivp.

    The reference integrates the constrained equations piecewise between the events that the result
    names, so that it checks the motion in the contacts and their forces at release.
    """
    M, K = np.eye(2), np.array([[2.0, -1.0], [-1.0, 2.0]])
    C = np.array([[0.2, -0.1], [-0.1, 0.3]])
    stops = (Constraint((0,), (1.0,), None, 0.05, 0.0), Constraint((1,), (1.0,), 0.1, 0.5, 0.0))
    system = System(*(SymmetricMatrix.dense(a) for a in (M, K)), stops, C=SymmetricMatrix.dense(C))
    load = (th.Harmonic(0, 0.6, 0.5), th.Harmonic(1, -0.5, 0.35, 0.4))
    result = solve(system, [0.0, 0.0], [0.2, 0.0], 40.0, 401, load=load)
    assert result.x is not None
    assert result.v is not None
    assert result.contact_rest is not None
    assert result.contact_stop is not None
    assert result.contact_constraint is not None
    assert result.impact_time is not None
    assert result.t is not None
    assert set(result.contact_constraint.tolist()) == {0, 1}

    def force(t: float) -> Floats:
        return np.array([0.6 * math.cos(0.5 * t), -0.5 * math.cos(0.35 * t + 0.4)])

    events = np.unique(np.concatenate([result.impact_time, result.contact_stop, [0.0, 40.0]]))
    state = np.array([0.0, 0.0, 0.2, 0.0])
    for start, stop in itertools.pairwise(events):
        middle = 0.5 * (start + stop)
        rests = (result.contact_rest <= middle) & (middle <= result.contact_stop)
        at_rest = np.zeros(2, dtype=bool)
        at_rest[result.contact_constraint[rests]] = True

        def rate(t: float, z: Floats, at_rest: Floats = at_rest) -> Floats:
            a = force(t) - K @ z[:2] - C @ z[2:]
            return np.concatenate([z[2:], np.where(at_rest, 0.0, a)])

        state[2:][at_rest] = 0.0
        for c in result.impact_constraint[np.abs(result.impact_time - start) == 0.0]:  # type: ignore[index]
            state[2 + c] = 0.0
        inside = (result.t >= start) & (result.t < stop)
        at = np.append(result.t[inside & (result.t < stop)], stop)
        found = scipy.integrate.solve_ivp(
            rate, (start, stop), state, "DOP853", at, rtol=1e-12, atol=1e-13
        )
        np.testing.assert_allclose(found.y[:2, :-1].T, result.x[inside], rtol=0, atol=1e-9)
        state = found.y[:, -1].copy()
    assert (result.x[:, 0] <= 0.05 + 1e-15).all()
    assert (result.x[:, 1] >= -0.1 - 1e-15).all()


def test_a_symmetric_pair_strikes_together() -> None:
    """A mirror-symmetric chain keeps its symmetry: both limiters act at the same instants."""
    stops = [Constraint.at(1, 0.2, 0.8), Constraint.at(5, 0.2, 0.8)]
    system = presets.chain(7, stops)
    v = np.array([0.3, 0.9, -0.2, 0.5, -0.2, 0.9, 0.3])
    result = solve(system, np.zeros(7), v, 10.0)
    assert result.x is not None
    assert result.impact_time is not None
    assert result.impact_constraint is not None
    first, second = result.impact_time[0::2], result.impact_time[1::2]
    assert result.count_impacts % 2 == 0
    assert result.count_impacts >= 4
    np.testing.assert_allclose(first, second, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(result.x, result.x[:, ::-1], rtol=0.0, atol=1e-12)


def test_impulses_of_coupled_constraints() -> None:
    """Newton's cradle in the extreme: the wall of a body that is pulled away must not pull."""
    mobility = np.array([[1.0, 0.8], [0.8, 1.0]])
    struck, ones = np.array([0, 1]), np.ones(2)
    restitution = np.array([0.5, 0.5])
    P = impulses(mobility, restitution, struck, ones, np.array([1.0, 0.1]))
    after = np.array([1.0, 0.1]) - mobility @ P
    np.testing.assert_allclose(P, [1.5, 0.0], rtol=1e-15)
    assert (after <= -0.5 * np.array([1.0, 0.1])).all()
    P = impulses(mobility, restitution, struck, ones, np.array([1.0, 1.0]))
    after = 1.0 - mobility @ P
    np.testing.assert_allclose(after, [-0.5, -0.5], rtol=1e-14)
    restitution = np.array([0.5, 0.0])  # of what is in contact: it is not struck
    P = impulses(mobility, restitution, struck, np.array([1.0, -1.0]), np.array([1.0, 0.0]))
    after = np.array([1.0, 0.0]) - np.array([[1.0, -0.8], [-0.8, 1.0]]) @ P
    assert (P > 0.0).all()
    np.testing.assert_allclose(after, [-0.5, 0.0], atol=1e-15)


def test_a_grazing_passes_without_impulse() -> None:
    system = presets.oscillator([Constraint.at(0, 1.0, 0.5)], 1.0)
    result = solve(system, [0.0], [1.0], 50.0)
    assert result.count_impacts == 0
    assert result.x is not None
    assert result.t is not None
    np.testing.assert_allclose(result.x[:, 0], np.sin(result.t), rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("excess", [1e-13, 1e-10, 1e-6])
def test_the_slightest_impact_is_found(excess: float) -> None:
    """x = (1 + excess) sin t passes the wall by `excess` only."""
    system = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
    result = solve(system, [0.0], [1.0 + excess], 20.0)
    assert result.count_impacts == 6
    assert result.impact_velocity is not None
    expected = math.sqrt((1.0 + excess) ** 2 - 1.0)
    np.testing.assert_allclose(np.abs(result.impact_velocity), expected, rtol=1e-15 / excess)


@pytest.mark.needs("compiled kernels")
def test_energy_of_a_hundred_thousand_elastic_impacts() -> None:
    system = presets.chain(13, [Constraint.at(5, 0.2)])
    rng = np.random.default_rng(5)
    x, v = rng.uniform(-0.1, 0.1, 13), rng.standard_normal(13)
    result = solve(system, x, v, 1.4e5)  # of which rounding decides how many impacts there are
    assert result.count_impacts > 1e5
    assert result.energy is not None
    np.testing.assert_allclose(result.energy, result.energy[0], rtol=1e-12)


def test_reversed_motion_returns() -> None:
    system = presets.chain(9, [Constraint.at(3, 0.2), Constraint((5, 6), (1.0, -1.0), 0.1, None)])
    rng = np.random.default_rng(7)
    x, v = rng.uniform(-0.05, 0.05, 9), rng.standard_normal(9)
    there = solve(system, x, v, 12.0)
    assert there.x is not None
    assert there.v is not None
    assert there.count_impacts > 10
    back = solve(system, there.x[-1], -there.v[-1], 12.0)
    assert back.x is not None
    assert back.v is not None
    assert back.count_impacts == there.count_impacts
    rounding = 4.0 * 2.0**-52 * np.linalg.norm(v) * (back.error_condition + there.error_condition)
    np.testing.assert_allclose(back.x[-1], x, rtol=0.0, atol=rounding)
    np.testing.assert_allclose(-back.v[-1], v, rtol=0.0, atol=2.0 * rounding)
    assert rounding < 1e-8


def test_asymmetric_and_preloaded_gaps() -> None:
    """A wall beyond the equilibrium: unilateral motion of closed form (10.11-10.12).

    x'' + x = 0 with x <= -1/2: half-period from the wall and back, x = -A cos t there.
    """
    system = presets.oscillator([Constraint((0,), (1.0,), None, -0.5)], 1.0)
    result = solve(system, [-1.3], [0.0], 20.0)
    assert result.impact_time is not None
    first = math.acos(0.5 / 1.3)
    np.testing.assert_allclose(
        result.impact_time, first + 2.0 * first * np.arange(result.count_impacts), rtol=1e-14
    )


def test_states_outside_of_their_limits_are_refused() -> None:
    system = presets.oscillator([Constraint.at(0, 0.5)], 1.0)
    with pytest.raises(ModelError) as caught:
        solve(system, [0.6], [0.0], 1.0)
    assert caught.value.pointer == ("initial", "x")
    assert caught.value.code == "outside_limits"


@pytest.mark.parametrize(
    ("fields", "pointer"),
    [
        ({"t_end": 1e308}, ("t_end",)),
        ({"t_end": 5e-324}, ("t_end",)),
        ({"initial": th.State(np.array([0.1]), np.array([1e308]))}, ("initial", "v")),
        ({"initial": th.State(np.array([5e-324]), np.array([0.0]))}, ("initial", "x")),
        ({"load": (th.Harmonic(0, 1e200, 1.0),)}, ("load", 0, "amplitude")),
        ({"load": (th.Harmonic(0, 1.0, 1e-200),)}, ("load", 0, "frequency")),
    ],
)
def test_numbers_whose_squares_are_none_are_refused(
    fields: dict[str, object], pointer: tuple[str | int, ...]
) -> None:
    system = presets.oscillator([Constraint((0,), (1.0,), 0.3, 0.3)], 1.0)
    rest = th.State(np.zeros(1), np.zeros(1))
    with pytest.raises(ModelError, match="not between") as caught:
        th.Problem(system, **{"initial": rest, "t_end": 1.0, **fields})  # type: ignore[arg-type]
    assert caught.value.pointer == pointer


def test_a_motion_that_hides_its_walls_is_refused() -> None:
    """A load that presses against a gap far below rounding, where time would not advance."""
    chain = presets.chain(13, [Constraint((5,), (1.0,), 1e-50, 1e-50)])
    load = (th.Harmonic(0, 0.01, 0.7, 0.5),)
    problem = th.Problem(chain, th.ImpactMode(3.0, (0,)), 10.0, load=load, tolerance=1e-8)
    with pytest.raises(ConvergenceError, match="knows the coordinate to"):
        th.solve(problem, th.plan(problem))


def test_the_impact_mode_that_a_motion_starts_on_is_paid_for() -> None:
    chain = presets.chain(13, [Constraint((5,), (1.0,), 0.2, 0.2)])

    def price(Omega: float) -> float:
        problem = th.Problem(chain, th.ImpactMode(Omega, (0,)), 10.0)
        step = th.plan(problem).step(Stage.EXISTENCE)
        assert step is not None
        return step.flops

    # The path check of a motion is as long as its period; what else there is does not depend on it.
    longer, long = price(1e-6) - price(1e-5), price(1e-5) - price(1e-4)
    assert longer == pytest.approx(10.0 * long, rel=0.05)


def test_a_search_that_does_not_get_on_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """A compiled loop that does not get on, again and again, would never return."""
    problem = th.Problem(
        presets.oscillator([Constraint.at(0, 1.0)], 1.0),
        th.State(np.zeros(1), np.array([5.0])),
        50.0,
        t=np.linspace(0.0, 50.0, 201),
        outputs=frozenset({"x"}),
    )
    for module in (rigid_motions, run):
        monkeypatch.setattr(module, "follow", lambda *_: (Stop.STILL, 0))
    with pytest.raises(ConvergenceError, match=r"keeps grazing at t = 0\.0"):
        th.solve(problem, th.plan(problem))
