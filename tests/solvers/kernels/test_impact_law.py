"""Laws of simultaneous impacts against what they say in words: bounded minima of the energy.

A perfectly inelastic blow leaves the least energy that impulses >= 0 can leave. By Poisson's law
the expansion leaves the least energy with at least k times these impulses; by Moreau's, with k = 1,
what the inelastic blow took is reflected, as often as something approaches. Minima are found by
nonnegative least squares, energies are those of masses and velocities.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.impact_law import impulses

SEEDS = st.integers(0, 2**32 - 1)
MANY = settings(max_examples=300, deadline=None)


def pushed(N: Floats, velocity: Floats) -> Floats:
    """Return the impulses that take all velocity towards walls: ``|velocity - N P|`` is least.

    Of all sets of walls that may push, that which leaves least: `scipy.optimize.nnls` 1.17 returns
    something else where a pair of impulses is zero at the solution.
    """
    m, least, best = N.shape[1], np.inf, np.zeros(N.shape[1])
    for chosen in itertools.product((False, True), repeat=m):
        P = np.zeros(m)
        P[list(chosen)] = np.linalg.lstsq(N[:, chosen], velocity, rcond=None)[0]
        left = float(np.linalg.norm(velocity - N @ P))
        if (P >= 0.0).all() and left < least:
            least, best = left, P
    return best


@dataclass(frozen=True)
class Blow:
    """Coordinates ``W x`` at walls, with all velocities."""

    M: Floats
    W: Floats
    sides: Floats
    v: Floats

    @classmethod
    def random(cls, seed: int, count: int | None = None) -> Blow:
        rng = np.random.default_rng(seed)
        m = int(rng.integers(1, 5)) if count is None else count
        n = m + int(rng.integers(0, 3))
        spread = np.exp(rng.uniform(-2.0, 2.0, n))
        A = rng.standard_normal((n, n))
        M = np.diag(spread) + (0.5 * A @ A.T / n if rng.random() < 0.5 else 0.0)
        chain = np.eye(m, n) - np.eye(m, n, -1)  # of balls, each at the one before
        W = chain if rng.random() < 0.5 else rng.standard_normal((m, n))
        return cls(M, W, rng.choice([-1.0, 1.0], m), rng.standard_normal(n))

    @property
    def restitution(self) -> Floats:
        """Random k, some of them at the ends of their range."""
        rng = np.random.default_rng(self.v.view(np.uint64))
        k = rng.random(self.sides.size)
        return np.where(rng.random(k.size) < 0.3, rng.choice([0.0, 1.0], k.size), k)

    @property
    def walls(self) -> Integers:
        return np.arange(self.sides.size)

    @property
    def rows(self) -> Floats:
        """The coordinates, positive towards their walls."""
        return np.asarray(self.sides[:, np.newaxis] * self.W)

    def impulses(self, k: Floats) -> Floats:
        mobility = self.W @ np.linalg.solve(self.M, self.W.T)
        return impulses(mobility, k, self.walls, self.sides, self.rows @ self.v)

    def after(self, P: Floats) -> Floats:
        return np.asarray(self.v - np.linalg.solve(self.M, self.rows.T @ P))

    def energy(self, v: Floats) -> float:
        return float(0.5 * v @ self.M @ v)

    @property
    def normals(self) -> tuple[Floats, Floats]:
        """The coordinates and the velocities where the energy is half the square of a length."""
        L = np.linalg.cholesky(self.M)
        return scipy.linalg.solve_triangular(L, self.rows.T, lower=True), L.T @ self.v

    def poisson(self, k: Floats) -> Floats:
        """Return velocities by Poisson's law."""
        N, velocity = self.normals
        inelastic = pushed(N, velocity)
        velocity = velocity - N @ ((1.0 + k) * inelastic)
        more = pushed(N, velocity)
        return self._back(velocity - N @ more)

    def moreau(self) -> Floats:
        """Return velocities by Moreau's law with k = 1."""
        N, velocity = self.normals
        while (N.T @ velocity).max() > 1e-12 * np.linalg.norm(velocity) * np.abs(N).max():
            inelastic = pushed(N, velocity)
            velocity = velocity - 2.0 * N @ inelastic
        return self._back(velocity)

    def _back(self, velocity: Floats) -> Floats:
        L = np.linalg.cholesky(self.M)
        return np.asarray(scipy.linalg.solve_triangular(L.T, velocity))

    @property
    def accuracy(self) -> float:
        """Rounding of velocities, relative to them."""
        N, _ = self.normals
        return float(1e-13 * np.linalg.cond(N) ** 2 * np.linalg.cond(self.M))


@MANY
@given(SEEDS)
def test_energy_never_grows_and_nothing_goes_on_into_its_wall(seed: int) -> None:
    blow = Blow.random(seed)
    k = blow.restitution
    P = blow.impulses(k)
    after, size = blow.after(P), np.abs(blow.v).max()
    assert (P >= 0.0).all()
    assert blow.energy(after) <= blow.energy(blow.v) * (1.0 + blow.accuracy)
    assert (blow.rows @ after).max() <= blow.accuracy * size * np.abs(blow.W).max()


@MANY
@given(SEEDS)
def test_poissons_law_is_two_minima_of_the_energy(seed: int) -> None:
    blow = Blow.random(seed)
    k = 0.999 * blow.restitution
    expected, size = blow.poisson(k), np.abs(blow.v).max()
    np.testing.assert_allclose(
        blow.after(blow.impulses(k)), expected, rtol=0.0, atol=blow.accuracy * size
    )


@MANY
@given(SEEDS)
def test_moreaus_law_conserves_the_energy(seed: int) -> None:
    blow = Blow.random(seed)
    after = blow.after(blow.impulses(np.ones(blow.sides.size)))
    assert blow.energy(after) == pytest.approx(blow.energy(blow.v), rel=blow.accuracy)
    np.testing.assert_allclose(
        after, blow.moreau(), rtol=0.0, atol=100.0 * blow.accuracy * np.abs(blow.v).max()
    )


@MANY
@given(SEEDS)
def test_a_little_more_restitution_changes_little(seed: int) -> None:
    """Were the law told by whether the k are equal, velocities would jump by their own size."""
    blow = Blow.random(seed)
    rng = np.random.default_rng(seed)
    k = np.full(blow.sides.size, rng.uniform(0.0, 0.99))
    more = k.copy()
    more[rng.integers(k.size)] += 1e-12
    one, other = (blow.after(blow.impulses(each)) for each in (k, more))
    N, _ = blow.normals
    change = 1e-12 * np.linalg.cond(N) ** 2 * np.linalg.cond(blow.M) + 2.0 * blow.accuracy
    np.testing.assert_allclose(one, other, rtol=0.0, atol=change * np.abs(blow.v).max())


def balls(masses: list[float], v: list[float], k: float, floor: bool = False) -> Blow:
    """Return balls one above the other that touch: each contact is that of a gap."""
    n = len(masses)
    W = np.eye(n) - np.eye(n, k=-1)  # height above the one below
    W = W if floor else W[1:]
    return Blow(np.diag(masses), W, -np.ones(len(W)), np.array(v))


def test_three_balls_that_touch_keep_their_energy() -> None:
    """The uppermost two exchange their velocities; the energy was tripled."""
    blow = balls([1.0, 1.0, 1.0], [-0.5, 1.0, -0.5], 1.0)
    after = blow.after(blow.impulses(np.ones(2)))
    np.testing.assert_allclose(after, [-0.5, -0.5, 1.0], rtol=0.0, atol=1e-15)
    assert blow.energy(after) == pytest.approx(0.75, rel=1e-15)


def test_a_ball_strikes_two_that_touch() -> None:
    """By the simultaneous law (-1/3, 2/3, 2/3), and not one after the other (0, 0, 1)."""
    blow = balls([1.0, 1.0, 1.0], [1.0, 0.0, 0.0], 1.0)
    after = blow.after(blow.impulses(np.ones(2)))
    np.testing.assert_allclose(after, [-1 / 3, 2 / 3, 2 / 3], rtol=0.0, atol=1e-15)


def test_what_happens_elsewhere_at_the_same_time_does_not_matter() -> None:
    """Two coupled elastic coordinates conserve their energy beside a third that does not."""
    mobility = np.array([[1.0, -0.8, 0.0], [-0.8, 1.0, 0.0], [0.0, 0.0, 2.0]])
    speeds = np.array([1.0, 0.7, 1.0])
    P = impulses(mobility, np.array([1.0, 1.0, 0.5]), np.arange(3), np.ones(3), speeds)
    lost = P[:2] @ speeds[:2] - 0.5 * P[:2] @ mobility[:2, :2] @ P[:2]
    assert lost == pytest.approx(0.0, abs=1e-14)
    assert P[2] == 1.5 / 2.0


def test_thousands_of_reflections_keep_the_energy() -> None:
    """A light ball between a floor and one a million times heavier."""
    blow = balls([1.0, 1e6], [0.0, -1.0], 1.0, floor=True)
    after = blow.after(blow.impulses(np.ones(2)))
    assert blow.energy(after) == pytest.approx(blow.energy(blow.v), rel=1e-9)
    assert (blow.rows @ after).max() <= 1e-9
    assert after[1] > 0.9


@pytest.mark.parametrize("coupling", [0.0, 0.5])
def test_walls_that_leave_no_room_take_the_velocity(coupling: float) -> None:
    """Reflections went to and fro ten thousand times, and left their roundings as velocities."""
    # Only y = 0 has W y <= 0 in its first two coordinates; the third is free.
    W = np.array([[1.0, 0.0, 0.0], [-2.0, -1.0, 0.0], [3.0, 3.0, 0.0]])
    M = np.array([[1.0417, coupling, 0.0], [coupling, 1.7745, 0.0], [0.0, 0.0, 1.3]])
    blow = Blow(M, W, np.ones(3), np.array([-1.775, -0.887, 0.4]))
    P = blow.impulses(np.ones(3))
    np.testing.assert_allclose(blow.after(P), [0.0, 0.0, 0.4], rtol=0.0, atol=1e-14)
    assert P.max() < 10.0 * np.abs(M @ blow.v).max()
