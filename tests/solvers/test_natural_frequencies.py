"""Natural frequencies, shapes, flexibilities against other eigensolvers, in more digits too."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mpmath as mp
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse

from tests.solvers.beams import cantilever
from tests.solvers.structures import chain, random_system
from vibroimpact_solvers import damping, natural_frequencies, presets
from vibroimpact_solvers.errors import Cancelled, ModelError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.natural_frequencies import OUTPUTS, Problem, Result
from vibroimpact_solvers.plan import Stage

ALL = frozenset(OUTPUTS) - {"effective_mass"}


def method(problem: Problem) -> str:
    step = natural_frequencies.plan(problem).step(Stage.SPECTRUM)
    assert step is not None
    return str(step.method)


def solved(system: System, **more: Any) -> Result:
    problem = Problem(system, **{"outputs": ALL, **more})
    return natural_frequencies.solve(problem, natural_frequencies.plan(problem))


def eigenpairs(system: System) -> tuple[np.ndarray, np.ndarray]:
    values, modes = scipy.linalg.eigh(system.K.to_dense(), system.M.to_dense())
    return values, modes


def grid(rows: int, columns: int, *, free: bool = False, irregular: bool = True) -> System:
    """Return a membrane of masses joined by springs, with stops at three of them."""

    def line(n: int) -> scipy.sparse.csr_array:
        main = np.full(n, 2.0)
        if free:
            main[[0, -1]] = 1.0
        return scipy.sparse.diags_array(
            [main, -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1]
        )

    one = scipy.sparse.eye_array
    K = scipy.sparse.kron(line(rows), one(columns)) + scipy.sparse.kron(one(rows), line(columns))
    n = rows * columns
    masses = 1.0 + (0.3 * np.sin(np.arange(n)) if irregular else np.zeros(n))
    stops = (
        Constraint.at(n // 3, 1.0),
        Constraint.at(n // 2, 1.0),
        Constraint((5, n - 7), (1.0, -1.0), 1.0, 1.0),
    )
    stiffness = SymmetricMatrix.leanest(scipy.sparse.csr_array(K))
    return System(SymmetricMatrix.diagonal(masses), stiffness, stops)


def test_a_small_structure_has_the_modes_of_scipy() -> None:
    system = random_system(
        1, 20, [Constraint.at(3, 1.0), Constraint((1, 4), (1.0, -2.0), 0.1, 0.1)]
    )
    values, modes = eigenpairs(system)
    result = solved(system, count=7)
    np.testing.assert_allclose(result.Omega, np.sqrt(values[:7]), rtol=1e-10)
    expected = modes[:, :7].T
    signs = np.sign((expected * result.shape).sum(axis=1))[:, np.newaxis]
    np.testing.assert_allclose(result.shape, signs * expected, atol=1e-10)
    W = system.directions((0, 1))
    np.testing.assert_allclose(result.participation, result.shape @ W.T, atol=1e-12)
    rest = W @ modes[:, 7:]
    np.testing.assert_allclose(
        result.residual_flexibility, (rest / values[7:]) @ rest.T, rtol=1e-10, atol=1e-13
    )


@pytest.mark.parametrize("seed", range(4))
def test_errors_hold_what_is_true(seed: int) -> None:
    # Graded stiffnesses: scipy knows the low frequencies to few digits.
    rng = np.random.default_rng(seed)
    n = 8
    A = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-4, 4, size=n)
    M, K = np.eye(n) + 0.1 * np.ones((n, n)), A.T @ A + 1e-4 * np.eye(n)
    K = 0.5 * (K + K.T)
    stop = Constraint.at(2, 1.0)
    result = solved(System(SymmetricMatrix.dense(M), SymmetricMatrix.dense(K), (stop,)), count=n)
    with mp.workdps(60):
        L = mp.cholesky(mp.matrix(M.tolist()))
        inverse = L**-1
        values, turned = mp.eigsy(inverse * mp.matrix(K.tolist()) * inverse.T)
        modes = inverse.T * turned
        for j in range(n):
            assert abs(mp.sqrt(values[j]) - mp.mpf(result.Omega[j])) <= result.error_Omega[j]
            sign = mp.sign(mp.fsum(modes[i, j] * result.shape[j, i] for i in range(n)))
            for i in range(n):
                error = abs(sign * modes[i, j] - mp.mpf(result.shape[j, i]))
                assert error <= result.error_shape[j, i]
            at_stop = abs(sign * modes[2, j] - mp.mpf(result.participation[j, 0]))
            assert at_stop <= result.error_participation[j, 0]
    assert (result.error_Omega <= 1e-13 * result.Omega).all()


def test_residual_flexibility_is_the_static_one_without_the_modes() -> None:
    system = random_system(5, 12, [Constraint.at(3, 1.0), Constraint.at(7, 1.0)])
    result = solved(system, count=4)
    with mp.workdps(50):
        K, M = (mp.matrix(A.to_dense().tolist()) for A in (system.K, system.M))
        L = mp.cholesky(M)
        inverse = L**-1
        values, turned = mp.eigsy(inverse * K * inverse.T)
        modes, static = inverse.T * turned, K**-1
        for a, i in enumerate((3, 7)):
            for b, j in enumerate((3, 7)):
                kept = mp.fsum(modes[i, k] * modes[j, k] / values[k] for k in range(4))
                error = abs(static[i, j] - kept - mp.mpf(result.residual_flexibility[a, b]))
                assert error <= result.error_residual_flexibility[a, b]
    none = solved(system, count=12).residual_flexibility
    assert none is not None
    assert not none.any()


def test_a_large_sparse_structure_has_the_modes_of_scipy() -> None:
    system = grid(60, 50)
    problem = Problem(system, count=12, outputs=ALL)
    assert method(problem) == "lowest modes"
    result = solved(system, count=12)
    values, modes = eigenpairs(system)
    np.testing.assert_allclose(result.Omega, np.sqrt(values[:12]), rtol=1e-10)
    assert (result.error_Omega <= 1e-12 * result.Omega).all()
    assert "certified" in result.error_statement
    signs = np.sign((modes[:, :12].T * result.shape).sum(axis=1))[:, np.newaxis]
    np.testing.assert_allclose(result.shape, signs * modes[:, :12].T, atol=1e-10)
    rest = system.directions(range(3)) @ modes[:, 12:]
    static = (rest / values[12:]) @ rest.T
    np.testing.assert_allclose(result.residual_flexibility, static, atol=1e-11)
    assert (np.abs(result.residual_flexibility - static) <= result.error_residual_flexibility).all()


def test_repeated_frequencies_of_a_large_structure_are_all_there() -> None:
    # A square membrane has pairs of equal frequencies.
    system = grid(25, 25, irregular=False)
    j = 2.0 - 2.0 * np.cos(np.pi * np.arange(1, 26) / 26)
    exact = np.sqrt(np.sort((j[:, np.newaxis] + j).ravel()))
    for count in (1, 2, 3, 11):
        problem = Problem(system, count=count, outputs=ALL)
        assert method(problem) == "lowest modes"
        result = solved(system, count=count)
        assert (np.abs(result.Omega - exact[:count]) <= result.error_Omega + 1e-15).all()
        gram = result.shape @ (system.M @ result.shape.T)
        np.testing.assert_allclose(gram, np.eye(count), atol=1e-12)
        # What the constraints see of a pair is that of its space.
        assert np.isfinite(result.error_shape).all()


def test_the_lowest_modes_of_a_free_structure_are_rigid() -> None:
    system = grid(30, 20, free=True)
    result = solved(system, count=6)
    values, modes = eigenpairs(system)
    assert result.Omega[0] == 0.0
    assert result.error_Omega[0] < 1e-6
    np.testing.assert_allclose(result.Omega[1:], np.sqrt(values[1:6]), rtol=1e-10)
    rest = system.directions(range(3)) @ modes[:, 6:]
    np.testing.assert_allclose(
        result.residual_flexibility, (rest / values[6:]) @ rest.T, atol=1e-11
    )
    # The elastic inverse stays where the rigid-body modes are the only ones that are kept.
    alone = solved(system, count=1)
    rest = system.directions(range(3)) @ modes[:, 1:]
    np.testing.assert_allclose(alone.residual_flexibility, (rest / values[1:]) @ rest.T, rtol=1e-10)


def test_a_small_free_structure_has_the_elastic_inverse() -> None:
    K = np.array([[1.0, -1.0, 0.0], [-1.0, 3.0, -2.0], [0.0, -2.0, 2.0]])
    system = System(
        SymmetricMatrix.diagonal([1.0, 2.0, 3.0]),
        SymmetricMatrix.dense(K),
        (Constraint.at(0, 1.0),),
    )
    result = solved(system, count=1)
    np.testing.assert_array_equal(result.Omega, [0.0])
    values, modes = eigenpairs(system)
    assert result.residual_flexibility is not None
    expected = (modes[0, 1:] ** 2 / values[1:]).sum()
    np.testing.assert_allclose(result.residual_flexibility[0, 0], expected, rtol=1e-12)
    np.testing.assert_allclose(result.shape[0], np.full(3, 6.0**-0.5), rtol=1e-12)


def test_an_unstable_structure_has_its_growth_first() -> None:
    K = np.array([[-1.0, 0.5], [0.5, 3.0]])
    system = System(SymmetricMatrix.diagonal([1.0, 1.0]), SymmetricMatrix.dense(K), ())
    values = np.linalg.eigvalsh(K)
    result = solved(system)
    np.testing.assert_allclose(result.Omega, [-np.sqrt(-values[0]), np.sqrt(values[1])], rtol=1e-14)


def test_all_modes_up_to_a_frequency() -> None:
    for system in (random_system(2, 15, []), grid(30, 20)):
        values, _ = eigenpairs(system)
        stop = float(np.sqrt(0.5 * (values[6] + values[7])))
        result = solved(system, stop=stop, outputs=frozenset({"Omega"}))
        np.testing.assert_allclose(result.Omega, np.sqrt(values[:7]), rtol=1e-10)
        assert result.shape is None
        none = solved(system, stop=0.5 * float(np.sqrt(values[0])))
        assert none.Omega.size == 0
        assert none.shape.shape == (0, system.n)


def test_no_more_modes_than_there_are() -> None:
    assert solved(chain(4, 1)).Omega.size == 4
    assert solved(chain(4, 1), count=9).Omega.size == 4
    assert solved(chain(30, 1)).Omega.size == 10


@pytest.mark.parametrize("n", [20, 700])
def test_massless_degrees_of_freedom_follow(n: int) -> None:
    rng = np.random.default_rng(n)
    massless = np.arange(1, n, 3)
    mass = rng.uniform(1.0, 2.0, n)
    mass[massless] = 0.0
    K = np.zeros((n, n))
    for i in range(n):
        K[i, i] += rng.uniform(0.5, 1.0)
        for j in range(i + 1, min(i + 3, n)):
            k = rng.uniform(1.0, 2.0)
            K[[i, j], [i, j]] += k
            K[i, j] -= k
            K[j, i] -= k
    stop = Constraint.at(3, 1.0)
    system = System(SymmetricMatrix.diagonal(mass), SymmetricMatrix.dense(K), (stop,))
    moving = np.setdiff1d(np.arange(n), massless)
    static = -np.linalg.solve(K[np.ix_(massless, massless)], K[np.ix_(massless, moving)])
    condensed = K[np.ix_(moving, moving)] + K[np.ix_(moving, massless)] @ static
    values, modes = scipy.linalg.eigh(condensed, np.diag(mass[moving]))
    result = solved(system, count=5)
    np.testing.assert_allclose(result.Omega, np.sqrt(values[:5]), rtol=1e-10)
    whole = np.empty((n, 5))
    whole[moving], whole[massless] = modes[:, :5], static @ modes[:, :5]
    signs = np.sign((whole.T * result.shape).sum(axis=1))[:, np.newaxis]
    np.testing.assert_allclose(result.shape, signs * whole.T, atol=1e-10)
    place = int(np.flatnonzero(moving == 3)[0])
    expected = (modes[place, 5:] ** 2 / values[5:]).sum()
    np.testing.assert_allclose(result.residual_flexibility, [[expected]], rtol=1e-9)
    with pytest.raises(ModelError):
        Problem(system, fixed=(1,))


@pytest.mark.parametrize("fixed", [(0,), (1,), (0, 1, 2)])
def test_held_coordinates_stand_still(fixed: tuple[int, ...]) -> None:
    system = random_system(
        3, 9,
        [
            Constraint((1, 4), (1.0, -2.0), 0.1, 0.1),
            Constraint.at(6, 1.0),
            Constraint((0, 4, 6), (1.0, 2.0, 0.5), 0.1, 0.1),
            Constraint.at(8, 1.0),
        ],
    )  # fmt: skip
    Z = scipy.linalg.null_space(system.directions(fixed))
    M, K = system.M.to_dense(), system.K.to_dense()
    values, modes = scipy.linalg.eigh(Z.T @ K @ Z, Z.T @ M @ Z)
    result = solved(system, count=20, fixed=fixed)
    np.testing.assert_allclose(result.Omega, np.sqrt(values), rtol=1e-10)
    expected = (Z @ modes).T
    signs = np.sign((expected * result.shape).sum(axis=1))[:, np.newaxis]
    np.testing.assert_allclose(result.shape, signs * expected, atol=1e-10)
    assert not result.participation[:, list(fixed)].any()
    np.testing.assert_allclose(result.participation[:, 3], result.shape[:, 8], atol=1e-12)
    fewer = solved(system, count=2, fixed=fixed)
    rest = system.directions(range(4)) @ Z @ modes[:, 2:]
    np.testing.assert_allclose(fewer.residual_flexibility, (rest / values[2:]) @ rest.T, atol=1e-12)


def test_a_coordinate_that_is_held_by_others_already_changes_nothing() -> None:
    stops = [
        Constraint.at(1, 1.0), Constraint.at(3, 1.0), Constraint((1, 3), (1.0, -1.0), 1.0, 1.0),
    ]  # fmt: skip
    system = random_system(3, 6, stops)
    two, three = (solved(system, fixed=fixed, count=6) for fixed in ((0, 1), (0, 1, 2)))
    np.testing.assert_allclose(three.Omega, two.Omega, rtol=1e-14)
    assert not three.participation.any()


def test_held_in_the_middle_a_large_membrane_is_another_one() -> None:
    system = grid(30, 20)
    result = solved(system, fixed=(1,), count=5)
    free = np.delete(np.arange(600), 300)
    K, M = (A.to_dense()[np.ix_(free, free)] for A in (system.K, system.M))
    expected = scipy.linalg.eigh(K, M, eigvals_only=True)
    np.testing.assert_allclose(result.Omega, np.sqrt(expected[:5]), rtol=1e-10)


def test_effective_masses_add_up_to_the_mass() -> None:
    system = random_system(7, 10, [])
    r = np.vstack([np.ones(10), np.arange(10.0)])
    result = solved(system, count=10, directions=r, outputs=frozenset({"effective_mass"}))
    np.testing.assert_allclose(
        result.effective_mass.sum(axis=0), np.diag(r @ (system.M @ r.T)), rtol=1e-12
    )
    values, modes = eigenpairs(system)
    expected = (modes.T @ (system.M @ r.T)) ** 2
    np.testing.assert_allclose(result.effective_mass, expected, rtol=1e-9, atol=1e-12)
    assert (np.abs(result.effective_mass - expected) <= 1e-9 * expected.max()).all()
    assert result.shape is None
    assert values.size == 10


def test_a_cantilever_has_the_frequencies_of_its_theory() -> None:
    # cos x cosh x = -1; Bernoulli's beam by 200 elements.
    system = cantilever(200)
    result = solved(system, count=3)
    x = np.array([1.875104068711961, 4.694091132974175, 7.854757438237613])
    first = (result.Omega / result.Omega[0]) ** 0.5
    np.testing.assert_allclose(first, x / x[0], rtol=1e-6)
    plan = natural_frequencies.plan(Problem(system))
    assert "damping" in [skip.what for skip in plan.skips]


def below(system: System, value: mp.mpf) -> int:
    """Return how many squared frequencies are below a value: negative pivots, in 60 digits."""
    K, M = system.K.to_dense(), system.M.to_dense()
    n, width, count = system.n, 3, 0
    rows = [
        {j: mp.mpf(K[i, j]) - value * mp.mpf(M[i, j]) for j in range(i, min(i + width + 1, n))}
        for i in range(n)
    ]
    for i in range(n):
        pivot = rows[i][i]
        count += pivot < 0
        for j in range(i + 1, min(i + width + 1, n)):
            for k in range(j, min(i + width + 1, n)):
                rows[j][k] -= rows[i][j] * rows[i][k] / pivot
    return int(count)


@pytest.mark.parametrize("elements", [150, 400])
def test_errors_of_a_beam_of_many_elements_hold_what_is_true(elements: int) -> None:
    # Squared frequencies of these models span 11 and 13 orders of magnitude.
    system = cantilever(elements, damped=False)
    problem = Problem(system, count=4)
    assert method(problem) == "lowest modes"
    result = natural_frequencies.solve(problem, natural_frequencies.plan(problem))
    with mp.workdps(60):
        for place in range(4):
            Omega, error = mp.mpf(result.Omega[place]), mp.mpf(result.error_Omega[place])
            assert below(system, (Omega - error) ** 2) == place
            assert below(system, (Omega + error) ** 2) == place + 1
    assert (result.error_Omega < 1e-14 * result.Omega).all()


def test_the_tolerance_is_compared_with_the_errors() -> None:
    system = random_system(1, 8, [])
    assert solved(system).within_tolerance is None
    assert solved(system, tolerance=1e-10).within_tolerance.all()
    assert not solved(system, tolerance=1e-20).within_tolerance.any()


@pytest.mark.parametrize(
    ("fields", "pointer", "code"),
    [
        ({"count": 0}, ("count",), "out_of_range"),
        ({"count": 3, "stop": 1.0}, ("count",), "count_or_stop"),
        ({"stop": np.nan}, ("stop",), "out_of_range"),
        ({"stop": -1.0}, ("stop",), "out_of_range"),
        ({"fixed": (1,)}, ("fixed", 0), "index_out_of_range"),
        ({"fixed": (0, 0)}, ("fixed",), "duplicate_index"),
        ({"outputs": frozenset({"x"})}, ("outputs",), "unknown_output"),
        ({"outputs": frozenset({"effective_mass"})}, ("directions",), "missing_directions"),
        ({"directions": [[1.0, 1.0]]}, ("directions",), "wrong_length"),
        ({"directions": [[1.0, np.inf, 1.0]]}, ("directions",), "not_finite"),
        ({"tolerance": 2.0}, ("tolerance",), "out_of_range"),
    ],
)
def test_wrong_fields_are_named(
    fields: dict[str, Any], pointer: tuple[str | int, ...], code: str
) -> None:
    with pytest.raises(ModelError) as caught:
        Problem(chain(3, 1), **fields)
    assert caught.value.pointer == pointer
    assert caught.value.code == code


def test_something_has_to_move() -> None:
    with pytest.raises(ModelError) as caught:
        Problem(chain(1, 0), fixed=(0,))
    assert caught.value.code == "nothing_moves"


def test_a_computation_can_be_stopped() -> None:
    def stop(_done: int, _total: int) -> None:
        raise Cancelled

    problem = Problem(grid(30, 20))
    with pytest.raises(Cancelled):
        natural_frequencies.solve(problem, natural_frequencies.plan(problem), stop)


def test_gaps_have_no_effect() -> None:
    system = chain(9, 2)
    other = system.limited([replace(system.constraints[0], upper=7.0, restitution=0.5)])
    np.testing.assert_array_equal(solved(system).Omega, solved(other).Omega)


def known(values: np.ndarray, seed: int) -> tuple[System, np.ndarray]:
    """Return ``M = L^T L`` and ``K = L^T D L`` without rounding, and its modes, exact columns."""
    n = values.size
    links = np.random.default_rng(seed).choice([0.0, 0.5, -0.5, 1.0, -1.0], n - 1)
    L = scipy.sparse.diags_array([np.ones(n), links], offsets=[0, -1]).tocsr()
    modes = np.eye(n)
    for i in range(1, n):
        modes[i] -= links[i - 1] * modes[i - 1]
    order = np.argsort(values, kind="stable")
    stops = (Constraint.at(n // 3, 1.0), Constraint((5, n - 7), (1.0, -1.0), 1.0, 1.0))
    M, K = L.T @ L, L.T @ scipy.sparse.diags_array(values) @ L
    matrices = (SymmetricMatrix.leanest(scipy.sparse.csr_array(A)) for A in (M, K))
    return System(*matrices, stops), modes[:, order]


SPECTRA = {
    "plain": np.arange(1.0, 301.0),
    "wide": np.concatenate([[1.0], 2.0 ** np.arange(20, 40, 20 / 299)[:299].round()]),
    "unstable": np.arange(-40.0, 260.0),
    "free": np.concatenate([np.zeros(6), np.arange(1.0, 295.0)]),
}


@pytest.mark.parametrize("name", SPECTRA)
@pytest.mark.parametrize("asked", [{"count": 8}, {"stop": 1e-30}, {"stop": 1.0}])
def test_errors_of_the_lowest_modes_hold_at_stops_and_of_what_is_left(
    name: str, asked: dict[str, float]
) -> None:
    values = np.random.default_rng(3).permutation(SPECTRA[name])
    system, modes = known(values, 4)
    values.sort()
    problem = Problem(system, outputs=ALL, **asked)
    assert method(problem) == "lowest modes"
    result = natural_frequencies.solve(problem, natural_frequencies.plan(problem))
    exact = np.sign(values) * np.sqrt(np.abs(values))
    count = result.Omega.size
    assert count == (8 if "count" in asked else np.count_nonzero(exact <= asked["stop"]))
    assert (np.abs(result.Omega - exact[:count]) <= result.error_Omega).all()
    assert "certified" in result.error_statement
    rows = system.directions((0, 1)) @ modes
    for j in range(count):
        if np.count_nonzero(values == values[j]) == 1:
            sign = np.sign(modes[:, j] @ (system.M @ result.shape[j]))
            off = np.abs(sign * result.participation[j] - rows[:, j])
            assert (off <= result.error_participation[j]).all()
    elastic = np.flatnonzero(values[count:]) + count
    flexibility = (rows[:, elastic] / values[elastic]) @ rows[:, elastic].T
    error = result.error_residual_flexibility
    assert (np.abs(result.residual_flexibility - flexibility) <= error + 1e-13).all()
    assert (error >= 0.0).all()
    assert (error <= 1e-6 * np.abs(flexibility).max()).all()


def test_directions_held_make_no_full_matrices(monkeypatch: pytest.MonkeyPatch) -> None:
    n = 1200
    system, _ = known(np.arange(1.0, n + 1.0), 6)
    full, sizes = SymmetricMatrix.to_dense, list[int]()

    def counted(self: SymmetricMatrix) -> Any:
        sizes.append(self.n)
        return full(self)

    monkeypatch.setattr(SymmetricMatrix, "to_dense", counted)
    result = solved(system, count=5, fixed=(1,))
    assert not sizes
    Z = np.delete(np.eye(n), n - 7, axis=1)
    Z[n - 7, 5] = 1.0
    M, K = (Z.T @ full(A) @ Z for A in (system.M, system.K))
    expected = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True, subset_by_index=[0, 4]))
    np.testing.assert_allclose(result.Omega, expected, rtol=1e-9)
    assert (result.error_Omega <= 1e-9 * expected).all()


def test_static_solves_cost_less_where_the_matrix_is_banded() -> None:
    costs = []
    for system in (known(np.arange(1.0, 901.0), 0)[0], grid(30, 30)):
        system = replace(system, constraints=(Constraint.at(3, 1.0),))
        plan = natural_frequencies.plan(Problem(system, 5, outputs=ALL))
        step = plan.step(Stage.RESPONSE)
        assert step is not None
        costs.append(step.flops)
    assert costs[0] < 0.2 * costs[1]


def test_interchanged_matrices_are_told_from_ordinary_ones() -> None:
    said = "M has the form of a stiffness matrix, and K has not: M and K may be interchanged"
    for right in (
        chain(2, 0), chain(13), cantilever(6), grid(5, 7), grid(4, 5, free=True),
        presets.double_pendulum([], 2.0), presets.two_mass([], 1.0), random_system(3, 12, []),
    ):  # fmt: skip
        assert solved(right, count=1).cautions is None
    for wrong in (chain(2, 0), chain(13), cantilever(6), grid(5, 7)):
        swapped = System(wrong.K, wrong.M, wrong.constraints)
        assert solved(swapped, count=1).cautions == [said]


def test_structures_that_do_not_stay_at_rest_are_told() -> None:
    K = SymmetricMatrix.dense([[1.0, 2.0], [2.0, 1.0]])
    (said,) = solved(System(SymmetricMatrix.diagonal([1.0, 1.0]), K, ())).cautions or []
    assert said.startswith("the natural frequency of mode 0 is negative")
    assert "K is indefinite" in said
    down = SymmetricMatrix.diagonal([-1.0, -4.0])
    (said,) = solved(System(SymmetricMatrix.diagonal([1.0, 1.0]), down, ())).cautions or []
    assert said.startswith("the natural frequencies of modes 0 to 1 are negative")
    # Bodies that are free have frequencies of 0, up to roundings.
    assert solved(grid(5, 7, free=True)).cautions is None


def test_critical_damping_is_told_by_mode() -> None:
    """Where the modes are asked for; for the sake of a caution they are not computed."""
    system, outputs = chain(3, 0), {"Omega", "shape"}
    below = damping.damped(system, damping.Ratio((0.9, 0.99, 0.2)))
    assert solved(below, outputs=frozenset(outputs)).cautions is None
    above = damping.damped(system, damping.Ratio((0.9, 2.0, 0.2)))
    assert solved(above, outputs=frozenset(outputs)).cautions == [
        "mode 1 has 200 % of its critical damping, and does not oscillate"
    ]
    all_of_them = damping.damped(system, damping.Ratio((1.5,)))
    assert solved(all_of_them, outputs=frozenset(outputs)).cautions == [
        "3 modes (0, 1, 2) have critical damping or more, up to 150 %, and do not oscillate"
    ]
    assert solved(above, outputs=frozenset({"Omega"})).cautions is None
