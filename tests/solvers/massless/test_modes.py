"""Natural modes of structures with degrees of freedom without mass, against extended precision."""

from __future__ import annotations

import gc
import weakref

import mpmath
import numpy as np
import pytest
import scipy.linalg

from tests.solvers.massless.condensable import condensable
from tests.solvers.structures import symmetric
from vibroimpact_solvers import condensation, presets, resonances, spectrum
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

EPS = 2.0**-52


def exact(A: np.ndarray) -> mpmath.matrix:
    return mpmath.matrix(A.tolist())


@pytest.mark.parametrize(
    ("n", "count", "full"), [(3, 1, True), (7, 4, True), (8, 7, True), (12, 3, False)]
)
def test_modes_are_those_of_the_structure_condensed_by_hand(n: int, count: int, full: bool) -> None:
    """Condensed and solved with 60 digits: eigenvalues within their errors, rows to 25 digits."""
    rng = np.random.default_rng(n)
    without = np.sort(rng.permutation(n)[:count])
    others = np.delete(np.arange(n), without)
    K, M = symmetric(rng, n, 0.01), np.zeros((n, n))
    mass = symmetric(rng, n - count, 0.2)
    M[np.ix_(others, others)] = mass if full else np.diag(np.diag(mass))
    system = System(SymmetricMatrix.dense(M), SymmetricMatrix.dense(K), ())
    K = system.K.to_dense()
    natural = spectrum.spectrum(system)
    assert natural.proved
    assert natural.errors is not None
    assert natural.rounding is not None
    assert natural.modal_matrix_low is not None
    with mpmath.workdps(60):
        inner, coupling = exact(K[np.ix_(without, without)]), exact(K[np.ix_(without, others)])
        static = -(inner**-1) * coupling
        stiffness = exact(K[np.ix_(others, others)]) + coupling.T * static
        root = mpmath.cholesky(exact(M[np.ix_(others, others)])) ** -1
        values = sorted(mpmath.eigsy(root * stiffness * root.T, eigvals_only=True))
        for j, value in enumerate(values):
            one = mpmath.mpf(float(natural.roots[j])) * (1 + mpmath.mpf(float(natural.rounding[j])))
            assert abs(one * one - value) <= natural.errors[j] + 4 * EPS**2 * value
        modes = exact(natural.modes) + exact(natural.modal_matrix_low)
        low = mpmath.matrix([list(modes[int(dof), :]) for dof in without])
        high = mpmath.matrix([list(modes[int(dof), :]) for dof in others])
        assert mpmath.mnorm(low - static * high, mpmath.inf) < mpmath.mpf(10) ** -25
    assert natural.errors.max() < 1e-24


@pytest.mark.parametrize("seed", range(6))
def test_the_condensed_structure_is_the_exact_one(seed: int) -> None:
    case = condensable(seed, 2 + seed, 1 + 2 * (seed % 4))
    condensed = condensation.of(case.whole(()))
    np.testing.assert_allclose(condensed.K.to_dense(), case.condensed_K, atol=1e-12)
    np.testing.assert_allclose(condensed.static.toarray(), case.static, atol=1e-12)
    doubled = condensation.doubled(case.whole(()))
    assert (case.condensed_K == doubled.K).all()
    assert (case.static == doubled.static).all()
    bound = spectrum.largest_frequency(case.whole(()))
    values = scipy.linalg.eigvalsh(case.condensed_K, case.condensed(()).M.to_dense())
    assert np.sqrt(np.abs(values).max()) <= bound


def test_the_inverse_of_the_masses_is_its_limit() -> None:
    """With small masses instead of none the inverse tends to what stands for it."""
    case = condensable(3, 4, 3)
    b = np.random.default_rng(1).standard_normal(7)
    solved = condensation.solve_mass(case.whole(()))(b)
    carried = b[case.massive] + case.static.T @ b[case.massless]
    some = np.ix_(case.massive, case.massive)
    expected = np.linalg.solve(case.M[some], carried)
    np.testing.assert_allclose(solved[case.massive], expected, rtol=1e-12)
    np.testing.assert_allclose(solved[case.massless], case.static @ expected, rtol=1e-12)


def springs(masses: int) -> tuple[System, np.ndarray]:
    """Springs in a row, held at both ends, with a mass at every third joint; and their joints."""
    n = 3 * masses + 2
    at = np.arange(2, n, 3)
    mass = np.zeros(n)
    mass[at] = 1.0
    K = SymmetricMatrix.bands({0: np.full(n, 6.0), 1: np.full(n - 1, -3.0)})
    return System(SymmetricMatrix.diagonal(mass), K, ()), at


@pytest.mark.parametrize("masses", [40, 200])
def test_springs_in_series_are_one_spring(masses: int) -> None:
    """The uniform chain with its closed form, of small structures and of sparse larger ones."""
    system, at = springs(masses)
    chain = presets.chain(masses, [])
    natural, closed = spectrum.spectrum(system), spectrum.spectrum(chain)
    assert natural.errors is not None
    assert (np.abs(natural.eigenvalues - closed.eigenvalues)
            <= natural.errors + 4.0 * EPS * closed.eigenvalues).all()  # fmt: skip
    assert natural.errors.max() < 1e-11
    assert natural.proved == (system.n <= 256)
    between = natural.modes[at[:-1] + 1]  # one third of the way to the next mass
    expected = (2.0 * natural.modes[at[:-1]] + natural.modes[at[1:]]) / 3.0
    np.testing.assert_allclose(between, expected, atol=1e-13)
    assert condensation.of(system).K.entries < 4 * masses  # it stays narrow


def test_resonances_are_those_of_the_condensed_structure() -> None:
    case = condensable(5, 6, 4)
    for limiter in (Constraint.at(2, 0.5), Constraint((1, 4), (1.0, -2.0), 0.1, 0.2)):
        results = []
        for system in (case.whole([limiter]), case.condensed([limiter])):
            problem = resonances.Problem(system)
            plan = resonances.plan(problem)
            results.append(resonances.solve(problem, plan))
            if system.massless.size:
                assert "4 degrees of freedom have no mass" in plan.steps[0].reason
        ours, theirs = results
        assert ours.Omega is not None
        assert theirs.Omega is not None
        assert ours.error_Omega is not None
        assert theirs.error_Omega is not None
        assert (np.abs(ours.Omega - theirs.Omega) <= ours.error_Omega + theirs.error_Omega).all()


def test_a_part_without_mass_alone_has_no_resonances() -> None:
    """A mass with a limiter, on a spring to a joint that another spring holds."""
    K = SymmetricMatrix.dense([[2.0, -1.0], [-1.0, 3.0]])
    system = System(SymmetricMatrix.diagonal([1.0, 0.0]), K, (Constraint.at(0, 1.0),))
    problem = resonances.Problem(system)
    found = resonances.solve(problem, resonances.plan(problem))
    assert found.Omega is not None
    assert found.Omega.size == 0


def test_a_joint_that_nothing_moves_stays_at_rest() -> None:
    """One without coupling, and one whose two couplings cancel."""
    K = np.diag([2.0, 3.0, 1.0, 5.0])
    K[0, 2] = K[2, 0] = K[0, 3] = K[3, 0] = 1.0
    K[2, 3] = K[3, 2] = 1.0  # the last joint is moved by 1 and by -1 times 1
    system = System(SymmetricMatrix.diagonal([1.0, 0, 0, 0]), SymmetricMatrix.dense(K), ())
    natural = spectrum.spectrum(system)
    assert natural.modes[1:, 0].tolist() == [0.0, -1.0, 0.0]
    assert natural.eigenvalues.tolist() == [1.0]
    assert natural.angles is not None
    assert natural.angles.max() < 1e-25


def test_a_mass_on_a_loose_joint_is_free() -> None:
    K = SymmetricMatrix.dense([[1.0, -1.0], [-1.0, 1.0]])
    natural = spectrum.spectrum(System(SymmetricMatrix.diagonal([1.0, 0.0]), K, ()))
    assert natural.roots.tolist() == [0.0]
    np.testing.assert_array_equal(natural.modes, [[1.0], [1.0]])


def test_small_masses_tend_to_none() -> None:
    """Low modes of the structure with small masses instead are off in proportion to these."""
    case = condensable(41, 3, 2)
    none, apart = case.whole(()), []
    natural = spectrum.spectrum(none)
    for mass in (1e-4, 1e-6):
        M = none.M.to_dense().copy()
        M[case.massless, case.massless] = mass
        light = spectrum.spectrum(System(SymmetricMatrix.dense(M), none.K, ()))
        signs = np.sign((light.modes[:, :3] * natural.modes).sum(axis=0))
        shapes = np.abs(light.modes[:, :3] * signs - natural.modes).max()
        apart.append(max(shapes, np.abs(light.roots[:3] - natural.roots).max()))
    assert apart[1] < 0.02 * apart[0] < 1e-3


def test_a_condensed_structure_is_kept_as_long_as_its_system() -> None:
    system = System(
        SymmetricMatrix.diagonal([1.0, 0.0]), SymmetricMatrix.dense([[2.0, -1.0], [-1.0, 1.0]]), ()
    )
    condensed = weakref.ref(condensation.of(system))
    assert condensation.of(system) is condensed()
    del system
    gc.collect()
    assert condensed() is None
