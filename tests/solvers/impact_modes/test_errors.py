"""Every output of impact modes is within its error, and certificates are true."""

from __future__ import annotations

import warnings

import flint
import numpy as np
import pytest

from tests.reference.balls import Structure
from tests.reference.impact_modes import Family, Limiter, Solution, solved
from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers import presets
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Stage

OUTPUTS = frozenset({"impulse", "exists", "reason", "shape", "waveform", "energy", "harmonics"})
TAU = 0.37
MIRROR = [[2.0, -1, 0], [-1, 2, -1], [0, -1, 2]]
GRADED = [[5060000.0, -86, -1.7e7], [-86, 0.0332, 2700], [-1.7e7, 2700, 3.37e8]]


def structure(M: list[float], K: list[list[float]], *limiters: Constraint) -> System:
    return System(SymmetricMatrix.diagonal(M), SymmetricMatrix.dense(K), limiters)


def solve(system: System, Omega: float, active: tuple[int, ...] = ()) -> modes.Result:
    problem = modes.Problem(
        system,
        np.array([Omega]) * 2.0 / np.pi,
        active,
        OUTPUTS,
        tau=np.array([TAU]),
        Omega=np.array([Omega]),
        highest_harmonic=3,
    )
    return modes.solve(problem, modes.plan(problem))


def exact(system: System, Omega: float, active: tuple[int, ...]) -> Solution:
    limiters = tuple(
        Limiter(row, c.lower, c.upper)
        for row, c in zip(
            system.directions(range(len(system.constraints))), system.constraints, strict=True
        )
    )
    plain = Structure(system.M.to_dense(), system.K.to_dense(), force=system.force)
    return solved(Family(plain, limiters, active or tuple(range(len(limiters)))), Omega)


def away(value: float, ball: object) -> float:
    return abs(float((flint.arb(float(value)) - ball).mid()))


def check(system: System, Omega: float, active: tuple[int, ...] = ()) -> modes.Result:
    result, truth = solve(system, Omega, active), exact(system, Omega, active)
    assert result.impulse is not None
    assert result.certified is not None
    assert result.exists is not None
    assert result.momentum is not None
    assert result.momentum_error is not None
    to_momentum = flint.arb.pi() / flint.arb(Omega)
    for k, a in enumerate(result.constraint):
        if a in truth.impulse:
            assert away(result.impulse[0, k], truth.impulse[a]) <= result.impulse_error[0, k]
            momentum = truth.impulse[a] * to_momentum
            assert away(result.momentum[0, k], momentum) <= result.momentum_error[0, k]
        if result.impulse_lower is not None and a in truth.impulse_lower:
            assert result.impulse_lower_error is not None
            off = away(result.impulse_lower[0, k], truth.impulse_lower[a])
            assert off <= result.impulse_lower_error[0, k]
    assert result.shape is not None
    assert result.waveform is not None
    assert result.harmonics is not None
    assert result.harmonic is not None
    assert result.energy is not None
    at_wall, between = truth.displacement(1.0), truth.displacement(TAU)
    amplitudes = [truth.harmonic(int(order)) for order in result.harmonic]
    for i in range(system.n):
        assert away(result.shape[0, i], at_wall[i]) <= result.shape_error[0, i]
        assert away(result.waveform[0, 0, i], between[i]) <= result.waveform_error[0, 0, i]
        for k, amplitude in enumerate(amplitudes):
            assert away(result.harmonics[0, k, i], amplitude[i]) <= result.harmonics_error[0, 0, i]
    assert away(result.energy[0], truth.energy) <= result.energy_error[0]
    if result.certified[0]:
        # None: the polynomials of the reference do not tell a passage by 1e-25.
        assert truth.exists() in {result.exists[0], None}
    return result


def test_beside_the_resonance_of_a_silent_mode() -> None:
    # 0.1.0 certified that it exists; the idle limiter is passed by 2e-4.
    system = structure(
        [1.0, 1.0, 1.0], MIRROR, Constraint.at(1, 1.0), Constraint.at(0, 3.9470906885203574)
    )
    result = check(system, np.sqrt(2.0) * (1.0 + 1e-12), (0,))
    assert modes.REASONS[result.reason[0]] == "penetration"
    assert result.certified[0]


@pytest.mark.parametrize("away_by", [1e-15, 1e-12, 1e-9, 1e-6, -1e-12, -1e-9])
def test_displacements_beside_the_resonance_of_a_silent_mode(away_by: float) -> None:
    system = structure([1.0, 1.0, 1.0], MIRROR, Constraint.at(1, 1.0))
    result = check(system, np.sqrt(2.0) * (1.0 + away_by))
    assert result.shape_error.max() < 1e-11


def test_soft_modes_of_graded_structures() -> None:
    # 0.1.0 found 47.6213 at degree of freedom 1, without an error.
    system = structure([100.0, 1e4, 10.0], GRADED, Constraint((2,), (1.0,), 0.0, 1.0))
    result = check(system, 363.0)
    assert result.shape[0, 1] == pytest.approx(47.7164, abs=5e-5)
    assert result.shape_error[0, 1] < 1e-8


@pytest.mark.parametrize("above", [1e-9, 1e-8, 1e-6, 1e-4, 2e-3])
def test_just_above_the_spectrum(above: float) -> None:
    # 0.1.0 left the struck mass at 1.000000185 and was not certain that the motion exists.
    system = presets.chain(20, [Constraint.at(2, 1.0)])
    result = check(system, 2.0 * np.sin(20.0 * np.pi / 42.0) * (1.0 + above))
    assert result.shape[0, 2] == 1.0
    assert result.relative_error[0] < 1e-14
    assert result.certified[0]
    assert result.exists[0]


@pytest.mark.parametrize("Omega", [0.3, 0.7, 1.3, 2.2, 5.0])
def test_no_impulse_acts_on_free_bodies(Omega: float) -> None:
    # 0.1.0 found impulses out of noise, some of them admissible: momentum is conserved.
    chain = [[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]]
    system = structure([1.0, 1.0, 1.0], chain, Constraint((1,), (1.0,), None, 1.0))
    result = solve(system, Omega)
    assert modes.REASONS[result.reason[0]] == "singular"
    assert not result.exists[0]


def test_bounds_near_singular_frequencies() -> None:
    # 0.1.0 stated 4.5e-2 and erred by 4.9e-2.
    walls = Constraint((0,), (1.0,), 0.0, 3.2200620943787395)
    system = structure([0.6801140002552635], [[1.4378109579437712]], walls)
    check(system, 1.4540359330193162)


def loaded(
    M: list[list[float]], K: list[list[float]], force: list[float], *limiters: Constraint
) -> System:
    full = [SymmetricMatrix.dense(matrix) for matrix in (M, K)]
    return System(full[0], full[1], limiters, force=np.array(force))


def test_loads_near_an_even_internal_resonance() -> None:
    # sin(gamma)/gamma, which multiplies the load, was taken for known to a rounding of itself.
    M = [[0.6929204481600969, 0.3370602173879349], [0.3370602173879349, 1.0]]
    K = [[1.0, -0.14124675883989335], [-0.14124675883989335, 0.33052695577030233]]
    system = loaded(M, K, [0.07229962570189417, 0.3358609376322913], Constraint.at(0, 1.0))
    check(system, 0.12877489840353637)


@pytest.mark.parametrize("off", [-(10.0**-9.9), -(10.0**-9.7), -(10.0**-9.4), 1e-9])
def test_errors_are_positive_next_to_poles_of_modes_that_hardly_take_part(off: float) -> None:
    # A square over a negative response was added to the error.
    K = [[0.01, -0.001], [-0.001, 4.0]]
    system = structure([1.0, 1.0], K, Constraint((0,), (1.0,), 1.0, None))
    highest = np.sqrt(np.linalg.eigvalsh(K)[-1])
    result = check(system, float(0.5 * highest * (1.0 + off)))
    assert result.relative_error[0] > 1e-16
    assert result.energy_error[0] > 0.0


@pytest.mark.parametrize("away_by", [1e-15, 1e-12, -1e-12, 1e-8])
def test_impulses_next_to_zero_at_an_even_internal_resonance(away_by: float) -> None:
    # One wall and a load: stated errors were 1e-8 of the true ones.
    system = loaded([[1.0]], [[4.0]], [0.5], Constraint((0,), (1.0,), None, 1.0))
    check(system, 1.0 + away_by)


def test_ill_conditioned_masses_above_the_spectrum() -> None:
    # The power series solved with M, and stated roundings of its entries as the error.
    Q = np.linalg.qr(np.random.default_rng(3).normal(size=(4, 4)))[0]
    M = (Q * np.array([1.0, 1e-3, 1e-6, 1e-9])) @ Q.T
    K = np.diag([1.0, 2.0, 3.0, 4.0])
    M = 0.5 * (M + M.T)
    system = loaded(M.tolist(), K.tolist(), [0.0] * 4, Constraint.at(1, 1.0))
    largest = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.max())
    result = check(system, float(1.3 * largest))
    assert result.shape_error.max() < 1e-9


def test_impulses_that_cancel_above_the_spectrum() -> None:
    # Both limiters at their walls leave nothing for the second mass: it is at 0 exactly.
    limiters = [Constraint.at(0, 1.0), Constraint((0, 1), (1.0, 0.5), 1.0, 1.0)]
    system = structure([0.5, 0.05], [[497.2, -497.1], [-497.1, 497.1]], *limiters)
    check(system, 110.0)


def test_single_limiters_keep_all_digits_above_the_spectrum() -> None:
    system = presets.chain(7, [Constraint.at(1, 1.0), Constraint.at(4, 1.0)])
    result = check(system, 30.0)
    assert result.shape_error[0, 6] < 1e-13 * abs(result.shape[0, 6]) < 1e-18


@pytest.mark.parametrize("lower", [None, 1.0])
def test_no_warning_without_stiffness(lower: float | None) -> None:
    system = structure([1.0, 1.0], [[0.0, 0], [0, 0]], Constraint((0,), (1.0,), lower, 1.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = solve(system, 1.0)
    assert result.exists[0] == (lower is not None)


def test_limiters_that_depend_to_rounding_are_refused() -> None:
    # (0.1, 0.3) and (0.3, 0.9), which no doubles are.
    limiters = [Constraint((0, 1), (w, 3.0 * w), 1.0, 1.0) for w in (0.1, 0.3)]
    system = structure([1.0, 1.0], [[2.0, -1], [-1, 2]], *limiters)
    with pytest.raises(ModelError, match="not unique"):
        solve(system, 1.0)


def test_dependent_limiters_are_refused() -> None:
    # 0.1.0 answered with noise: the impulses at three limiters of two coordinates are not unique.
    limiters = [
        Constraint.at(0, 1.0),
        Constraint.at(1, 1.0),
        Constraint((0, 1), (1.0, 1.0), 2.0, 2.0),
    ]
    system = structure([1.0, 1.0], [[2.0, -1], [-1, 2]], *limiters)
    with pytest.raises(ModelError, match="not unique"):
        solve(system, 1.0)
    assert solve(system, 1.0, (0, 2)).impulse is not None


@pytest.mark.parametrize(
    ("beyond", "reason"), [(1e-6, "ok"), (2e-16, "ok"), (-2e-16, "penetration")]
)
def test_ball_arithmetic_decides_what_doubles_leave_open(beyond: float, reason: str) -> None:
    """The idle limiter is where the motion turns, to a rounding and less."""
    full = [SymmetricMatrix.dense(A) for A in (np.eye(3).tolist(), MIRROR)]
    plain = System(full[0], full[1], (Constraint.at(1, 1.0),))
    # Far above the spectrum the first mass is farthest from rest at tau = 1.
    furthest = abs(float(exact(plain, 7.0, ()).displacement(1.0)[0].mid()))
    wall = furthest * (1.0 + beyond)
    system = System(full[0], full[1], (Constraint.at(1, 1.0), Constraint.at(0, wall)))
    result = check(system, 7.0, (0,))
    assert result.certified is not None
    assert result.extended is not None
    assert result.certified[0]
    assert modes.REASONS[result.reason[0]] == reason
    assert result.extended[0] == (abs(beyond) < 1e-15)


def test_grids_of_frequencies_stay_with_doubles() -> None:
    system = presets.chain(3, [Constraint.at(1, 1.0)])
    few, many = (modes.Problem(system, np.linspace(1.0, 2.0, count)) for count in (16, 17))
    steps = [modes.plan(one).step(Stage.EXISTENCE) for one in (few, many)]
    assert ["ball arithmetic" in step.reason for step in steps if step is not None] == [True, False]


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("further", [frozenset(), frozenset({"stability"})])
@pytest.mark.parametrize("n", [8, 260])
def test_nothing_is_certified_by_estimates(n: int, further: frozenset[str]) -> None:
    """Without all natural modes, and with them however many there are."""
    M, K = np.eye(n), 2.0 * np.eye(n) - 0.5 * np.eye(n, k=1) - 0.5 * np.eye(n, k=-1)
    M[0, 1] = M[1, 0] = 0.1
    full = [SymmetricMatrix.dense(A.tolist()) for A in (M, K)]
    system = System(full[0], full[1], (Constraint.at(1, 1.0),))
    problem = modes.Problem(system, np.array([1.3]), (), frozenset({"exists"}) | further)
    plan = modes.plan(problem)
    assert (plan.step(Stage.SPECTRUM) is None) == (n > 256 and not further)
    result = modes.solve(problem, plan)
    proved = n <= 256 or bool(further)
    assert result.error_statement.startswith("bounds" if proved else "estimate")
    assert result.certified is not None
    assert result.certified[0] == proved
