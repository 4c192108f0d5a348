"""The references of `tests/reference` themselves, against numbers known in closed form."""

from __future__ import annotations

import flint
import numpy as np
import pytest
from flint import arb

from tests.reference.balls import Structure, UndecidedError, sign
from tests.reference.impact_modes import Family, Limiter, Solution, solved
from tests.reference.rigid import RigidMotion
from tests.reference.soft import SoftMotion, Spring

ONE = np.array([1.0])


def near(ball: arb, exact: arb, digits: int) -> bool:
    return bool(abs(ball - exact) < arb(10) ** -digits)


def test_impulse_of_an_oscillator_is_that_of_the_chapter() -> None:
    family = Family(Structure([[1.0]], [[1.0]]), (Limiter(ONE, 1.0, 1.0),), (0,))
    solution = solved(family, float(np.pi / 2))
    omega = arb(float(np.pi / 2)) * 2 / arb.pi()
    gamma = 1 / omega
    assert near(solution.impulse[0], omega**2 * gamma * gamma.cot(), 25)
    assert solution.exists() is True
    assert solution.radius() == pytest.approx(1.0, abs=1e-20)


def test_the_idle_limiter_beside_a_silent_resonance_is_passed() -> None:
    K = [[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]]
    limiters = (
        Limiter(np.eye(3)[0], 3.9470906885203574, 3.9470906885203574),
        Limiter(np.eye(3)[1], 1.0, 1.0),
    )
    family = Family(Structure(np.eye(3), K), limiters, (1,))
    solution = solved(family, float(np.sqrt(2) * (1 + 1e-12)))
    assert solution.exists() is False


def test_harmonics_sum_to_the_waveform() -> None:
    structure = Structure([[1.0]], [[1.0]], force=[0.2])
    solution = Solution(Family(structure, (Limiter(ONE, None, 1.0),), (0,)), 1.3)
    n = 400
    orders = [float(solution.harmonic(k)[0]) for k in range(n)]
    t = 0.4 * np.pi / (2 * 1.3)  # tau = 0.4
    values = [orders[k] * (np.sin(k * 1.3 * t) if k % 2 else np.cos(k * 1.3 * t)) for k in range(n)]
    assert sum(values) == pytest.approx(float(solution.displacement(0.4)[0]), abs=1e-4)


def test_sign_of_a_polynomial_that_touches_zero_is_undecided() -> None:
    flint.ctx.prec = 128
    squares = [arb(1) / 9, arb(-2) / 3, arb(1)]  # (s - 1/3)^2
    assert sign(squares, 0.0) is None
    assert sign([squares[0] + arb("1e-20"), *squares[1:]], 0.0) is True
    assert sign([squares[0] - arb("1e-20"), *squares[1:]], 0.0) is False


def test_a_bouncing_ball_rests_in_time() -> None:
    motion = RigidMotion(
        Structure([[1.0]], [[0.0]], force=[-1.0]), [Limiter(ONE, 0.0, None)], [0.5], [0.5], [0.0]
    )
    history = motion.run(5.0, [4.0])
    assert near(history.contacts[0].rest, arb(3), 30)  # sqrt(2 H/g) (1 + k)/(1 - k)
    assert near(history.states[0][0, 0], arb(0), 70)


def test_impacts_of_an_oscillator_follow_the_arccotangents() -> None:
    k = arb(0.5)
    motion = RigidMotion(Structure([[1.0]], [[1.0]]), [Limiter(ONE, 1.0, 1.0)], [0.5], [0.0], [3.0])
    impacts = motion.run(3.0, [3.0]).impacts
    v = arb(8).sqrt()
    assert near(impacts[0].time, (arb(1) / 3).asin(), 60)
    assert near(impacts[0].velocity, v, 60)
    assert near(impacts[1].time - impacts[0].time, 2 * (1 / (k * v)).atan(), 60)
    assert impacts[1].side == -1


def test_order_decides_between_coupled_limiters() -> None:
    limiters = [Limiter(np.array([1.0, 0.0]), None, 1.0), Limiter(np.array([0.6, 0.8]), None, 1.0)]
    motion = RigidMotion(
        Structure(np.eye(2), np.zeros((2, 2))), limiters, [1.0, 1.0], [0.0, 0.0],
        [1.0, 0.5 + 64 * 2.0**-53],
    )  # fmt: skip
    state = motion.run(2.5, [2.0]).states[0]
    assert near(state[0, 0], arb(8) / 10, 13)
    assert near(state[1, 0], arb(-6) / 10, 13)


def test_a_contact_is_released_by_its_load() -> None:
    """A mass pressed to its wall by cos t leaves at pi/2."""
    structure = Structure([[1.0]], [[0.0]], load=((0, 1.0, 1.0, 0.0),))
    motion = RigidMotion(structure, [Limiter(ONE, None, 0.0)], [0.5], [0.0], [0.0])
    history = motion.run(3.0, [2.0])
    assert near(history.contacts[0].stop, arb.pi() / 2, 60)
    # x'' = cos t from pi/2: x = -cos t - (t - pi/2)
    assert near(history.states[0][0, 0], -arb(2).cos() - (arb(2) - arb.pi() / 2), 60)


def test_grazing_that_no_digit_decides_is_said_so() -> None:
    motion = RigidMotion(Structure([[1.0]], [[1.0]]), [Limiter(ONE, 1.0, 1.0)], [1.0], [0.0], [1.0])
    with pytest.raises(UndecidedError, match="touches"):
        motion.run(3.0, [3.0])


def test_linear_soft_limiters_are_springs() -> None:
    spring = Spring(ONE, arb(1), arb(1), 3.0, 1)
    motion = SoftMotion(Structure([[1.0]], [[1.0]]), [spring], [0.0], [1.0])
    (state,) = motion.run([2.0])
    assert near(state[0, 0], arb(4).sin() / 2, 25)


def test_soft_limiters_conserve_energy_where_their_laws_change_sides() -> None:
    spring = Spring(ONE, None, arb(1), 3.0, 4)
    motion = SoftMotion(Structure([[1.0]], [[1.0]]), [spring], [0.0], [1.5])
    for state in motion.run([1.0, 3.0, 9.0]):
        x, v = state[0, 0], state[1, 0]
        energy = (x**2 + v**2) / 2 + (3 * x**5 / 5 if x > 0 else arb(0))
        assert near(energy, arb(9) / 8, 24)


@pytest.mark.needs("compiled kernels")
def test_steps_of_soft_motions_see_powers_that_are_far_away() -> None:
    """From the middle of a free gap the series has every eighth coefficient only."""
    spring = Spring(ONE, arb(0.1), arb(0.1), 8.0, 7)
    motion = SoftMotion(Structure([[1.0]], [[0.0]]), [spring], [0.0], [0.4])
    for state in motion.run([1.0, 9.0]):
        x, v = state[0, 0], state[1, 0]
        energy = v**2 / 2 + arb(0.1) * (x / arb(0.1)) ** 8
        assert near(energy, arb(0.4) ** 2 / 2, 22)
