"""Several coordinates at their walls: what chatters while others rest, and what rests together."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vibroimpact_solvers import time_history as th
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System


def upper(dof: int, wall: float, restitution: float) -> Constraint:
    return Constraint((dof,), (1.0,), None, wall, restitution)


def structure(
    M: object, K: object, stops: tuple[Constraint, ...], force: Floats | None = None
) -> System:
    matrices = [SymmetricMatrix.dense(np.array(A, dtype=np.float64)) for A in (M, K)]
    return System(*matrices, stops, force=force)


def solve(system: System, x: object, v: object, t: Floats) -> th.Result:
    state = th.State(np.array(x, dtype=np.float64), np.array(v, dtype=np.float64))
    problem = th.Problem(system, state, float(t[-1]), t=t, outputs=frozenset(th.OUTPUTS))
    return th.solve(problem, th.plan(problem))


def test_chatter_at_one_wall_while_another_coordinate_rests() -> None:
    """It ends, where rounding of the place gave it more energy than it lost.

    The time of rest of the reference in balls.
    """
    stops = upper(0, 0.34, 0.7), upper(1, 0.17, 0.3)
    system = structure([[1.0, 0.11], [0.11, 1.0]], np.eye(2), stops, np.array([0.7, 2.5]))
    result = solve(system, [0.0, 0.0], [0.0, 0.0], np.linspace(0.0, 20.0, 11))
    assert result.contact_constraint is not None
    assert result.contact_rest is not None
    assert result.contact_stop is not None
    assert result.x is not None
    np.testing.assert_array_equal(result.contact_constraint, [1, 0])
    assert result.error_contact_rest is not None
    error = float(result.error_contact_rest[1])
    assert error < 1e-10
    np.testing.assert_allclose(result.contact_rest[1], 7.978206367186615, rtol=0.0, atol=error)
    np.testing.assert_array_equal(result.contact_stop, 20.0)
    np.testing.assert_allclose(result.x[-1], [0.34, 0.17], rtol=1e-15)
    assert result.count_impacts < 100


def test_two_masses_come_to_rest_at_one_time() -> None:
    """By symmetry x1 = -x0 and x0'' = 2: each is a ball that falls on its wall."""
    stops = Constraint.at(0, 0.25, 0.3), Constraint.at(1, 0.25, 0.3)
    force = np.array([1.0, -1.0])
    system = structure([[1.0, 0.5], [0.5, 1.0]], np.zeros((2, 2)), stops, force)
    t = np.array([0.25, 0.65, 0.8, 0.85, 0.9, 1.0, 2.0])
    result = solve(system, [0.0, 0.0], [0.0, 0.0], t)
    assert result.x is not None
    assert result.contact_impulse is not None
    rest = 0.5 + 0.3 / 0.7
    np.testing.assert_array_equal(result.contact_constraint, [0, 1])
    # Bounces of 1e-8 and less are one sum, of each coordinate: the sum is checked, not their end.
    np.testing.assert_allclose(result.contact_rest, rest, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(result.contact_impulse, 2.0 - rest, rtol=0.0, atol=1e-7)
    # Parabolas of 2 u / 2 from the wall, u = 0.3, 0.09, ...
    x = [0.0625]
    for time in t[1:5]:
        start, u = 0.5, 0.3
        while start + u < time:
            start, u = start + u, 0.3 * u
        x.append(0.25 - u * (time - start) + (time - start) ** 2)
    x += [0.25, 0.25]
    np.testing.assert_allclose(result.x, np.outer(x, [1.0, -1.0]), rtol=0.0, atol=1e-13)


def test_a_particle_rests_in_a_corner() -> None:
    """Without restitution it loses both velocities, and no force takes it away again."""
    system = structure(np.eye(2), np.zeros((2, 2)), (upper(0, 1.0, 0.0), upper(1, 1.0, 0.0)))
    result = solve(system, [0.0, 0.0], [1.0, 1.0], np.array([0.5, 1.5, 2.0]))
    np.testing.assert_allclose(result.x, [[0.5, 0.5], [1.0, 1.0], [1.0, 1.0]], rtol=1e-15)
    np.testing.assert_array_equal(result.contact_rest, [1.0, 1.0])
    np.testing.assert_array_equal(result.contact_stop, [2.0, 2.0])
    np.testing.assert_array_equal(result.contact_impulse, [0.0, 0.0])


def test_an_impact_presses_what_rests() -> None:
    """M x'' = f presses mass 0, which starts at its wall; mass 1 swings between it and rest.

    With mass 0 at rest mass 1 is an oscillator about 0.59/2.1: its impacts are known. Each gives
    mass 0 an impulse too, which is no impact of it.
    """
    stops = upper(0, 0.3, 0.5), upper(1, 0.2, 1.0)
    M, K = [[1.3, 0.2], [0.2, 1.0]], [[1.7, -0.3], [-0.3, 2.1]]
    force = np.array([2.0, 0.5])
    result = solve(structure(M, K, stops, force), [0.3, 0.0], [0.0, 0.0], np.array([7.0]))
    still, w = 0.59 / 2.1, math.sqrt(2.1)
    first = math.acos(1.0 - 0.2 / still) / w
    times = first * np.array([1.0, 3.0, 5.0, 7.0])
    np.testing.assert_array_equal(result.impact_constraint, [1, 1, 1, 1])
    np.testing.assert_allclose(result.impact_time, times, rtol=1e-14)
    speed = w * still * math.sin(w * first)
    np.testing.assert_allclose(result.impact_velocity, speed, rtol=1e-13)
    # M22 is what is struck while mass 0 does not move.
    np.testing.assert_allclose(result.impact_impulse, 2.0 * speed, rtol=1e-13)
    # All impulses on the structure: p0' = f0 - K x - wall, with momentum p0 = M01 v1.
    assert result.contact_impulse is not None
    assert result.v is not None
    turned = still * math.sin(w * first) / w
    swung = still * first - turned  # the integral of x1 from its rest to its wall
    between = 7.0 * swung
    rest = 7.0 - times[-1]
    x1 = still - (still - 0.2) * math.cos(w * rest) - speed / w * math.sin(w * rest)
    v1 = (still - 0.2) * w * math.sin(w * rest) - speed * math.cos(w * rest)
    between += still * rest - (still - 0.2) * math.sin(w * rest) / w
    between += speed / w**2 * (math.cos(w * rest) - 1.0)
    np.testing.assert_allclose(result.x, [[0.3, x1]], rtol=0.0, atol=1e-13)
    wall = (2.0 - 1.7 * 0.3) * 7.0 + 0.3 * between - 0.2 * v1
    np.testing.assert_allclose(result.contact_impulse, [wall], rtol=1e-13)


@pytest.mark.parametrize("side", [1, -1])
def test_free_structures_with_a_limited_difference(side: int) -> None:
    """K is singular, though its factors say that it is not: half of the energy is translation."""
    a, m, gap, speed = 1.271118490029619, 1.3, 0.2, 0.7
    stop = Constraint((0, 1), (1.0, -1.0), gap, gap, 0.5)
    system = structure(m * np.eye(2), [[a, -a], [-a, a]], (stop,))
    t = np.array([0.1, 0.3, 1.0])
    result = solve(system, [0.0, 0.0], [side * speed, 0.0], t)
    w = math.sqrt(2.0 * a / m)
    first = math.asin(gap * w / speed) / w
    difference, u = [], speed * math.cos(w * first)
    for time in t:
        s = time - first
        after = gap * math.cos(w * s) - 0.5 * u / w * math.sin(w * s)
        difference.append(speed / w * math.sin(w * time) if s < 0.0 else after)
    x = 0.5 * side * (speed * t[:, np.newaxis] + np.outer(difference, [1.0, -1.0]))
    np.testing.assert_allclose(result.x, x, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(result.impact_time, [first], rtol=1e-14)


def test_a_free_body_is_all_that_contacts_leave() -> None:
    """Its stiffness is the rounding of what cancels; an equilibrium of it would be at 1e31.

    Where everything rests is known by impacts in 77 digits, case 4409 of seed 23 of the histories.
    """
    a = 1.1796875
    stops = (
        Constraint((1,), (1.0,), 0.0010634741978955105, 0.0010634741978955105, 0.0),
        Constraint(
            (1, 0), (1.0, -1.0), 0.04055379845981302, 0.04055379845981302, 0.4751907200738844
        ),
    )
    force = np.array([-0.6807773103279953, 0.4398675584299565])
    system = structure(np.eye(2), [[a, -a], [-a, a]], stops, force)
    v = [0.0885211965377349, -2.3432391869763847]
    result = solve(system, [0.0, 0.0], v, np.array([1.0, 2.3]))
    assert result.x is not None
    expected = [-0.04161727265770853, -0.0010634741978955105]
    assert result.x == pytest.approx(np.tile(expected, (2, 1)), rel=1e-12)


def test_contacts_that_depend_on_one_another_are_refused() -> None:
    """Three walls meet in a corner of two coordinates: what each of them bears is not unique."""
    stops = (
        upper(0, 0.25, 0.0),
        upper(1, 0.25, 0.0),
        Constraint((0, 1), (0.6, 0.8), None, 0.35, 0.0),
        Constraint((2,), (1.0,), 0.1, 0.1, 1.0),
    )
    K = SymmetricMatrix.dense(np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]]))
    M = SymmetricMatrix.diagonal(np.array([1.3, 0.7, 1.0]))
    system = System(M, K, stops, force=np.array([6.0, 6.0, 0.0]))
    state = th.State(np.array([0.225, 0.225, 0.0]), np.array([0.25, 0.25, 0.3]))
    problem = th.Problem(system, state, 5.0, outputs=frozenset({"impacts"}))
    with pytest.raises(ConvergenceError, match="0, 1, 2 depend on one another"):
        th.solve(problem, th.plan(problem))


@pytest.mark.parametrize("ahead", [-1e-14, 0.0, 1e-14])
def test_the_order_of_impacts_beside_a_contact_is_not_known(ahead: float) -> None:
    """Two coordinates strike at once, and one of them opens the contact of a third by its mass."""
    c = 0.2
    M = SymmetricMatrix.dense(np.array([[1.0, c, -c], [c, 1.0, 0.3], [-c, 0.3, 1.0]]))
    stops = (
        upper(0, 0.1, 0.0),
        Constraint((1,), (1.0,), 0.2, 0.2, 1.0),
        Constraint((2,), (1.0,), 0.2, 0.2, 1.0),
    )
    system = System(M, SymmetricMatrix.diagonal(np.ones(3)), stops, force=np.array([5.0, 0.0, 0.0]))
    state = th.State(np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.5, 0.5 * (1.0 + ahead)]))
    problem = th.Problem(system, state, 1.0, outputs=frozenset({"impacts"}))
    result = th.solve(problem, th.plan(problem))
    assert result.impact_time is not None
    assert result.error_predictable_until <= result.impact_time[0] + 1e-9
