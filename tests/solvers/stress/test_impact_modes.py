"""Impact modes where numbers go wrong: right to the stated error, or refused with a reason."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from tests.solvers.stress import extended
from tests.solvers.stress.structures import FAMILIES, GAP, check, full, solve, springs
from vibroimpact_solvers import presets, spectrum
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.impact_modes import Reason
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

RATIOS = [1e-12, 1e-6, 1e6, 1e12]
family = pytest.mark.parametrize("family", list(FAMILIES))


def among(system: System, count: int = 4) -> np.ndarray:
    """Return frequencies below, among and above the natural ones."""
    roots = spectrum.spectrum(system).roots
    swinging = roots[roots > 0.0]
    low, high = swinging[0], swinging[-1]
    random = np.random.default_rng(7)
    between = np.exp(random.uniform(np.log(low), np.log(high), count))
    return np.concatenate(
        [random.uniform(0.3, 1.2, count) * low, between, [1.1 * high, 1e3 * high]]
    )


class TestRatios:
    @family
    @pytest.mark.parametrize("ratio", RATIOS)
    @pytest.mark.parametrize("place", [1, 2])
    def test_masses(self, family: str, ratio: float, place: int) -> None:
        masses = np.ones(5)
        masses[place] = ratio
        system = springs(masses, np.ones(6), FAMILIES[family])
        check(system, among(system))

    @family
    @pytest.mark.parametrize("ratio", RATIOS)
    def test_stiffnesses(self, family: str, ratio: float) -> None:
        stiffnesses = np.ones(6)
        stiffnesses[2] = ratio
        system = springs(np.ones(5), stiffnesses, FAMILIES[family])
        check(system, among(system))

    @family
    @pytest.mark.parametrize("ratio", [1e-12, 1e12])
    def test_full_matrices(self, family: str, ratio: float) -> None:
        R = np.random.default_rng(1).standard_normal((5, 5))
        system = full(R @ R.T, R @ np.diag([1.0, ratio, 2.0, 3.0, 4.0]) @ R.T, FAMILIES[family])
        check(system, among(system))

    def test_almost_singular_mass(self) -> None:
        """Condition 1e10: errors of the natural modes are those of M."""
        M = np.array([[1.0, 1.0 - 1e-10], [1.0 - 1e-10, 1.0]])
        system = full(M, np.diag([2.0, 3.0]), [Constraint.at(0, GAP)])
        check(system, [0.3, 0.9, 1.3, 2.0, 1e3, 1e6])


class TestSpectra:
    @family
    def test_repeated(self, family: str) -> None:
        R = np.linalg.qr(np.random.default_rng(2).standard_normal((5, 5)))[0]
        K = R @ np.diag([1.0, 1.0, 1.0, 4.0, 4.0]) @ R.T
        check(full(np.eye(5), K, FAMILIES[family]), [0.1, 0.3, 0.77, 0.9999999, 1.5, 2.5, 9.0])

    @family
    def test_clustered(self, family: str) -> None:
        R = np.linalg.qr(np.random.default_rng(3).standard_normal((5, 5)))[0]
        K = R @ np.diag([1.0, 1.0 + 1e-13, 1.0 - 1e-10, 4.0, 4.0 + 1e-14]) @ R.T
        check(full(np.eye(5), K, FAMILIES[family]), [0.1, 0.3, 0.77, 0.9999999, 1.5, 2.5, 9.0])

    @family
    def test_rigid_body(self, family: str) -> None:
        system = springs(np.ones(5), [0.0, 1.0, 1.0, 1.0, 1.0, 0.0], FAMILIES[family])
        check(system, [1e-3, 0.1, 0.3, 0.77, 1.5, 2.5, 9.0, 1e4])

    @family
    def test_indefinite(self, family: str) -> None:
        K = np.diag([1.0, -1.0, 2.0, 3.0, -4.0]) + 0.1
        # cosh of 1e4 has 4343 digits; what is left of them here does not need more than 60.
        check(full(np.eye(5), K, FAMILIES[family]), [1e-2, 0.1, 0.3, 0.77, 1.5, 2.5, 9.0, 1e4])

    @pytest.mark.parametrize("family", ["odd", "coupled", "asymmetric"])
    def test_no_stiffness(self, family: str) -> None:
        check(springs(np.ones(5), np.zeros(6), FAMILIES[family]), [1e-6, 0.3, 1.5, 1e6])

    @pytest.mark.parametrize("n", [200, 5000])
    def test_long_chains(self, n: int) -> None:
        system = presets.chain(n, [Constraint.at(n // 3, GAP)])
        with mpmath.workdps(40):
            natural = extended.chain_modes(system)
        # The verdicts cost a sum over all modes at each of many times.
        Omega = [0.05, 0.77, 2.1] if n < 1000 else [0.05, 1.9]
        check(system, Omega, natural, digits=40, proofs=n < 1000, times=9)

    @pytest.mark.parametrize("n", [200, 1000])
    def test_long_chains_without_closed_form(self, n: int) -> None:
        """The same natural modes by the solver for tridiagonal matrices."""
        constraints = [Constraint.at(n // 3, GAP)]
        with mpmath.workdps(40):
            natural = extended.chain_modes(presets.chain(n, constraints))
        system = springs(np.ones(n), np.ones(n + 1), constraints)
        check(system, [0.05, 0.77, 1.9], natural, digits=40, proofs=False)
        dense = System(system.M, SymmetricMatrix.dense(system.K.to_dense()), system.constraints)
        check(dense, [0.05, 0.77, 1.9], natural, digits=40, proofs=False)


class TestFrequencies:
    @family
    def test_sixteen_decades(self, family: str) -> None:
        """1e-8 to 1e8 of the largest natural frequency."""
        if family == "relative":
            system = springs(np.ones(5), np.ones(6), FAMILIES[family])
            check(system, 10.0 ** np.arange(-8.0, 9.0), proofs=False)
            return
        system = presets.chain(5, FAMILIES[family])
        with mpmath.workdps(60):
            natural = extended.chain_modes(system)
        largest = spectrum.spectrum(system).largest_frequency
        check(system, largest * 10.0 ** np.arange(-8.0, 9.0), natural, proofs=False)

    @family
    @pytest.mark.parametrize("below", [1, 2, 3, 4, 101, 102])
    def test_poles(self, family: str, below: int) -> None:
        """Exactly at parts of the natural frequencies, in floating point, and next to them."""
        system = springs(np.ones(5), np.ones(6), FAMILIES[family])
        roots = spectrum.spectrum(system).roots / below
        beside = [np.nextafter(roots, 0.0), np.nextafter(roots, 9.0), roots * (1 + 1e-9)]
        check(system, np.concatenate([roots, *beside]), proofs=False)

    @pytest.mark.parametrize("below", [1, 3, 101])
    def test_impulses_vanish_at_poles(self, below: int) -> None:
        """The impulse passes zero there while the motion stays finite (eq. 10.53)."""
        system = presets.chain(13, [Constraint.at(5, GAP)])
        roots = spectrum.spectrum(system).roots
        participating = np.abs(np.sin(6 * np.pi * np.arange(1, 14) / 14)) > 1e-9
        Omega = roots[participating] / below
        result = solve(system, Omega, ["impulse", "shape", "energy"])
        assert (np.abs(result.impulse[:, 0]) < 1e-12 * GAP * Omega).all()
        np.testing.assert_allclose(result.shape[:, 5], GAP, rtol=1e-9)
        assert np.isfinite(result.energy).all()
        # All energy is in the mode that swings: (gap Omega_j / e_j)^2 / 2.
        natural = spectrum.spectrum(system)
        row = natural.rows(np.array([5]))[0][participating]
        expected = 0.5 * (GAP * roots[participating] / row) ** 2
        np.testing.assert_allclose(result.energy, expected, rtol=1e-9)


class TestWalls:
    @family
    @pytest.mark.parametrize("size", [1e-90, 1e-12, 1e12, 1e90])
    def test_gaps(self, family: str, size: float) -> None:
        """Impulses are proportional to the gaps, also where their squares are extreme."""
        scaled = [
            Constraint(
                c.dofs,
                c.weights,
                None if c.lower is None else c.lower * size,
                None if c.upper is None else c.upper * size,
            )
            for c in FAMILIES[family]
        ]
        check(springs(np.ones(5), np.ones(6), scaled), [0.3, 0.77, 1.5, 2.5, 9.0])

    @pytest.mark.parametrize("ratio", [1e-12, 1e12])
    def test_unequal_gaps(self, ratio: float) -> None:
        constraints = [Constraint((1,), (1.0,), GAP, GAP * ratio)]
        check(springs(np.ones(5), np.ones(6), constraints), [0.3, 0.77, 1.5, 2.5, 9.0])

    @pytest.mark.parametrize("lower", [0.0, -0.1, -0.2 * (1 - 1e-12)])
    def test_preload(self, lower: float) -> None:
        """Walls on one side of the rest position, down to no room at all."""
        constraints = [Constraint((1,), (1.0,), lower, GAP)]
        check(springs(np.ones(5), np.ones(6), constraints), [0.3, 0.77, 1.5, 2.5, 9.0])

    @family
    @pytest.mark.parametrize("load", [1e-12, 1.0, 1e6])
    def test_loads(self, family: str, load: float) -> None:
        force = load * np.array([0.0, 1.0, 0.0, -0.5, 0.0])
        system = springs(np.ones(5), np.ones(6), FAMILIES[family], force)
        check(system, [0.3, 0.77, 1.5, 2.5, 9.0])

    @pytest.mark.parametrize("restitution", [0.0, 1.0])
    def test_restitution_plays_no_part(self, restitution: float) -> None:
        constraint = Constraint((1,), (1.0,), GAP, GAP, restitution)
        system = springs(np.ones(5), np.ones(6), [constraint])
        assert (
            solve(system, [2.5]).impulse
            == solve(springs(np.ones(5), np.ones(6), [Constraint.at(1, GAP)]), [2.5]).impulse
        )

    def test_three_struck_at_once(self) -> None:
        constraints = [Constraint.at(dof, GAP * (1 + dof / 10)) for dof in (0, 2, 4)]
        check(springs(np.ones(5), np.ones(6), constraints), [0.3, 0.77, 1.5, 1.99, 2.5, 9.0])

    @pytest.mark.parametrize("angle", [1e-6, 1e-12])
    def test_almost_the_same_coordinate(self, angle: float) -> None:
        """Two constraints whose directions differ by an angle."""
        constraints = [Constraint.at(1, GAP), Constraint((1, 3), (1.0, angle), GAP, GAP)]
        check(springs(np.ones(5), np.ones(6), constraints), [0.77, 1.5, 2.5, 9.0], proofs=False)


class TestGrazing:
    """A limit beside the struck one, placed a hair below or above what the motion reaches."""

    Omega = 2.1

    def reach(self) -> Any:
        system = springs(np.ones(5), np.ones(6), [Constraint.at(1, GAP)])
        with mpmath.workdps(60):
            exact = extended.solution(
                system, extended.modes(system), extended.omega_of(self.Omega), [0]
            )
            seen = extended.modes(
                springs(np.ones(5), np.ones(6), [Constraint.at(1, GAP), Constraint.at(2, 1.0)])
            )
            both = extended.Solution(
                [exact.plus[0], mpmath.mpf(0)],
                [exact.minus[0], mpmath.mpf(0)],
                seen,
                exact.omega,
                exact.places,
            )
            return max(abs(both.coordinate(1, mpmath.mpf(k) / 200)) for k in range(201))

    @pytest.mark.parametrize("offset", [-1e-6, -1e-9, 1e-9, 1e-6, 1e-3])
    def test_neighbouring_limit(self, offset: float) -> None:
        limit = float(self.reach()) * (1.0 + offset)
        system = springs(np.ones(5), np.ones(6), [Constraint.at(1, GAP), Constraint.at(2, limit)])
        result = solve(system, self.Omega, active=(0,))
        assert result.exists[0] == (offset > 0)
        assert Reason(int(result.reason[0])) is (Reason.OK if offset > 0 else Reason.PENETRATION)

    @pytest.mark.parametrize("offset", [-1e-15, -1e-16, 1e-16, 1e-15])
    def test_the_last_bit_decides(self, offset: float) -> None:
        """Where doubles leave it open, ball arithmetic tells on which side the limit lies."""
        reach = self.reach()
        limit = float(reach) * (1.0 + offset)
        system = springs(np.ones(5), np.ones(6), [Constraint.at(1, GAP), Constraint.at(2, limit)])
        result = solve(system, self.Omega, active=(0,))
        assert result.certified[0]
        assert result.exists[0] == (mpmath.mpf(limit) >= reach)


class TestRefused:
    @pytest.mark.parametrize("gap", [5e-324, 1e-200, 1e200])
    def test_walls_whose_squares_are_no_numbers(self, gap: float) -> None:
        with pytest.raises(ModelError, match="distance") as caught:
            Constraint.at(0, gap)
        assert caught.value.pointer == ("gap",)

    @pytest.mark.parametrize("weight", [5e-324, 1e-200, 1e200])
    def test_weights(self, weight: float) -> None:
        with pytest.raises(ModelError, match="weight") as caught:
            Constraint((0, 1), (1.0, weight), GAP, GAP)
        assert caught.value.pointer == ("direction", "weights")

    @pytest.mark.parametrize("size", [5e-324, 1e-310, 1e-150, 1e150, 1e300])
    def test_matrices_and_loads(self, size: float) -> None:
        one = [Constraint.at(0, GAP)]
        for name, build in (
            ("M", lambda: springs([size, size], np.ones(3), one)),
            ("M", lambda: springs([1.0, size], np.ones(3), one)),
            ("K", lambda: springs(np.ones(2), np.full(3, size), one)),
            ("force", lambda: springs(np.ones(2), np.ones(3), one, np.array([0.0, size]))),
        ):
            with pytest.raises(ModelError) as caught:
                build()
            assert caught.value.pointer == (name,)
            assert caught.value.code == "out_of_range"

    @pytest.mark.parametrize("Omega", [5e-324, 1e-200, 1e200])
    def test_frequencies(self, Omega: float) -> None:
        with pytest.raises(ModelError) as caught:
            solve(presets.chain(3, [Constraint.at(0, GAP)]), Omega)
        assert caught.value.pointer == ("frequency",)

    def test_denormal_entries_beside_normal_ones_are_nothing(self) -> None:
        stiffnesses = np.array([1.0, 1.0, 5e-324, 1.0])
        with_it = springs(np.ones(3), stiffnesses, [Constraint.at(1, GAP)])
        without = springs(np.ones(3), [1.0, 1.0, 0.0, 1.0], [Constraint.at(1, GAP)])
        assert solve(with_it, 1.3).impulse == solve(without, 1.3).impulse
