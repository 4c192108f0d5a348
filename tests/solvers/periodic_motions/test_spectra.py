"""Multipliers where natural frequencies are equal or nearly so, and where impacts take all."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
from flint import acb_mat, arb
from scipy.optimize import linear_sum_assignment

from tests.reference.periodic import Impact, Motion, Structure
from tests.truth.periodic_motions import check
from tests.truth.verdicts import Case, Report
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.periodic_motions import monodromy
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.results.impact_modes import Reason

COUPLED = np.array([[2.0, -1.0], [-1.0, 2.0]]), np.diag([0.2, 0.0])


def problem(
    K: Any, C: Any, w: Any, upper: float, k: float, dof: int, Omega: float, **options: Any
) -> driven.Problem:
    """Return a problem of masses of 1 with a stop along a direction, driven at one dof."""
    n = len(K)
    wall = Constraint(tuple(range(n)), tuple(np.array(w, float).tolist()), None, upper, k)
    M, C, K = (SymmetricMatrix.dense(A) for A in (np.eye(n), np.asarray(C), np.asarray(K)))
    load = (driven.Force((dof,), (1.0,), 1.0),)
    return driven.Problem(System(M, K, (wall,), C=C), np.array([Omega]), load, **options)


def solved(given: driven.Problem) -> driven.Result:
    return driven.solve(given, driven.plan(given))


def exact_multipliers(given: driven.Problem, result: driven.Result, row: int) -> np.ndarray:
    """Return the multipliers of a solution with one impact in a period, in ball arithmetic."""
    n, motion = given.system.n, motion_of(given)
    at = int(np.flatnonzero(result.impact_solution == row)[0])
    phase, p, _, state = motion.refined(float(result.impact_phase[at]))
    matrix = motion.monodromy(phase, state, p)
    places = range(2 * n)
    middle = acb_mat([[matrix[i, j].mid() for j in places] for i in places])
    return np.array([complex(value.mid()) for value in middle.eig(algorithm="approx")])


def motion_of(given: driven.Problem) -> Motion:
    """Return the reference of motions with one impact in a period."""
    system, n = given.system, given.system.n
    (wall,) = system.constraints
    w = np.zeros(n)
    w[list(wall.dofs)] = wall.weights
    assert system.C is not None
    assert wall.upper is not None
    matrices = (A.to_dense() for A in (system.M, system.C, system.K))
    loads = [(f.dofs[0], f.amplitude, f.harmonic, f.phase) for f in given.load]
    structure = Structure(*matrices, np.zeros(n), loads, float(given.Omega[0]))
    return Motion(structure, Impact(w, wall.upper, 1, wall.restitution), 1.0, 1)


def compared(given: driven.Problem, largest_error: float) -> driven.Result:
    """Return the result, after all its multipliers were compared with exact ones."""
    result = solved(given)
    struck = np.flatnonzero(result.solution_impacts)
    assert struck.size == 2
    assert result.multipliers_real is not None
    assert result.multipliers_imaginary is not None
    assert result.error_multipliers_real is not None
    for row in struck.tolist():
        values = result.multipliers_real[row] + 1j * result.multipliers_imaginary[row]
        errors = result.error_multipliers_real[row]
        expected = exact_multipliers(given, result, row)
        assert values.size == expected.size
        assert (errors < largest_error).all()
        apart = np.abs(values[:, np.newaxis] - expected)
        ours, theirs = linear_sum_assignment(apart)
        assert (apart[ours, theirs] <= errors[ours] + 1e-15 * np.abs(expected[theirs])).all()
    return result


def test_five_equal_frequencies_hide_no_unstable_motion() -> None:
    direction = (-0.7, -0.19, 1.77, 1.72, 0.86, 0.33)
    K, C = np.diag([1.0] * 5 + [3.0]), np.diag([0.26] * 5 + [0.52])
    result = compared(problem(K, C, direction, 0.48, 0.58, 1, 0.9), 1e-11)
    values = result.multipliers_real
    assert values is not None
    assert values.min() == pytest.approx(-1.12995251, abs=5e-9)
    assert result.solution_stability is not None
    assert result.solution_stability.max() == pytest.approx(1.12995251, abs=5e-9)


def test_the_largest_alone_is_the_unstable_one() -> None:
    direction = (-0.7, -0.19, 1.77, 1.72, 0.86, 0.33)
    K, C = np.diag([1.0] * 5 + [3.0]), np.diag([0.26] * 5 + [0.52])
    outputs = frozenset({"stability"})
    result = solved(problem(K, C, direction, 0.48, 0.58, 1, 0.9, outputs=outputs))
    assert result.solution_stability is not None
    assert result.error_stability is not None
    assert result.solution_stability.max() == pytest.approx(1.12995251, abs=5e-9)
    assert (result.error_stability < 1e-11).all()


def test_two_equal_modes_have_small_errors() -> None:
    compared(problem(np.eye(2), 0.1 * np.eye(2), (1.0, 1.0), 0.5, 0.7, 0, 1.3), 1e-12)


@pytest.mark.parametrize("exponent", range(-14, -5))
@pytest.mark.parametrize("count", [2, 4])
def test_nearly_equal_frequencies(exponent: int, count: int) -> None:
    K = np.diag([*(1.0 + 10.0**exponent * np.arange(count)), 3.0])
    C = 0.1 * np.eye(count + 1)
    direction = np.array([1.0, -0.7, 0.6, 0.9, 0.4])[: count + 1]
    compared(problem(K, C, direction, 0.5, 0.7, 0, 0.9), 1e-11)


@pytest.mark.parametrize("k", [0.0, 1e-12, 1e-6])
def test_impacts_that_take_all_of_the_velocity(k: float) -> None:
    """Of damping that couples modes: 0, or nearly, is a multiplier."""
    result = compared(problem(*COUPLED, (1.0, 0.0), 0.1, k, 0, 1.2), 1e-12)
    assert result.solution_stability is not None
    largest = np.sort(result.solution_stability[result.solution_impacts > 0])
    assert largest == pytest.approx([0.348598, 0.485354], abs=1e-6)


@pytest.mark.parametrize("turns", [0.5, 1.0, 2.0, 1.5 + 1e-9])
def test_modes_that_turn_by_half_turns(turns: float) -> None:
    """Both multipliers of such a mode are one, but for what the impacts make of them."""
    K, C = np.diag([1.0, 1.7]), np.diag([0.05, 0.1])
    Omega = float(np.sqrt(1.0 - 0.025**2)) / turns
    compared(problem(K, C, (1.0, 0.8), 0.1, 0.7, 1, Omega), 1e-11)


@pytest.mark.parametrize("k", [0.0, 0.6])
def test_sequences_of_equal_modes_have_all_multipliers(k: float) -> None:
    """Two impacts in a period, against the product of dense matrices."""
    K, C = np.diag([1.0, 1.0, 1.0, 2.5]), np.diag([0.1, 0.1, 0.1, 0.2])
    w, n = np.array([0.9, -0.5, 0.7, 0.4]), 4
    given = problem(K, C, w, 0.4, k, 0, 0.8, sequence=(driven.Impact(0), driven.Impact(0)))
    result = solved(given)
    assert result.solution_impacts.max() == 2
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]])
    period = 2.0 * np.pi / 0.8
    X = np.linalg.solve(K - 0.64 * np.eye(n) + 0.8j * C, np.eye(n)[0])
    kick, slope, form = (
        np.append(np.zeros(n), w), np.append(np.zeros(n), w), np.append(w, np.zeros(n))
    )  # fmt: skip
    whole = np.linalg.inv(np.eye(2 * n) - scipy.linalg.expm(A * period))
    for row in np.flatnonzero(result.solution_impacts == 2):
        at = np.flatnonzero(result.impact_solution == row)
        times, p = result.impact_phase[at] / 0.8, -result.impact_momentum[at]
        matrix = np.eye(2 * n)
        for i in (0, 1):
            later = (times[i] - times) % period
            later[i] = 0.0
            turn = np.exp(0.8j * times[i])
            after = np.append((X * turn).real, (0.8j * X * turn).real)
            for j in (0, 1):
                after = after + scipy.linalg.expm(A * later[j]) @ whole @ kick * p[j]
            force = np.append(np.eye(n)[0] * turn.real, np.zeros(n))[np.r_[n : 2 * n, :n]]
            before = after - kick * p[i]
            law = np.eye(2 * n) - (1.0 + k) / (w @ w) * np.outer(kick, slope)
            jump = A @ after + force - law @ (A @ before + force)
            saltation = law + np.outer(jump, form) / (slope @ before)
            wait = (times[1 - i] - times[i]) % period
            matrix = scipy.linalg.expm(A * wait) @ saltation @ matrix
        expected = np.linalg.eigvals(matrix)
        assert result.multipliers_real is not None
        assert result.multipliers_imaginary is not None
        assert result.error_multipliers_real is not None
        values = result.multipliers_real[row] + 1j * result.multipliers_imaginary[row]
        apart = np.abs(values[:, np.newaxis] - expected)
        ours, theirs = linear_sum_assignment(apart)
        allowed = result.error_multipliers_real[row][ours] + 1e-12
        assert (apart[ours, theirs] <= allowed).all()
        assert (allowed < 1e-9).all()


RANK_ONE = np.round(np.outer((-0.85, -0.34, 0.43), (-0.85, -0.34, 0.43)), 6)


@pytest.mark.parametrize("distance", [1e-7, -1e-7, 1e-5, 1e-3])
@pytest.mark.parametrize("struck", [1, 2])
def test_what_rounding_leaves_of_a_mode_beside_its_resonance(distance: float, struck: int) -> None:
    """It has no damping but roundings of C, and reaches the stop by them alone."""
    K, w = np.diag([1.0, 1.0, 3.0]), np.eye(3)[struck]
    given = problem(K, RANK_ONE, w, 0.2, 0.5, 0, 1.0 + distance)
    result, exact = solved(given), motion_of(given)
    assert result.impact_phase.size == 2
    for at in range(2):
        stated = float(result.impact_phase[at])
        phase, p, velocity, _ = exact.refined(stated)
        for true, value, error in (
            (phase, stated, result.error_phase[at]),
            (-p, result.impact_momentum[at], result.error_momentum[at]),
            (velocity, result.impact_velocity[at], result.error_velocity[at]),
        ):
            off = abs(float((true - arb(float(value))).mid()))
            assert off <= error
            assert error < 2e-13 / abs(distance) * max(1.0, abs(value))


@pytest.mark.parametrize("Omega", [0.9, 1.3])
def test_a_mode_that_damping_turns_away_from_the_stop(Omega: float) -> None:
    """Its participation is rounding, and its multipliers are free ones."""
    given = problem(np.diag([1.0, 1.0, 3.0]), RANK_ONE, np.eye(3)[2], 0.2, 0.5, 0, Omega)
    compared(given, 1e-10)


def test_two_impacts_beside_the_resonance_of_such_a_mode() -> None:
    """Their phases are as wrong as the response to the load: the same as of one, each period."""
    K, w, twice = np.diag([1.0, 1.0, 3.0]), np.eye(3)[2], (driven.Impact(0), driven.Impact(0))
    given = problem(K, RANK_ONE, w, 0.2, 0.5, 0, 1.0 + 1e-6, periods=2, sequence=twice)
    result, exact = solved(given), motion_of(given)
    known = [float(exact.refined(float(x))[0].mid()) for x in solved(
        problem(K, RANK_ONE, w, 0.2, 0.5, 0, 1.0 + 1e-6)
    ).impact_phase]  # fmt: skip
    again = 0
    for row in np.flatnonzero(result.solution_impacts == 2):
        at = np.flatnonzero(result.impact_solution == row)
        phase, error = result.impact_phase[at], result.error_phase[at]
        for true in known:
            if (np.abs(phase - true) < 1e-6).all():
                assert (np.abs(phase - true) <= error).all()
                assert (error < 1e-6).all()
                again += 1
    assert again >= 1


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("Omega", [1.0, 0.5])
@pytest.mark.parametrize("twice", [False, True])
def test_the_resonance_itself_of_such_a_mode(Omega: float, *, twice: bool) -> None:
    """What has no bound is not mixed with the rest."""
    C = np.diag([0.0, 0.1, 0.2])
    C[1, 2] = C[2, 1] = 0.05
    impacts = (driven.Impact(0),) * (1 + twice)
    for struck in ((1.0, 0.3, 1.0), (0.0, 0.3, 1.0)):
        outputs = frozenset(driven.OUTPUTS) - {"waveform"}
        given = problem(
            np.diag([1.0, 1.2, 3.0]), C, struck, 0.2, 0.5, 0, Omega,
            sequence=impacts, outputs=outputs,
        )  # fmt: skip
        result = solved(given)
        (row,) = np.flatnonzero(result.solution_impacts == 0)
        assert result.solution_reason is not None
        assert (result.solution_reason[row] == Reason.SINGULAR) == (Omega == 1.0)


@pytest.mark.filterwarnings("error")
def test_what_has_decayed_in_a_period_is_no_missing_multiplier() -> None:
    K, C = np.diag([1.0, 2.0]), np.array([[500.0, 1.0], [1.0, 0.1]])
    result = solved(problem(K, C, (1.0, 1.0), 0.1, 0.7, 1, 1.1))
    assert result.multipliers_real is not None
    assert np.isfinite(result.multipliers_real).all()
    assert (result.solution_impacts > 0).any()


def structure_of(given: driven.Problem) -> Driven:
    return Driven.of(given, spectrum.choose(given.system))


def coupled_pairs(prepared: Driven) -> int:
    """Return how many pairs take part in impacts on the first stop."""
    return int((prepared.kick[0] != 0.0).any(axis=0).sum())


class TestTurnedModes:
    """Of modes with equal frequencies as few as can be take part in impacts."""

    DIRECTION = (0.9, -0.5, 0.7, 0.4, 1.1)

    @pytest.mark.parametrize(
        ("C", "pairs"),
        [
            (0.1 * np.eye(5), 2),
            (np.diag([0.1, 0.1, 0.2, 0.2, 0.3]), 3),
            (np.diag([0.1, 0.1, 0.1, 0.2, 0.3]), 3),
            (np.outer((1.0, 0.5, 0.0, 0.2, 0.3), (1.0, 0.5, 0.0, 0.2, 0.3)), 3),
        ],
    )
    def test_the_others_keep_their_multipliers(self, C: np.ndarray, pairs: int) -> None:
        given = problem(np.diag([1.0] * 4 + [3.0]), C, self.DIRECTION, 0.4, 0.7, 0, 0.8)
        prepared = structure_of(given)
        assert coupled_pairs(prepared) == pairs
        modes = prepared.basis.modes
        assert modes.shapes.T @ modes.weighted == pytest.approx(np.eye(5), abs=1e-14)
        compared(given, 1e-11)

    def test_two_stops_leave_two_vectors(self) -> None:
        n, K = 5, np.diag([1.0] * 4 + [3.0])
        one = problem(K, 0.1 * np.eye(n), self.DIRECTION, 0.4, 0.7, 0, 0.8)
        other = Constraint((0,), (1.0,), None, 9.0, 0.7)
        system = System(
            one.system.M, one.system.K, (*one.system.constraints, other), C=one.system.C
        )
        two = driven.Problem(system, one.Omega, one.load)
        kick = structure_of(two).kick
        assert (kick != 0.0).any(axis=(0, 1)).sum() == 3
        assert solved(two).impact_phase == pytest.approx(solved(one).impact_phase, abs=1e-12)

    def test_frequencies_that_differ_by_more_than_their_errors_are_not_turned(self) -> None:
        K = np.diag([1.0, 1.0 + 1e-10, 3.0])
        given = problem(K, 0.1 * np.eye(3), (1.0, 0.5, 0.3), 0.4, 0.7, 0, 0.8)
        assert coupled_pairs(structure_of(given)) == 3

    def test_a_membrane_of_many_equal_frequencies(self) -> None:
        """A square net of masses: few of its frequencies belong to one mode."""
        side = 28
        line = 2.0 * np.eye(side) - np.eye(side, k=1) - np.eye(side, k=-1)
        K, n = np.kron(line, np.eye(side)) + np.kron(np.eye(side), line), side * side
        w = np.zeros(n)
        w[n // 2 + side // 2] = 1.0
        outputs = frozenset({"stability"})
        given = problem(K, 0.02 * K, w, 0.5, 0.7, 3 * side + 5, 0.6, outputs=outputs)
        prepared = structure_of(given)
        assert coupled_pairs(prepared) <= side * (side + 1) // 2
        result = solved(given)
        assert result.solution_stability is not None
        assert result.error_stability is not None
        assert np.isfinite(result.solution_stability).all()
        assert (result.error_stability < 1e-7 * np.maximum(result.solution_stability, 1.0)).all()


def test_multipliers_of_what_has_decayed_are_unknown_without_a_warning() -> None:
    """Eigenvectors that are one but for 1e-292 have inverses whose squares no double holds."""
    one, none = np.eye(2)[np.newaxis, ..., np.newaxis], np.zeros((1, 2, 2, 1))
    flows = np.where(one == 0.0, [[[[0.0], [1.0]], [[0.0], [0.0]]]], 0.0)
    factors = monodromy.Factors(
        flows, np.full((1, 1), 1e-16), none, none, np.zeros((1, 2, 2)), np.zeros((1, 2, 2)), 1e-16
    )
    values, errors = monodromy.eigenvalues(factors)
    assert not np.isnan(errors).any()
    assert np.isinf(errors).all() or (np.abs(values) <= errors).all()


@pytest.mark.parametrize("turn", np.linspace(0.0, 3.0, 7))
@pytest.mark.parametrize("size", [0.01, 0.5, 1.0, 2.0])
def test_two_values_that_eigenvectors_leave_coupled(
    size: float, turn: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``[[1, b], [c, -1]]`` has ``sqrt(1 + b c)``; eigenvectors that are rounded leave b, c."""
    couples = size * np.exp(1j * turn)
    matrix = np.array([[1.0, couples], [1.0, -1.0]])
    zeros = np.zeros((1, 2, 2))
    factors = monodromy.Factors(
        matrix[np.newaxis, ..., np.newaxis], np.zeros((1, 1)), zeros[..., np.newaxis],
        zeros[..., np.newaxis], zeros, zeros, 0.0,
    )  # fmt: skip
    rounded = np.array([1.0, -1.0], dtype=np.complex128), np.eye(2, dtype=np.complex128)
    monkeypatch.setattr(np.linalg, "eig", lambda _: rounded)
    values, errors = monodromy.eigenvalues(factors)
    exact = np.sqrt(1.0 + couples) * np.array([1.0, -1.0])
    assert sorted(values.real) == [-1.0, 1.0]
    assert (np.abs(values - exact * np.sign(values.real * exact.real)) <= errors).all()
    assert (errors <= 2.0 * np.sqrt(size) + 1e-14).all()


def test_what_is_likely_beyond_a_wall_is_no_motion_though_it_is_not_certain() -> None:
    """Close beside the resonance of a mode without damping: .076 too far, known to .6."""
    C = np.array(
        [[0.2660769237997415, 0.21548483265472024], [0.21548483265472024, 0.17451236447389315]]
    )
    wall = Constraint((0,), (1.0,), None, 1.0, 0.0)
    M, C, K = (
        SymmetricMatrix.dense(A) for A in (np.eye(2), C, np.diag([2.301, 2.301000009078063]))
    )
    load = (driven.Force((0,), (2.3470235315751102,), 1.0),)
    result = solved(
        driven.Problem(System(M, K, (wall,), C=C), np.array([1.5169048195828825]), load)
    )
    beyond = np.flatnonzero(result.solution_impacts)[0]
    assert result.solution_x_max is not None
    assert result.error_x_max is not None
    assert 1.05 < result.solution_x_max[beyond, 0] < 1.1
    assert result.error_x_max[beyond, 0] > 0.3
    assert result.solution_reason[beyond] == Reason.PENETRATION
    assert not result.solution_certified[beyond]


def test_a_peak_soon_after_an_impact_with_an_inflection_before_it() -> None:
    """An impact that takes all leaves the stop at rest, 2e-5 beyond which it goes at first."""
    document = {
        "M": np.eye(3).tolist(),
        "K": [
            [4.3059691198647005, -0.10536945592141328, -0.057539809361902734],
            [-0.10536945592141328, 3.9222578345358703, -0.22429674416585887],
            [-0.057539809361902734, -0.22429674416585887, 4.21051676435129],
        ],
        "C": np.diag([0.0, 0.48757912225556715, 0.0]).tolist(),
        "symmetric": False,
        "constraints": [
            {"dofs": [0], "weights": [1.0], "lower": None, "upper": 1.0, "restitution": 0.0}
        ],
        "force": [0.0] * 3, "loads": [[0, 9.10248312750507, 1, 0.0]], "periods": 1, "side": 1,
        "Omega": [1.177751868287685, 2.920668791245157],
    }  # fmt: skip
    report = Report()
    check(Case("a peak", document), report)
    assert report.failures == []
    assert report.counts["solutions"] > 0


def test_the_higher_one_of_two_peaks_that_no_parabola_tells() -> None:
    """They are 3e-10 apart, and the nodes beside the second one rise too little to show it."""
    document = {
        "M": np.eye(2).tolist(), "K": [[1.25, -0.25], [-0.25, 1.25]],
        "C": [[0.0036189626488561293, 0.0], [0.0, 0.0]], "symmetric": False,
        "constraints": [
            {"dofs": [1], "weights": [1.0], "lower": None, "upper": 1.0, "restitution": 1.0}
        ],
        "force": [0.0, 0.0], "loads": [[1, 1.4734447822026784, 1, 0.0]], "periods": 1, "side": 1,
        "Omega": [0.969535994267321, 4.406007740563203],
    }  # fmt: skip
    report = Report()
    check(Case("two peaks", document), report)
    assert report.failures == []
    assert report.counts["solutions"] > 0
