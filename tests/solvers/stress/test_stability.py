"""Growth of deviations where numbers go wrong, against half-period maps in extended precision."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from tests.solvers.stress import extended
from tests.solvers.stress.structures import FAMILIES, GAP, full, solve, springs
from vibroimpact_solvers import existence_bands, presets, spectrum
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.model import Constraint, System

ONE = (Constraint.at(1, GAP),)


def radius(system: System, natural: extended.Modes, omega: Any) -> Any:
    """Return the spectral radius of S Phi with mirror image, for one struck constraint.

    In modal coordinates, with the saltation matrix of an elastic impact at the upper wall.
    """
    motion = extended.solution(system, natural, omega, [0])
    count = len(natural.eigenvalues)
    row = natural.seen[0]
    mobility = sum(a * a for a in row)
    place, rate = mpmath.matrix(count, 1), mpmath.matrix(count, 1)
    for j, value in enumerate(natural.eigenvalues):
        mu, push = value / omega**2, row[j] * motion.plus[0] / omega
        if value == 0:
            place[j], rate[j] = row[j] * motion.plus[0] / omega**2, push
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
    transition = mpmath.zeros(2 * count)
    t = 2 / omega
    for j, value in enumerate(natural.eigenvalues):
        w = mpmath.sqrt(value)
        cosine = mpmath.re(mpmath.cos(w * t))
        sine = t if value == 0 else mpmath.re(mpmath.sin(w * t) / w)
        transition[j, j] = transition[count + j, count + j] = cosine
        transition[j, count + j], transition[count + j, j] = sine, -value * sine
    values = mpmath.eig(S * transition, left=False, right=False)
    return max(abs(value) for value in values)


def radius_of_period(system: System, natural: extended.Modes, omega: Any) -> Any:
    """Return the root of the spectral radius over a whole period, for any family.

    Impacts struck together are taken one after the other, as they commute.
    """
    every = range(len(system.constraints))
    motion = extended.solution(system, natural, omega, every)
    count = len(natural.eigenvalues)
    values = mpmath.matrix(natural.eigenvalues)
    load = mpmath.matrix(natural.load)

    def field(state: Any) -> Any:
        push = [load[j] - values[j] * state[j] for j in range(count)]
        return mpmath.matrix([*(state[count + j] for j in range(count)), *push])

    def strike(state: Any, X: Any, walls: Any) -> tuple[Any, Any]:
        for a in (a for a in every if walls[a] is not None):
            row = natural.seen[a]
            mobility = mpmath.fdot(row, row)
            R = mpmath.eye(2 * count)
            for i in range(count):
                for j in range(count):
                    R[count + i, count + j] -= 2 * row[i] * row[j] / mobility
            after = R * state
            speed = mpmath.fdot(row, [state[count + j] for j in range(count)])
            jump, S = field(after) - R * field(state), R.copy()
            for i in range(2 * count):
                for j in range(count):
                    S[i, j] += jump[i] * row[j] / speed
            state, X = after, S * X
        return state, X

    def at(tau: int, sign: int) -> Any:
        places = [motion._modal(j, mpmath.mpf(tau)) for j in range(count)]
        rates = [mpmath.diff(lambda s, j=j: motion._modal(j, s), tau) for j in range(count)]
        return mpmath.matrix([*places, *(sign * omega * rate for rate in rates)])

    transition, t = mpmath.zeros(2 * count), 2 / omega
    for j in range(count):
        w = mpmath.sqrt(values[j])
        transition[j, j] = transition[count + j, count + j] = mpmath.re(mpmath.cos(w * t))
        sine = t if w == 0 else mpmath.re(mpmath.sin(w * t) / w)
        transition[j, count + j], transition[count + j, j] = sine, -values[j] * sine
    _, X = strike(at(1, 1), transition, [c.upper for c in system.constraints])
    _, X = strike(at(-1, -1), transition * X, [c.lower for c in system.constraints])
    multipliers = mpmath.eig(X, left=False, right=False)
    return mpmath.sqrt(max(abs(value) for value in multipliers))


def check(system: System, Omega: Any, radius: Any = radius, within: float | None = 1e-6) -> None:
    """Compare the radii of existing solutions: within their stated errors, and a bound."""
    result = solve(system, Omega, ["impulse", "exists", "stability"])
    assert result.stability is not None
    assert result.exists is not None
    assert result.exists.any()
    assert np.isfinite(result.stability[result.exists]).all()
    assert np.isnan(result.stability[~result.exists]).all()
    assert result.stability_error is not None
    assert (np.isnan(result.stability_error) == ~result.exists).all()
    with mpmath.workdps(50):
        natural = extended.modes(system)
        for f in np.flatnonzero(result.exists):
            value, computed = float(result.Omega[f]), float(result.stability[f])
            exact = radius(system, natural, extended.omega_of(value))
            error = abs(computed / exact - 1)
            assert error <= result.stability_error[f] / computed, f"at {value!r}: {computed!r}"
            # A double multiplier splits by the root of rounding.
            assert within is None or error < within, f"at {value!r}: {computed!r}"


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
        result = solve(system, [2.1, 3.0], ["stability", "exists"])
        other = solve(
            presets.chain(60, [Constraint.at(30, GAP)]), [2.1, 3.0], ["stability", "exists"]
        )
        np.testing.assert_allclose(result.stability, other.stability, rtol=1e-6)


class TestFamilies:
    """Motions that are not mirrored, and simultaneous impacts: maps of the whole period."""

    @pytest.mark.parametrize("ratio", [1e-12, 1.0, 1e12])
    @pytest.mark.parametrize("name", ["coupled", "asymmetric", "unilateral", "relative", "three"])
    def test_stiffnesses(self, name: str, ratio: float) -> None:
        three = tuple(Constraint.at(i, GAP * (1 + i / 10)) for i in range(3))
        constraints = {"three": three, **FAMILIES}[name]
        stiffnesses = np.ones(6)
        stiffnesses[2] = ratio
        system = springs(np.ones(5), stiffnesses, constraints)
        roots = spectrum.spectrum(system).roots
        Omega = roots[-1] * np.array([1.3, 2.5, 1e3])
        if name == "unilateral":
            # From the wall and back lasts half to one natural period.
            Omega = np.outer(roots[:3], [1.1, 1.6]).ravel()
        # A stiff spring between slow masses turns phases that roundings of its frequency tell.
        check(system, Omega, radius_of_period, None if name == "unilateral" else 1e-6)

    def test_loads(self) -> None:
        force = np.array([0.0, 0.1, 0.0, -0.05])
        system = springs(np.ones(4), np.ones(5), FAMILIES["asymmetric"], force)
        check(system, [2.1, 3.0, 9.0], radius_of_period)


class TestFrequencies:
    def test_bands_from_edge_to_edge(self) -> None:
        """Between edges, where motions graze, and poles."""
        check(springs(np.ones(3), np.ones(4), ONE), np.linspace(0.78, 2.2, 48))

    def test_multipliers_that_meet(self) -> None:
        """Radii leave 1 like a root: closest to where they do, most digits are gone."""
        system = springs(np.ones(3), np.ones(4), ONE)
        low, high = 2.2, 4.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            radius = solve(system, middle, ["stability"]).stability
            assert radius is not None
            low, high = (middle, high) if radius[0] > 1.0 + 1e-12 else (low, middle)
        check(system, high * (1.0 + np.array([-1e-6, -1e-9, -1e-12, 0.0, 1e-12, 1e-9, 1e-6])))

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


def test_thousands_are_refused() -> None:
    """The map of 10,000 deviations would take gigabytes and hours for each motion."""
    system = presets.chain(5000, [Constraint.at(1666, GAP)])
    with pytest.raises(PlanError, match="10000 deviations"):
        solve(system, 3.0, ["stability"])
    problem = existence_bands.Problem(
        system, 3.0, 4.0, active=(0,), outputs=frozenset({"bands", "stability"})
    )
    with pytest.raises(PlanError, match="10000 deviations") as refused:
        existence_bands.plan(problem)
    assert refused.value.pointer == ("outputs",)


def test_denormal_springs_are_nothing() -> None:
    radii = []
    for value in (5e-324, 0.0):
        system = springs(np.ones(3), [1.0, 1.0, value, 1.0], ONE)
        radii.append(solve(system, [1.7, 2.5], ["stability"]).stability)
    np.testing.assert_array_equal(radii[0], radii[1])
