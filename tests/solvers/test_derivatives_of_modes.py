"""Derivatives of natural frequencies and shapes against differences of 60 digits."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest

from tests.solvers import beams
from tests.truth import structures
from vibroimpact_solvers import natural_frequencies
from vibroimpact_solvers.derivatives import MatrixRate, Parameter, StopRate
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.presets import chain

DIGITS, STEP = 60, 20
_ZERO = 1e-30  # what differences leave of zero
KINDS = ("dense", "diagonal", "chain", "graded", "mirror", "ill", "indefinite")
STIFFNESS = Parameter("K.scale", K=MatrixRate(1.0))


def solved(problem: natural_frequencies.Problem) -> natural_frequencies.Result:
    return natural_frequencies.solve(problem, natural_frequencies.plan(problem))


def modes(M: Any, K: Any, like: Any) -> tuple[Any, Any]:
    """Return frequencies and shapes as rows, with the signs of others."""
    lower = mpmath.cholesky(M) ** -1
    values, vectors = mpmath.eigsy(lower * K * lower.T)
    shapes = (lower.T * vectors).T
    heavy = M * mpmath.matrix(like.T.tolist())
    for j in range(M.rows):
        if (shapes[j, :] * heavy[:, j])[0] < 0:
            shapes[j, :] = -shapes[j, :]
    return [mpmath.sign(x) * mpmath.sqrt(abs(x)) for x in values], shapes


@pytest.mark.parametrize("seed", range(14))
def test_random_structures(seed: int) -> None:
    rng = np.random.default_rng(seed)
    document = structures.structure(rng, KINDS[seed % len(KINDS)], 5)
    document["constraints"] = structures.constraints(rng, len(document["M"]))
    system = structures.system(document)
    n = system.n
    i, j = (int(k) for k in rng.integers(n, size=2))
    entry = np.zeros((n, n))
    entry[i, j] = entry[j, i] = 1.0
    one, none = MatrixRate(entries=SymmetricMatrix.dense(entry)), np.zeros((n, n))
    parameters = STIFFNESS, Parameter("K.entry", K=one), Parameter("M.entry", M=one)
    outputs = frozenset({"Omega", "shape", "participation"})
    result = solved(
        natural_frequencies.Problem(system, count=n, outputs=outputs, parameters=parameters)
    )
    rows = system.directions(range(len(system.constraints)))
    with mpmath.workdps(DIGITS):
        M, K, h = (
            mpmath.matrix(document["M"]),
            mpmath.matrix(document["K"]),
            mpmath.mpf(10) ** -STEP,
        )
        for place, (dM, dK) in enumerate([(none, document["K"]), (none, entry), (entry, none)]):
            moved_M, moved_K = mpmath.matrix(np.array(dM).tolist()), mpmath.matrix(dK)
            ends = [modes(M + step * moved_M, K + step * moved_K, result.shape) for step in (h, -h)]
            Omega = [float((a - b) / (2 * h)) for a, b in zip(ends[0][0], ends[1][0], strict=True)]
            turned = (ends[0][1] - ends[1][1]) / (2 * h)
            shape = np.array([[float(x) for x in turned[k, :]] for k in range(n)])
            for name, true in (
                ("Omega", Omega),
                ("shape", shape),
                ("participation", shape @ rows.T),
            ):
                values = getattr(result, f"derivative_{name}")[..., place]
                stated = getattr(result, f"derivative_{name}_error")[..., place]
                assert (np.abs(values - np.array(true)) <= stated + _ZERO).all()
                assert stated.max() <= 1e-9 * max(1.0, np.abs(true).max())


def test_repeated_frequencies_move_by_the_rates_projected_on_them() -> None:
    """Two of three modes alike; a spring between two masses parts them."""
    K = np.array([[3.0, -1.0, -1.0], [-1.0, 3.0, -1.0], [-1.0, -1.0, 3.0]])
    spring = np.zeros((3, 3))
    spring[:2, :2] = [[1.0, -1.0], [-1.0, 1.0]]
    parameters = (
        Parameter("spring", K=MatrixRate(entries=SymmetricMatrix.dense(spring))),
        STIFFNESS,
    )
    system = System(SymmetricMatrix.diagonal(np.ones(3)), SymmetricMatrix.dense(K), ())
    result = solved(natural_frequencies.Problem(system, parameters=parameters))
    # Eigenvalues 1 and twice 4, of which one grows by 2 and the other stays.
    assert result.derivative_Omega is not None
    assert result.derivative_Omega[:, 0] == pytest.approx([0.0, 0.0, 0.5], abs=1e-14)
    assert result.derivative_Omega[:, 1] == pytest.approx([0.5, 1.0, 1.0], rel=1e-14)
    assert result.derivative_reason is not None
    assert result.derivative_reason.T.tolist() == [[0, 1, 1], [0, 0, 0]]
    assert result.derivative_distance is not None
    assert result.derivative_distance[1:, 0].tolist() == [0.0, 0.0]
    assert result.derivative_shape is not None
    assert np.isnan(result.derivative_shape[1:, :, 0]).all()
    assert np.isfinite(result.derivative_shape[0, :, 0]).all()


def test_rigid_bodies_leave_zero_as_a_root() -> None:
    free = System(
        SymmetricMatrix.diagonal([1.0, 1.0]),
        SymmetricMatrix.dense([[1.0, -1.0], [-1.0, 1.0]]),
        (),
    )
    ground = Parameter("K.0.0", K=MatrixRate(entries=SymmetricMatrix.diagonal([1.0, 0.0])))
    result = solved(natural_frequencies.Problem(free, parameters=(ground, STIFFNESS)))
    assert result.derivative_reason is not None
    assert result.derivative_Omega is not None
    assert result.derivative_reason[0].tolist() == [2, 0]
    assert np.isnan(result.derivative_Omega[0, 0])
    assert result.derivative_Omega[0, 1] == 0.0


def test_held_coordinates_and_flexibilities() -> None:
    """A beam with its tip held: all goes with powers of the stiffness."""
    outputs = frozenset({"Omega", "shape", "residual_flexibility"})
    system = beams.cantilever(25, damped=False)
    for fixed in ((), (0,)):
        result = solved(
            natural_frequencies.Problem(
                system, count=5, fixed=fixed, outputs=outputs, parameters=(STIFFNESS,)
            )
        )
        assert result.derivative_Omega is not None
        assert result.derivative_Omega[:, 0] == pytest.approx(0.5 * result.Omega, rel=1e-12)
        assert result.derivative_shape is not None
        assert (result.derivative_shape == 0.0).all()
        rate = result.derivative_residual_flexibility
        assert rate is not None
        assert rate[..., 0] == pytest.approx(-result.residual_flexibility, rel=1e-9)
    turned = Parameter("weight", stops=(StopRate(0, weights=((3, 1.0),)),))
    problem = natural_frequencies.Problem(system, fixed=(0,), parameters=(turned,))
    with pytest.raises(ModelError, match="held"):
        solved(problem)


def test_the_lowest_modes_alone_have_derivatives_of_their_frequencies() -> None:
    """Of a chain of 400 masses: eigenvalues ``4 (k/m) sin^2``."""
    known = chain(400, [Constraint.at(0, 1.0)])
    system = System(known.M, known.K, known.constraints)
    mass = Parameter("M.scale", M=MatrixRate(1.0))
    only = frozenset({"Omega"})
    result = solved(
        natural_frequencies.Problem(system, count=4, outputs=only, parameters=(STIFFNESS, mass))
    )
    assert result.derivative_Omega is not None
    expected = 0.5 * np.outer(result.Omega, [1.0, -1.0])
    assert result.derivative_Omega == pytest.approx(expected, rel=1e-9)
