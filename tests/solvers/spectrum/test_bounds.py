"""Bounds of the natural frequencies and counts of them, against all eigenvalues."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse

from vibroimpact_solvers import condensation
from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.factors import Solve
from vibroimpact_solvers.matrices import Form, SymmetricMatrix
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.spectrum import EigenvalueCounter, largest_frequency

N = 24


def stiffness(form: Form) -> SymmetricMatrix:
    """Return a stiffness matrix whose couplings outweigh its diagonal."""
    rng = np.random.default_rng(3)
    offsets = (0, 1, 2)
    bands = [rng.uniform(1.0, 2.0, N), *(rng.uniform(-4.0, -3.0, N - k) for k in offsets[1:])]
    lower = scipy.sparse.diags_array(bands[1:], offsets=[-1, -2], shape=(N, N))
    whole = (scipy.sparse.diags_array(bands[0]) + lower + lower.T).tocsr()
    if form is Form.DENSE:
        return SymmetricMatrix(whole.toarray(), form)
    if form is Form.SPARSE:
        return SymmetricMatrix(
            whole.data, form, (whole.indices.astype(int), whole.indptr.astype(int))
        )
    return SymmetricMatrix.bands(dict(zip(offsets, bands, strict=True)))


def consistent_mass() -> SymmetricMatrix:
    """Return a mass matrix with eigenvalues from 0.03 to 2, and ones on its diagonal."""
    return SymmetricMatrix.bands({0: np.ones(N), 1: np.full(N - 1, 0.5)})


def eigenvalues(system: System) -> Floats:
    values = scipy.linalg.eigh(system.K.to_dense(), system.M.to_dense(), eigvals_only=True)
    return np.asarray(values)


@pytest.mark.parametrize("form", [Form.BANDED, Form.SPARSE, Form.DENSE])
@pytest.mark.parametrize("diagonal", [True, False])
def test_no_frequency_is_above_the_bound(form: Form, *, diagonal: bool) -> None:
    mass = SymmetricMatrix.diagonal(np.linspace(1.0, 1.2, N)) if diagonal else consistent_mass()
    system = System(mass, stiffness(form), ())
    assert system.K.form is form
    largest = np.sqrt(np.abs(eigenvalues(system)).max())
    assert largest <= largest_frequency(system) <= 2.0 * largest


def test_factors_of_the_mass_matrix_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """For bounds, and the same structure with other limiters; another process makes its own."""
    made = list[SymmetricMatrix]()
    factorize = SymmetricMatrix.factorize

    def counted(matrix: SymmetricMatrix, *, definite: bool = False) -> Solve:
        made.append(matrix)
        return factorize(matrix, definite=definite)

    monkeypatch.setattr(SymmetricMatrix, "factorize", counted)
    system = System(consistent_mass(), stiffness(Form.SPARSE), ())
    bound = largest_frequency(system)
    b = np.arange(float(N))
    solved = condensation.solve_mass(system.limited([Constraint.at(0, 1.0)]))(b)
    assert sum(matrix is system.M for matrix in made) == 1
    copied = pickle.loads(pickle.dumps(system))
    assert largest_frequency(copied) == bound
    np.testing.assert_array_equal(condensation.solve_mass(copied)(b), solved)
    assert sum(matrix is copied.M for matrix in made) == 1


def test_counts_are_those_of_all_eigenvalues_and_state_what_rounding_may_hide() -> None:
    system = System(consistent_mass(), stiffness(Form.BANDED), ())
    every = eigenvalues(system)
    counter = EigenvalueCounter.of(system)
    for below, middle in enumerate(0.5 * (every[1:] + every[:-1]), start=1):
        counted = counter.count(middle)
        assert counted.below == below
        assert counted.at == middle
        # A rounding of K - lambda M moves eigenvalues by as much over the least one of M.
        rounding = EPS * np.abs(system.K.to_dense() - middle * system.M.to_dense()).max()
        least = scipy.linalg.eigvalsh(system.M.to_dense())[0]
        assert rounding / least < counted.error < np.diff(every).min()
