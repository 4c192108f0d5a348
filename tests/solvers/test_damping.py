"""Damping matrices from ratios, Rayleigh's coefficients, loss factors and dashpots."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg

from tests.solvers.beams import cantilever
from tests.solvers.structures import chain, random_system
from vibroimpact_solvers import condensation, damping, time_history
from vibroimpact_solvers.damping import Dashpot, Ratio, Rayleigh, Structural
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

FREE = System(
    SymmetricMatrix.diagonal([1.0, 2.0]), SymmetricMatrix.dense([[1.0, -1.0], [-1.0, 1.0]]), ()
)


def matrix(system: System, law: damping.Law | None = None, *dashpots: Dashpot) -> np.ndarray:
    C = damping.damped(system, law, dashpots).C
    assert C is not None
    return C.to_dense()


def ratios(system: System, C: np.ndarray) -> np.ndarray:
    """Return the damping ratios of the modes, which are not coupled, by scipy."""
    values, modes = scipy.linalg.eigh(system.K.to_dense(), system.M.to_dense())
    modal = modes.T @ C @ modes
    np.testing.assert_allclose(modal, np.diag(np.diagonal(modal)), atol=1e-11 * np.abs(modal).max())
    return np.asarray(np.diagonal(modal) / (2.0 * np.sqrt(values)))


@pytest.mark.parametrize(
    "system", [random_system(1, 12, []), chain(30, 5), cantilever(10, damped=False)]
)
def test_each_mode_has_its_ratio(system: System) -> None:
    each = tuple(np.linspace(0.001, 0.3, system.n).tolist())
    np.testing.assert_allclose(ratios(system, matrix(system, Ratio(each))), each, rtol=1e-8)
    all_modes = ratios(system, matrix(system, Ratio((0.02,))))
    np.testing.assert_allclose(all_modes, 0.02, rtol=1e-8)


def test_uncoupled_coordinates_keep_a_diagonal_matrix() -> None:
    system = System(SymmetricMatrix.diagonal([2.0, 3.0]), SymmetricMatrix.diagonal([8.0, 27.0]), ())
    damped = damping.damped(system, Ratio((0.1,)))
    assert damped.C is not None
    np.testing.assert_allclose(damped.C.data, [[0.8, 1.8]], rtol=1e-15)


def test_rigid_body_modes_have_no_damping() -> None:
    C = matrix(FREE, Ratio((0.1,)))
    np.testing.assert_allclose(C @ np.ones(2), 0.0, atol=1e-15)
    # The elastic mode: K = mu Omega^2 with the reduced mass 2/3.
    np.testing.assert_allclose(C[0, 0], 2.0 * 0.1 * np.sqrt(2.0 / 3.0), rtol=1e-14)


def test_a_ratio_is_seen_in_the_decay_of_a_motion() -> None:
    system = damping.damped(cantilever(12, damped=False), Ratio((0.01,)))
    values, modes = scipy.linalg.eigh(system.K.to_dense(), system.M.to_dense())
    for mode in (0, 3, 15):
        Omega, shape = float(np.sqrt(values[mode])), 1e-6 * modes[:, mode]
        turn = Omega * np.sqrt(1.0 - 0.01**2)
        t = np.linspace(0.0, 10.0 / Omega, 5)
        problem = time_history.Problem(
            system, time_history.State(shape, np.zeros(system.n)), float(t[-1]), t,
            outputs=frozenset({"x"}),
        )  # fmt: skip
        result = time_history.solve(problem, time_history.plan(problem))
        decay = np.exp(-0.01 * Omega * t)
        decay *= np.cos(turn * t) + 0.01 * Omega / turn * np.sin(turn * t)
        np.testing.assert_allclose(
            result.x, np.outer(decay, shape), atol=1e-8 * np.abs(shape).max()
        )


def test_rayleigh_damping() -> None:
    system = random_system(2, 9, [])
    M, K = system.M.to_dense(), system.K.to_dense()
    np.testing.assert_allclose(
        matrix(system, Rayleigh(0.3, 0.02)), 0.3 * M + 0.02 * K, rtol=1e-14, atol=1e-15
    )
    given, at = np.array([0.02, 0.05]), np.array([0.5, 2.0])
    law = Rayleigh.through(given, at)
    # zeta = (alpha/Omega + beta Omega)/2, a linear system.
    equations = 0.5 * np.column_stack([1.0 / at, at])
    expected = np.linalg.solve(equations, given)
    np.testing.assert_allclose([law.alpha, law.beta], expected, rtol=1e-14)
    back = Rayleigh.through(given[::-1], at[::-1])
    np.testing.assert_allclose([back.alpha, back.beta], expected, rtol=1e-14)


def test_structural_damping_loses_as_much_in_a_cycle() -> None:
    # x = cos(Omega t): work of C x' over a cycle is pi c Omega, that of K (1 + i eta) pi eta K.
    C = matrix(chain(1, 0), Structural(0.03, 1.7))
    np.testing.assert_allclose(np.pi * C * 1.7, np.pi * 0.03 * 2.0, rtol=1e-15)


def test_dashpots_add_to_everything() -> None:
    system = random_system(3, 6, [])
    between, ground = Dashpot((1, 4), (1.0, -2.0), 0.5), Dashpot((3,), (1.0,), 2.0)
    w = np.zeros(6)
    w[[1, 4]] = 1.0, -2.0
    expected = 0.5 * np.outer(w, w)
    expected[3, 3] += 2.0
    np.testing.assert_array_equal(matrix(system, None, between, ground), expected)
    law = Rayleigh(0.1, 0.2)
    np.testing.assert_allclose(
        matrix(system, law, between, ground), matrix(system, law) + expected, rtol=1e-15
    )
    own = system.damped(SymmetricMatrix.dense(np.eye(6)))
    np.testing.assert_allclose(matrix(own, None, between, ground), np.eye(6) + expected)
    assert damping.damped(system).C is None


def test_what_has_no_mass_takes_the_damping_of_its_springs() -> None:
    K = np.array([[3.0, -1.0, 0.0], [-1.0, 3.0, -2.0], [0.0, -2.0, 2.0]])
    system = System(SymmetricMatrix.diagonal([1.0, 0.0, 2.0]), SymmetricMatrix.dense(K), ())
    moving = [0, 2]
    # Row 1 of K x + beta K x' = 0 holds for x_1 = S x at all times.
    condensed = K[np.ix_(moving, moving)] - np.outer(K[moving, 1], K[1, moving]) / K[1, 1]
    expected = np.zeros((3, 3))
    expected[np.ix_(moving, moving)] = 0.1 * condensed
    expected[moving, moving] += 0.2 * np.array([1.0, 2.0])
    np.testing.assert_allclose(matrix(system, Rayleigh(0.2, 0.1)), expected, rtol=1e-14)
    C = matrix(system, Ratio((0.05,)))
    assert not C[1].any()
    values, modes = scipy.linalg.eigh(condensed, np.diag([1.0, 2.0]))
    modal = modes.T @ C[np.ix_(moving, moving)] @ modes
    np.testing.assert_allclose(modal, np.diag(0.1 * np.sqrt(values)), atol=1e-15)
    assert condensation.of(damping.damped(system, Rayleigh(0.0, 0.1))).massless.tolist() == [1]


def refused(system: System, law: damping.Law | None, *dashpots: Dashpot) -> ModelError:
    with pytest.raises(ModelError) as caught:
        damping.damped(system, law, dashpots)
    return caught.value


@pytest.mark.parametrize(
    ("law", "pointer", "code"),
    [
        (Ratio((0.1, 0.2)), ("damping", "ratio"), "wrong_length"),
        (Ratio((-0.1,)), ("damping", "ratio"), "out_of_range"),
        (Ratio((np.nan,)), ("damping", "ratio"), "out_of_range"),
        (Rayleigh(1e200, 0.0), ("damping",), "out_of_range"),
    ],
)
def test_wrong_laws_are_named(law: damping.Law, pointer: tuple[str, ...], code: str) -> None:
    error = refused(chain(3, 1), law)
    assert (error.pointer, error.code) == (pointer, code)


@pytest.mark.parametrize(
    ("fields", "pointer", "code"),
    [
        ({"dofs": (3,)}, ("dofs", 0), "index_out_of_range"),
        ({"dofs": (1, 1), "weights": (1.0, 1.0)}, ("dofs",), "duplicate_dof"),
        ({"weights": (1.0, 2.0)}, ("weights",), "wrong_length"),
        ({"weights": (np.inf,)}, ("weights",), "not_finite"),
        ({"weights": (1e300,)}, ("weights",), "out_of_range"),
        ({"weights": (1e99,), "c": 1e200}, ("c",), "out_of_range"),
        ({"c": -1.0}, ("c",), "out_of_range"),
    ],
)
def test_wrong_dashpots_are_named(
    fields: dict[str, Any], pointer: tuple[str | int, ...], code: str
) -> None:
    good = Dashpot((0,), (1.0,), 1.0)
    wrong = Dashpot(**{"dofs": (0,), "weights": (1.0,), "c": 1.0, **fields})
    error = refused(chain(3, 1), None, good, wrong)
    assert (error.pointer, error.code) == (("dashpots", 1, *pointer), code)


def test_what_has_no_mass_takes_no_dashpot() -> None:
    light = System(
        SymmetricMatrix.diagonal([1.0, 0.0]), SymmetricMatrix.dense([[2.0, -1.0], [-1.0, 1.0]]), ()
    )
    error = refused(light, None, Dashpot((0, 1), (1.0, -1.0), 1.0))
    assert (error.pointer, error.code) == (("dashpots", 0, "dofs", 1), "massless_damping")


def test_ratios_of_large_structures_are_refused_with_a_way_out() -> None:
    error = refused(chain(damping.LARGEST + 1, 1), Ratio((0.02,)))
    assert error.code == "too_many_dofs"
    assert "Rayleigh" in error.message
    assert matrix(chain(damping.LARGEST, 1), Ratio((0.02,))).shape == (512, 512)


def test_modes_of_the_same_frequency_need_the_same_ratio() -> None:
    system = System(
        SymmetricMatrix.diagonal(np.ones(3)), SymmetricMatrix.diagonal([1.0, 4.0, 4.0]), ()
    )
    assert refused(system, Ratio((0.1, 0.1, 0.2))).code == "repeated_frequency"
    C = matrix(system, Ratio((0.2, 0.1, 0.1)))
    np.testing.assert_allclose(C, np.diag([0.4, 0.4, 0.4]), rtol=1e-15)
    # Rigid-body modes have none, whatever their ratio.
    apart = System(
        SymmetricMatrix.diagonal(np.ones(3)), SymmetricMatrix.diagonal([0.0, 0.0, 4.0]), ()
    )
    np.testing.assert_allclose(matrix(apart, Ratio((0.1, 0.2, 0.3)))[:2], 0.0)


def test_an_unstable_structure_has_no_ratios() -> None:
    system = System(SymmetricMatrix.diagonal([1.0, 1.0]), SymmetricMatrix.diagonal([-1.0, 1.0]), ())
    assert refused(system, Ratio((0.1,))).code == "unstable"


@pytest.mark.parametrize(
    ("given", "at", "field", "code"),
    [
        ([0.1, 0.1], [1.0, 1.0], "at", "equal_frequencies"),
        ([0.01, 0.9], [5.0, 6.0], "ratios", "negative_damping"),
        ([0.9, 0.01], [5.0, 6.0], "ratios", "negative_damping"),
    ],
)
def test_ratios_that_rayleigh_cannot_make(
    given: list[float], at: list[float], field: str, code: str
) -> None:
    with pytest.raises(ModelError) as caught:
        Rayleigh.through(given, at)
    assert (caught.value.pointer, caught.value.code) == (("damping", "rayleigh", field), code)


def test_systems_of_different_damping_share_nothing_that_depends_on_it() -> None:
    system = chain(3, 1)
    state = time_history.State(np.array([0.1, 0.0, 0.0]), np.zeros(3))
    ends = []
    for law in (Ratio((0.01,)), Ratio((0.2,))):
        problem = time_history.Problem(
            damping.damped(system, law), state, 3.0, np.array([3.0]), outputs=frozenset({"x"})
        )
        ends.append(time_history.solve(problem, time_history.plan(problem)).x)
    assert not np.allclose(*ends, rtol=1e-3)


def test_limiters_may_change_beside_damping() -> None:
    damped = damping.damped(chain(3, 1), Ratio((0.05,)))
    other = damped.limited([Constraint.at(0, 1.0)])
    assert other.C is damped.C


@pytest.mark.parametrize("frequency", [0.0, 1e-200, 5e-324, 1e200, float("inf"), float("nan")])
def test_frequencies_of_damping_out_of_range_are_named(frequency: float) -> None:
    """A structural damping at 5e-324 rpm, which is 0 rad/s, was divided by it."""
    with pytest.raises(ModelError) as caught:
        damping.Structural(0.01, frequency)
    assert caught.value.pointer == ("damping", "at")
    with pytest.raises(ModelError) as caught:
        damping.Rayleigh.through((0.01, 0.02), (1.0, frequency))
    assert caught.value.pointer == ("damping", "rayleigh", "at", 1)
