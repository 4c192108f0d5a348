"""Resonances where numbers go wrong: every one is there, to its stated error."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from tests.solvers.stress.structures import GAP, full, springs
from vibroimpact_solvers import presets, resonances
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.resonances import Problem, Result

RATIOS = [1e-12, 1e-6, 1e6, 1e12]
CONSTRAINTS = {
    "one": Constraint.at(1, GAP),
    "relative": Constraint((1, 2), (1.0, -1.0), GAP, GAP),
    "uneven": Constraint((0, 2), (1.0, 1e-6), GAP, GAP),
}
direction = pytest.mark.parametrize("direction", list(CONSTRAINTS))


def solve(system: System, odd_max: int = 1) -> Result:
    problem = Problem(system, 0, odd_max)
    return resonances.solve(problem, resonances.plan(problem))


def exact(system: System) -> list[tuple[Any, Any]]:
    """Return natural frequencies with the coordinate fixed, and their relative excitation."""
    M, K = (mpmath.matrix(a.to_dense().tolist()) for a in (system.M, system.K))
    row = [mpmath.mpf(float(w)) for w in system.directions((0,))[0]]
    n, fixed = system.n, max(range(system.n), key=lambda i: abs(row[i]))
    free = [i for i in range(n) if i != fixed]
    Z = mpmath.zeros(n, n - 1)
    for column, i in enumerate(free):
        Z[i, column] = 1
        Z[fixed, column] = -row[i] / row[fixed]
    moved = mpmath.zeros(n, 1)
    moved[fixed] = 1 / row[fixed]
    inverse = mpmath.cholesky(Z.T * M * Z) ** -1
    values, Q = mpmath.eigsy(inverse * (Z.T * K * Z) * inverse.T)
    modes = inverse.T * Q
    stiff, heavy = modes.T * (Z.T * (K * moved)), modes.T * (Z.T * (M * moved))
    push = [abs(stiff[j] - values[j] * heavy[j]) for j in range(n - 1)]
    none = max(abs(value) for value in values) * mpmath.mpf(10) ** (-mpmath.mp.dps // 2)
    return [
        (mpmath.sqrt(value), size / max(push))
        for value, size in zip(values, push, strict=True)
        if value > none
    ]


def check(system: System) -> Result:
    """Find the resonances, and for each one that of extended precision, and the other way."""
    result = solve(system)
    assert np.isfinite(result.natural).all()
    with mpmath.workdps(60):
        expected = exact(system)
        for root, excited in expected:
            stated = [
                error
                for computed, error in zip(result.natural, result.error_relative, strict=True)
                if abs(mpmath.mpf(float(computed)) / root - 1) <= error
            ]
            # What is excited by less than rounding may be left out.
            assert stated or excited < 1e-9, f"{float(root)!r} is missing ({float(excited):.1e})"
        for computed, error in zip(result.natural, result.error_relative, strict=True):
            near = [root for root, _ in expected if abs(float(computed) / root - 1) <= error]
            assert near or error >= 1.0, f"{float(computed)!r} is none"
        assert result.natural.size <= len(expected)
    return result


class TestRatios:
    @direction
    @pytest.mark.parametrize("ratio", RATIOS)
    @pytest.mark.parametrize("place", [1, 3])
    def test_masses(self, direction: str, ratio: float, place: int) -> None:
        masses = np.ones(5)
        masses[place] = ratio
        check(springs(masses, np.ones(6), [CONSTRAINTS[direction]]))

    @direction
    @pytest.mark.parametrize("ratio", RATIOS)
    def test_stiffnesses(self, direction: str, ratio: float) -> None:
        stiffnesses = np.ones(6)
        stiffnesses[4] = ratio
        check(springs(np.ones(5), stiffnesses, [CONSTRAINTS[direction]]))


class TestSpectra:
    @direction
    def test_repeated(self, direction: str) -> None:
        R = np.linalg.qr(np.random.default_rng(2).standard_normal((5, 5)))[0]
        K = R @ np.diag([1.0, 1.0, 4.0, 4.0, 4.0]) @ R.T
        check(full(np.eye(5), K, [CONSTRAINTS[direction]]))

    @direction
    def test_clustered(self, direction: str) -> None:
        R = np.linalg.qr(np.random.default_rng(3).standard_normal((5, 5)))[0]
        K = R @ np.diag([1.0, 1.0 + 1e-13, 1.0 - 1e-10, 4.0, 4.0 + 1e-14]) @ R.T
        check(full(np.eye(5), K, [CONSTRAINTS[direction]]))

    @direction
    def test_rigid_body(self, direction: str) -> None:
        check(springs(np.ones(5), [0.0, 1.0, 1.0, 1.0, 1.0, 0.0], [CONSTRAINTS[direction]]))

    @direction
    def test_almost_singular_mass(self, direction: str) -> None:
        M = np.full((3, 3), 1.0 - 1e-8) + 1e-8 * np.eye(3)
        check(full(M, np.diag([1.0, 2.0, 3.0]), [CONSTRAINTS[direction]]))

    @pytest.mark.parametrize(("name", "n"), [("closed form", 5000), ("tridiagonal", 1000)])
    def test_thousands(self, name: str, n: int) -> None:
        """Both parts are chains between fixed ends, eq. 10.70-10.72."""
        fixed = n // 3
        constraints = [Constraint.at(fixed, GAP)]
        system = presets.chain(n, constraints)
        if name == "tridiagonal":
            system = springs(np.ones(n), np.ones(n + 1), constraints)
        result = solve(system)
        assert result.part is not None
        with mpmath.workdps(30):
            for part, m in ((0, fixed), (1, n - fixed - 1)):
                computed = np.sort(result.natural[result.part == part])
                error = result.error_relative[result.part == part].max()
                assert computed.size == m
                for j in (1, 2, m // 2, m - 1, m):
                    root = 2 * mpmath.sin(j * mpmath.pi / (2 * (m + 1)))
                    assert abs(float(computed[j - 1]) / root - 1) <= error


class TestWalls:
    @pytest.mark.parametrize("size", [1e-90, 1e-12, 1e12, 1e90])
    def test_gaps_and_restitutions_play_no_part(self, size: float) -> None:
        for k in (0.0, 1.0):
            system = springs(np.ones(5), np.ones(6), [Constraint((1,), (1.0,), size, size, k)])
            one = springs(np.ones(5), np.ones(6), [CONSTRAINTS["one"]])
            np.testing.assert_array_equal(solve(system).natural, solve(one).natural)

    @pytest.mark.parametrize("scale", [1e-8, 1e8])
    def test_frequencies_scale(self, scale: float) -> None:
        system = springs(np.ones(5), scale**2 * np.ones(6), [CONSTRAINTS["one"]])
        check(system)


def test_denormal_springs_are_nothing() -> None:
    stiffnesses = np.array([1.0, 1.0, 1.0, 5e-324, 1.0, 1.0])
    with_it = springs(np.ones(5), stiffnesses, [CONSTRAINTS["one"]])
    without = springs(np.ones(5), np.where(stiffnesses == 1.0, 1.0, 0.0), [CONSTRAINTS["one"]])
    np.testing.assert_array_equal(solve(with_it).natural, solve(without).natural)
