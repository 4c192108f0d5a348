"""Existence bands where numbers go wrong: every verdict is that of extended precision."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from tests.solvers.stress import extended
from tests.solvers.stress.structures import FAMILIES, GAP, full, springs
from vibroimpact_solvers import existence_bands, presets, spectrum
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.existence_bands import Problem, Result
from vibroimpact_solvers.model import Constraint, System

ONE = (Constraint.at(1, GAP),)
BESIDE = (Constraint.at(1, GAP), Constraint.at(3, 1.2 * GAP))
RATIOS = [1e-12, 1e-6, 1e6, 1e12]


def solve(system: System, start: float, stop: float, **more: Any) -> Result:
    problem = Problem(system, start, stop, active=(0,), **more)
    return existence_bands.solve(problem, existence_bands.plan(problem))


def verdict(system: System, natural: extended.Modes, Omega: float, times: int = 161) -> float:
    """Return the smallest relative margin of the exact solution; negative for a phantom."""
    exact = extended.solution(system, natural, extended.omega_of(Omega), [0])
    margins = [mpmath.sign(exact.plus[0]), mpmath.sign(exact.velocity_into(0, 1))]
    for a, constraint in enumerate(system.constraints):
        assert constraint.upper is not None
        # The struck limit is reached, not passed, at the end.
        for tau in np.linspace(0.0, 1.0 if a else 0.999, times):
            y = abs(exact.coordinate(a, mpmath.mpf(float(tau))))
            margins.append(1 - y / constraint.upper)
    return float(min(margins))


def check(
    system: System, start: float, stop: float, natural: Any = None, points: int = 6
) -> Result:
    """Find bands and compare verdicts inside and outside of them with extended precision."""
    result = solve(system, start, stop)
    assert result.band_start is not None
    assert result.band_stop is not None
    assert result.band_edge_error is not None
    assert np.isfinite(result.band_start).all()
    assert np.isfinite(result.band_edge_error).all()
    assert (result.band_stop[:-1] <= result.band_start[1:]).all()
    bands = list(zip(result.band_start, result.band_stop, result.band_edge_error, strict=True))
    with mpmath.workdps(60):
        natural = natural or extended.modes(system)
        for low, high, error in bands[:: max(1, len(bands) // points)]:
            if high - low < 1e-6 * high:
                continue
            inside = np.array([0.02, 0.5, 0.98]) * (high - low) + low
            for Omega in inside[(inside > low + error) & (inside < high - error)]:
                assert verdict(system, natural, Omega) > -1e-9, f"no solution at {Omega!r}"
        random = np.random.default_rng(5)
        for Omega in np.exp(random.uniform(np.log(start), np.log(stop), 3 * points)):
            near = any(
                low - 1e-6 * low - error <= Omega <= high + 1e-6 * high + error
                for low, high, error in bands
            )
            unsure = any(
                low <= Omega <= high
                for low, high in zip(result.unresolved_start, result.unresolved_stop, strict=True)
            )
            if not near and not unsure:
                assert verdict(system, natural, Omega) < 1e-9, f"a band is missing at {Omega!r}"
    return result


def check_both_ends(system: System) -> None:
    """Look about the highest natural frequency, and closely below the lowest."""
    roots = spectrum.spectrum(system).roots
    check(system, 0.5 * float(roots[-1]), 1.2 * float(roots[-1]))
    # Poles of all natural frequencies lie there, at distances like the ratio of both ends.
    start = 0.9 * float(roots[0])
    check(system, start, start * (1.0 + 4.0 * float(roots[0] / roots[-1])), points=2)


class TestRatios:
    @pytest.mark.parametrize("ratio", RATIOS)
    @pytest.mark.parametrize("constraints", [ONE, BESIDE], ids=["alone", "beside another"])
    def test_masses(self, ratio: float, constraints: Any) -> None:
        masses = np.ones(4)
        masses[2] = ratio
        system = springs(masses, np.ones(5), constraints)
        check_both_ends(system)

    @pytest.mark.parametrize("ratio", RATIOS)
    def test_stiffnesses(self, ratio: float) -> None:
        stiffnesses = np.ones(5)
        stiffnesses[2] = ratio
        system = springs(np.ones(4), stiffnesses, BESIDE)
        check_both_ends(system)


class TestSpectra:
    def test_repeated(self) -> None:
        R = np.linalg.qr(np.random.default_rng(2).standard_normal((4, 4)))[0]
        check(full(np.eye(4), R @ np.diag([1.0, 1.0, 4.0, 4.0]) @ R.T, BESIDE), 0.4, 2.6)

    def test_clustered(self) -> None:
        R = np.linalg.qr(np.random.default_rng(3).standard_normal((4, 4)))[0]
        K = R @ np.diag([1.0, 1.0 + 1e-13, 1.0 - 1e-10, 4.0]) @ R.T
        check(full(np.eye(4), K, BESIDE), 0.4, 2.6)

    def test_rigid_body(self) -> None:
        check(springs(np.ones(4), [0.0, 1.0, 1.0, 1.0, 0.0], BESIDE), 0.2, 2.6)

    def test_long_chain(self) -> None:
        system = presets.chain(200, [Constraint.at(66, GAP)])
        with mpmath.workdps(40):
            natural = extended.chain_modes(system)
        result = solve(system, 1.9, 2.05)
        assert result.band_start is not None
        assert result.band_start.size > 3
        with mpmath.workdps(40):
            for low, high in list(zip(result.band_start, result.band_stop, strict=True))[::2]:
                if high - low > 1e-6:
                    assert verdict(system, natural, 0.5 * (low + high), 17) > -1e-9

    @pytest.mark.parametrize("n", [1000, 5000])
    def test_sign_bands_of_longer_chains(self, n: int) -> None:
        """Above the spectrum every solution exists; just below it the last band ends at a pole."""
        system = presets.chain(n, [Constraint.at(n // 3, GAP)])
        top = spectrum.spectrum(system).largest_frequency
        result = solve(system, 1.00001 * top, 1.5 * top)
        np.testing.assert_allclose(result.band_start, [1.00001 * top])
        np.testing.assert_allclose(result.band_stop, [1.5 * top])


class TestFrequencies:
    @pytest.mark.parametrize("factor", [1.5, 1e2, 1e8])
    def test_above_the_spectrum(self, factor: float) -> None:
        system = springs(np.ones(4), np.ones(5), ONE)
        result = check(system, factor * 2.0, factor * 3.0)
        assert result.band_start is not None
        assert result.band_start.size == 1

    def test_far_below_the_spectrum(self) -> None:
        check(springs(np.ones(2), np.ones(3), ONE), 0.01, 0.0103)

    def test_edges_at_poles_to_the_stated_error(self) -> None:
        system = presets.chain(13, [Constraint.at(5, GAP)])
        result = solve(system, 0.2, 3.0)
        assert result.band_start is not None
        assert result.band_start_reason is not None
        with mpmath.workdps(40):
            roots = [mpmath.sqrt(value) for value in extended.chain_modes(system).eigenvalues]
            poles = [root / k for root in roots for k in range(1, 20, 2)]
            for edge, reason, error in zip(
                result.band_start, result.band_start_reason, result.band_edge_error, strict=True
            ):
                if reason == existence_bands.Edge.NEGATIVE_IMPULSE:
                    assert min(abs(pole - edge) for pole in poles) <= error


class TestWalls:
    @pytest.mark.parametrize("size", [1e-90, 1e-12, 1e12, 1e90])
    def test_gaps(self, size: float) -> None:
        """Bands do not depend on the size of gaps."""
        scaled = [Constraint.at(c.dofs[0], c.upper * size) for c in BESIDE if c.upper is not None]
        one = solve(springs(np.ones(4), np.ones(5), BESIDE), 0.3, 2.5)
        other = solve(springs(np.ones(4), np.ones(5), scaled), 0.3, 2.5)
        assert one.band_start is not None
        assert one.band_start.size > 3
        np.testing.assert_allclose(other.band_start, one.band_start, rtol=1e-10)
        np.testing.assert_allclose(other.band_stop, one.band_stop, rtol=1e-10)

    @pytest.mark.parametrize("ratio", [1e-12, 1e12])
    def test_a_far_and_a_near_limit_beside(self, ratio: float) -> None:
        constraints = (ONE[0], Constraint.at(3, GAP * ratio))
        result = check(springs(np.ones(4), np.ones(5), constraints), 0.4, 2.5)
        assert result.band_start is not None
        assert (result.band_start.size == 0) is (ratio < 1)

    @pytest.mark.parametrize("offset", [-1e-15, 1e-15])
    def test_a_limit_that_is_grazed_at_an_edge(self, offset: float) -> None:
        """A limit exactly at the reach of one solution: no wrong proof on either side."""
        system = springs(np.ones(4), np.ones(5), ONE)
        with mpmath.workdps(60):
            seen = springs(np.ones(4), np.ones(5), [*ONE, Constraint.at(3, 1.0)])
            natural = extended.modes(seen)
            exact = extended.solution(seen, natural, extended.omega_of(2.1), [0])
            reach = max(abs(exact.coordinate(1, mpmath.mpf(k) / 400)) for k in range(401))
        limit = Constraint.at(3, float(reach) * (1.0 + offset))
        check(springs(np.ones(4), np.ones(5), [*ONE, limit]), 1.8, 2.6)
        assert solve(system, 1.95, 2.6).band_start is not None


@pytest.mark.parametrize("family", ["coupled", "asymmetric", "unilateral", "mixed", "relative"])
@pytest.mark.parametrize("ratio", [1e-12, 1e12])
def test_other_families_agree_with_their_solutions(family: str, ratio: float) -> None:
    """What is searched is not proved, and says so; solutions in the middle exist."""
    masses = np.ones(5)
    masses[0] = ratio
    system = springs(masses, np.ones(6), FAMILIES[family])
    top = spectrum.spectrum(system).largest_frequency
    start, stop = (0.8, 2.2) if ratio > 1 else (0.9 * top, 1.3 * top)
    problem = Problem(system, start, stop)
    result = existence_bands.solve(problem, existence_bands.plan(problem))
    assert result.band_certified is not None
    assert family == "relative" or not result.band_certified.any()
    with mpmath.workdps(60):
        natural = extended.modes(system)
        every = range(len(system.constraints))
        for low, high in zip(result.band_start, result.band_stop, strict=True):
            if high - low < 1e-4 * high:
                continue
            exact = extended.solution(
                system, natural, extended.omega_of(float(0.5 * (low + high))), every
            )
            struck = [
                p
                for a, c in enumerate(system.constraints)
                for wall, p in ((c.upper, exact.plus[a]), (c.lower, exact.minus[a]))
                if wall is not None
            ]
            assert min(struck) > 0


def test_ranges_beyond_double_precision_are_refused() -> None:
    system = springs(np.ones(4), np.ones(5), ONE)
    for start, stop in ((5e-324, 1.0), (1e-200, 1.0)):
        with pytest.raises(ModelError) as caught:
            Problem(system, start, stop)
        assert caught.value.pointer[0] == "frequency"
