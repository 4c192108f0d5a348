"""Growth of deviations where numbers go wrong, against half-period maps in extended precision."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from tests.solvers.stress import extended
from tests.solvers.stress.structures import GAP, full, solve, springs
from vibroimpact_solvers import presets, spectrum
from vibroimpact_solvers.model import Constraint, System

ONE = (Constraint.at(1, GAP),)


def radius(system: System, natural: extended.Modes, omega: Any) -> Any:
    """Return the spectral radius of S Phi with mirror image, for one struck constraint.

    In modal coordinates, with the saltation matrix of an elastic impact at the upper wall.
    """
    member = extended.member(system, natural, omega, [0])
    count = len(natural.eigenvalues)
    row = natural.seen[0]
    mobility = sum(a * a for a in row)
    place, rate = mpmath.matrix(count, 1), mpmath.matrix(count, 1)
    for j, value in enumerate(natural.eigenvalues):
        mu, push = value / omega**2, row[j] * member.plus[0] / omega
        if value == 0:
            place[j], rate[j] = row[j] * member.plus[0] / omega**2, push
            continue
        g = mpmath.sqrt(mu)
        place[j] = mpmath.re(push / omega * mpmath.tan(g) / g)
        rate[j] = push
    before = mpmath.matrix([*place, *rate])
    after = before.copy()
    speed = sum(row[j] * rate[j] for j in range(count))
    for j in range(count):
        after[count + j] -= 2 * row[j] * speed / mobility

    def field(state: Any) -> Any:
        still = [state[count + j] for j in range(count)]
        return mpmath.matrix([*still, *(-natural.eigenvalues[j] * state[j] for j in range(count))])

    R = mpmath.eye(2 * count)
    for i in range(count):
        for j in range(count):
            R[count + i, count + j] -= 2 * row[i] * row[j] / mobility
    jump = field(after) - R * field(before)
    S = R.copy()
    for i in range(2 * count):
        for j in range(count):
            S[i, j] += jump[i] * row[j] / speed
    flight = mpmath.zeros(2 * count)
    t = 2 / omega
    for j, value in enumerate(natural.eigenvalues):
        w = mpmath.sqrt(value)
        cosine = mpmath.re(mpmath.cos(w * t))
        sine = t if value == 0 else mpmath.re(mpmath.sin(w * t) / w)
        flight[j, j] = flight[count + j, count + j] = cosine
        flight[j, count + j], flight[count + j, j] = sine, -value * sine
    values = mpmath.eig(S * flight, left=False, right=False)
    return max(abs(value) for value in values)


def check(system: System, Omega: Any) -> None:
    """Compare the radii of members that exist."""
    result = solve(system, Omega, ["impulse", "exists", "stability"])
    assert result.stability is not None
    assert result.exists is not None
    assert result.exists.any()
    assert np.isfinite(result.stability[result.exists]).all()
    assert np.isnan(result.stability[~result.exists]).all()
    with mpmath.workdps(50):
        natural = extended.modes(system)
        for f in np.flatnonzero(result.exists):
            value, found = float(result.Omega[f]), float(result.stability[f])
            exact = radius(system, natural, extended.omega_of(value))
            # A double multiplier splits by the root of rounding.
            assert abs(found / exact - 1) < 1e-6, f"at {value!r}: {found!r}"


class TestRatios:
    @pytest.mark.parametrize("ratio", [1e-12, 1e-6, 1e6, 1e12])
    @pytest.mark.parametrize("place", [0, 1])
    def test_masses(self, ratio: float, place: int) -> None:
        masses = np.ones(3)
        masses[place] = ratio
        system = springs(masses, np.ones(4), ONE)
        top = spectrum.spectrum(system).largest_frequency
        check(system, top * np.array([1.01, 1.3, 2.5, 1e3]))

    @pytest.mark.parametrize("ratio", [1e-12, 1e-6, 1e6, 1e12])
    def test_stiffnesses(self, ratio: float) -> None:
        stiffnesses = np.ones(4)
        stiffnesses[1] = ratio
        system = springs(np.ones(3), stiffnesses, ONE)
        top = spectrum.spectrum(system).largest_frequency
        check(system, top * np.array([1.01, 1.3, 2.5, 1e3]))


class TestSpectra:
    def test_repeated(self) -> None:
        R = np.linalg.qr(np.random.default_rng(2).standard_normal((4, 4)))[0]
        K = R @ np.diag([1.0, 1.0, 4.0, 4.0]) @ R.T
        check(full(np.eye(4), K, ONE), [2.02, 2.5, 9.0])

    def test_clustered(self) -> None:
        R = np.linalg.qr(np.random.default_rng(3).standard_normal((4, 4)))[0]
        K = R @ np.diag([1.0, 1.0 + 1e-13, 1.0 - 1e-10, 4.0]) @ R.T
        check(full(np.eye(4), K, ONE), [2.02, 2.5, 9.0])

    def test_rigid_body(self) -> None:
        check(springs(np.ones(3), [0.0, 1.0, 1.0, 0.0], ONE), [1.75, 2.5, 9.0, 1e4])

    @pytest.mark.parametrize("n", [100, 400])
    def test_long_chains(self, n: int) -> None:
        """Almost the same for any length, as the localized mode does not reach the ends."""
        system = presets.chain(n, [Constraint.at(n // 2, GAP)])
        found = solve(system, [2.1, 3.0], ["stability", "exists"])
        other = solve(
            presets.chain(60, [Constraint.at(30, GAP)]), [2.1, 3.0], ["stability", "exists"]
        )
        np.testing.assert_allclose(found.stability, other.stability, rtol=1e-6)


class TestFrequencies:
    @pytest.mark.parametrize("exponent", [1, 4, 8])
    def test_far_above(self, exponent: int) -> None:
        check(springs(np.ones(3), np.ones(4), ONE), [2.0 * 10.0**exponent])

    @pytest.mark.parametrize("size", [1e-12, 1e12])
    def test_gaps(self, size: float) -> None:
        """The growth does not depend on the gap."""
        Omega = [1.9, 2.1, 3.0]
        one = solve(springs(np.ones(3), np.ones(4), ONE), Omega, ["stability", "exists"])
        scaled = springs(np.ones(3), np.ones(4), [Constraint.at(1, GAP * size)])
        other = solve(scaled, Omega, ["stability", "exists"])
        np.testing.assert_allclose(other.stability, one.stability, rtol=1e-7)


def test_the_order_of_three_impacts_decides() -> None:
    """Impacts that couple through M have no radius, and the plan says why."""
    M = np.eye(3) + 0.2
    constraints = [Constraint.at(i, GAP) for i in range(3)]
    result = solve(full(M, np.diag([1.0, 2.0, 3.0]), constraints), [9.0], ["stability", "exists"])
    assert result.stability is None or np.isnan(result.stability).all()
