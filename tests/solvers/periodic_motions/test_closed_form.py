"""Motions with one impact per cell, against ball arithmetic without modes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from flint import arb, arb_mat
from scipy.optimize import linear_sum_assignment

from tests.reference.periodic import Impact, Motion, Structure
from vibroimpact_solvers import impact_modes
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers.errors import ModelError, PlanError
from vibroimpact_solvers.laws import Law, Linear, Rigid
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Stage
from vibroimpact_solvers.results.impact_modes import Reason

NEGATIVE = 1  # impulse
TWO_PI = 2.0 * np.pi


@dataclass
class Case:
    """A random driven structure."""

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    force: np.ndarray
    constraint: Constraint
    loads: list[tuple[int, float, int, float]]
    Omega: np.ndarray
    periods: int
    side: int
    symmetric: bool

    @classmethod
    def random(cls, seed: int) -> Case:
        """Return one with 1 to 5 degrees of freedom and damping from 0.1 to 20 %."""
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 6))
        spread = rng.standard_normal((3, n, n))
        M = np.diag(rng.uniform(0.5, 2.0, n)) + 0.1 * (seed % 2) * spread[0] @ spread[0].T / n
        K = spread[1] @ spread[1].T + 0.3 * np.eye(n)
        ratio = 10.0 ** rng.uniform(-3.0, -0.7)
        coupled = spread[2] @ spread[2].T / n + 0.05 * np.eye(n)
        C = ratio * (K + M) if seed % 3 else 2.0 * ratio * coupled
        symmetric = seed % 4 == 0
        upper = float(rng.uniform(0.1, 1.0))
        lower = upper if symmetric else (None if seed % 2 else float(rng.uniform(0.1, 1.0)))
        dofs, weights = (
            ((0, n - 1), (1.0, -0.5)) if n > 1 and seed % 5 == 0 else ((n // 2,), (1.0,))
        )
        constraint = Constraint(dofs, weights, lower, upper, float(rng.uniform(0.1, 1.0)))
        force = np.zeros(n) if symmetric or seed % 2 else 0.3 * rng.standard_normal(n)
        harmonics = [1] if seed % 3 else ([1, 3] if symmetric else [1, 2])
        loads = [
            (int(rng.integers(n)), float(rng.uniform(0.3, 2.0)), h, float(rng.uniform(0.0, 6.0)))
            for h in harmonics
        ]
        lowest = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.min())
        Omega = np.sort(rng.uniform(0.3, 3.0, 2)) * lowest
        side = -1 if lower is not None and not symmetric and seed % 3 == 0 else 1
        sym = [0.5 * (A + A.T) for A in (M, C, K)]
        periods = 2 if not symmetric and seed % 7 == 0 else 1
        return cls(*sym, force, constraint, loads, Omega, periods, side, symmetric)

    @property
    def system(self) -> System:
        """The system of the solvers."""
        M, C, K = (SymmetricMatrix.dense(A) for A in (self.M, self.C, self.K))
        return System(M, K, (self.constraint,), C=C, force=self.force)

    @property
    def problem(self) -> driven.Problem:
        """The problem of the solvers."""
        load = tuple(driven.Force((d,), (1.0,), a, h, p) for d, a, h, p in self.loads)
        sequence: Any = driven.SYMMETRIC if self.symmetric else (driven.Impact(0, self.side),)
        return driven.Problem(
            self.system, self.Omega, load, periods=self.periods, sequence=sequence
        )

    def motion(self, Omega: float) -> Motion:
        """Return the reference of the motions at a frequency."""
        w = np.zeros(self.M.shape[0])
        w[list(self.constraint.dofs)] = self.constraint.weights
        wall = self.constraint.upper if self.side > 0 else self.constraint.lower
        assert wall is not None
        impact = Impact(w, self.side * wall, self.side, self.constraint.restitution)
        structure = Structure(self.M, self.C, self.K, self.force, self.loads, Omega)
        half = 0.5 if self.symmetric else 1.0
        return Motion(structure, impact, self.periods * half, -1 if self.symmetric else 1)


def solved(problem: driven.Problem) -> driven.Result:
    return driven.solve(problem, driven.plan(problem))


def off(reference: arb, value: float) -> float:
    return abs(float((reference - arb(value)).mid()))


def within_errors_of_energies(
    motion: Motion, result: driven.Result, row: int, phase: arb, state: arb_mat, velocity: arb
) -> None:
    work, lost = result.solution_work[row], result.solution_energy_lost[row]
    assert abs(work - lost) <= 1e-12 * lost
    k = arb(motion.impact.restitution)
    true_work, damped = motion.energies(phase, state)
    impact = (1 - k * k) / (2 * motion.mu) * velocity * velocity
    both = 2 if motion.sign < 0 else 1
    assert off(both * true_work, work) <= result.error_work[row]
    assert off(both * (damped + impact), lost) <= result.error_energy_lost[row]
    assert result.error_work[row] <= 1e-9 * work
    assert result.error_energy_lost[row] <= 1e-9 * work


@pytest.mark.parametrize("seed", range(24))
def test_every_number_is_within_its_error(seed: int) -> None:
    case = Case.random(seed)
    result = solved(case.problem)
    assert (result.solution_impacts > 0).any() or seed > 0
    for row in np.flatnonzero(result.solution_impacts):
        motion = case.motion(float(result.solution_Omega[row]))
        at = int(np.flatnonzero(result.impact_solution == row)[0])
        phase, p, velocity, state = motion.refined(float(result.impact_phase[at]))
        apart = off(phase, float(result.impact_phase[at]))
        assert min(apart, abs(apart - TWO_PI)) <= result.error_phase[at]
        assert off(-case.side * p, float(result.impact_momentum[at])) <= result.error_momentum[at]
        assert off(velocity, float(result.impact_velocity[at])) <= result.error_velocity[at]
        # The velocity is the momentum by a number that is known: it is known no better.
        doubt = result.error_momentum[at] / abs(result.impact_momentum[at])
        assert result.error_velocity[at] >= doubt * abs(result.impact_velocity[at]) * (1.0 - 1e-12)
        within_errors_of_energies(motion, result, row, phase, state, velocity)
        path = motion.path(phase, state, 301)
        path = np.concatenate([path, -path]) if case.symmetric else path
        highest, scale = path.max(axis=0), np.abs(path).max()
        assert (result.solution_x_max[row] >= highest - result.error_x_max[row]).all()
        assert (result.solution_x_max[row] <= highest + 3e-3 * scale).all()
        y = path @ motion.impact.w
        over = float((y - case.constraint.upper).max())
        if case.constraint.lower is not None:
            over = max(over, float((-case.constraint.lower - y).max()))
        if result.solution_reason[row] != NEGATIVE and not 1e-10 < over < 1e-3:
            near = result.solution_reason[row] == 3 and over > -1e-4  # between the points
            assert result.solution_exists[row] == (over <= 1e-10) or near


@pytest.mark.parametrize(
    ("ratio", "Omega"),
    [(1e-4, 8.0), (1e-3, 1.0 + 1e-4)],
    ids=["the power flows back", "the load's own response is far larger"],
)
def test_work_is_what_is_lost_to_the_last_digits(ratio: float, Omega: float) -> None:
    """Above resonance the power's integral cancels, in resonance that of the parts does."""
    case = replace(
        Case.random(1), M=np.diag([1.0, 2.0]), K=np.array([[3.0, -1.0], [-1.0, 4.0]]),
        C=ratio * np.array([[3.0, -1.0], [-1.0, 2.0]]), force=np.zeros(2),
        constraint=Constraint((0,), (1.0,), None, 0.01, 0.6), loads=[(0, 1.0, 1, 0.3)],
        periods=1, side=1, symmetric=False,
    )  # fmt: skip
    lowest = np.sqrt(np.linalg.eigvals(np.linalg.solve(case.M, case.K)).real.min())
    case = replace(case, Omega=np.array([Omega * lowest]))
    result = solved(case.problem)
    motion = case.motion(float(case.Omega[0]))
    struck = np.flatnonzero(result.solution_impacts)
    assert struck.size == 2
    for row in struck:
        at = int(np.flatnonzero(result.impact_solution == row)[0])
        phase, _, velocity, state = motion.refined(float(result.impact_phase[at]))
        within_errors_of_energies(motion, result, row, phase, state, velocity)


class TestModesThatAreAlike:
    """Near the exceptional point of two oscillators, where damping makes two modes one."""

    def _case(self, apart: float) -> Case:
        def damped(g: float, d: float) -> np.ndarray:
            K = np.array([[1.0, 0.05], [0.05, 1.0 + d]])
            return np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -np.diag([2.0 * g, 0.0])]])

        def distance(p: np.ndarray) -> list[float]:
            rates = np.linalg.eigvals(damped(*p))
            one, other = rates[rates.imag > 0.0]
            square = complex(one - other) ** 2
            return [square.real, square.imag]

        g, d = scipy.optimize.root(distance, [0.05, -0.0025], tol=1e-14).x
        return replace(
            Case.random(1), M=np.eye(2), K=np.array([[1.0, 0.05], [0.05, 1.0 + d]]),
            C=np.diag([2.0 * g * (1.0 + apart), 0.0]), force=np.zeros(2),
            constraint=Constraint((0,), (1.0,), None, 0.2, 0.6), loads=[(1, 1.0, 1, 0.3)],
            Omega=np.array([1.3]), periods=1, side=1, symmetric=False,
        )  # fmt: skip

    @pytest.mark.parametrize("apart", [1e-2, 1e-5, 1e-9])
    def test_numbers_are_within_their_errors(self, apart: float) -> None:
        case = self._case(apart)
        result = solved(case.problem)
        motion = case.motion(1.3)
        assert motion.s.condition() > 0.1 / np.sqrt(apart)
        struck = np.flatnonzero(result.solution_impacts)
        assert struck.size == 2
        for row in struck:
            at = int(np.flatnonzero(result.impact_solution == row)[0])
            phase, p, velocity, state = motion.refined(float(result.impact_phase[at]))
            assert off(phase, float(result.impact_phase[at])) <= result.error_phase[at]
            assert result.error_phase[at] < 1e-12 / apart
            assert off(-p, float(result.impact_momentum[at])) <= result.error_momentum[at]
            assert off(velocity, float(result.impact_velocity[at])) <= result.error_velocity[at]
            expected = motion.multipliers(phase, state)
            values = result.multipliers_real[row] + 1j * result.multipliers_imaginary[row]
            apart_from = np.abs(values[:, np.newaxis] - expected)
            ours, theirs = linear_sum_assignment(apart_from)
            allowed = result.error_multipliers_real[row] + 1e-9 * np.abs(expected).max()
            assert (apart_from[ours, theirs] <= allowed[ours]).all()


@pytest.mark.parametrize("seed", [1, 2, 4, 9, 12])
def test_multipliers_are_those_of_differences(seed: int) -> None:
    case = Case.random(seed)
    result = solved(case.problem)
    for row in np.flatnonzero(result.solution_impacts):
        motion = case.motion(float(result.solution_Omega[row]))
        at = int(np.flatnonzero(result.impact_solution == row)[0])
        phase, _, _, state = motion.refined(float(result.impact_phase[at]))
        expected = motion.multipliers(phase, state)
        expected = expected**2 if case.symmetric else expected
        values = result.multipliers_real[row] + 1j * result.multipliers_imaginary[row]
        apart = np.abs(values[:, np.newaxis] - expected)
        ours, theirs = linear_sum_assignment(apart)
        # Differences of 1e-15 in 50 digits are exact to 1e-9 where nothing grazes.
        allowed = result.error_multipliers_real[row] + 1e-9 * np.abs(expected).max()
        assert (apart[ours, theirs] <= allowed[ours]).all()
        assert result.solution_stability[row] == pytest.approx(np.abs(values).max())


@pytest.mark.parametrize("seed", range(12))
def test_no_solution_is_missed(seed: int) -> None:
    """A dense search over the phase finds as many roots as there are solutions."""
    case = Case.random(seed)
    result = solved(case.problem)
    for index, Omega in enumerate(case.Omega):
        motion = case.motion(float(Omega))
        phases = np.linspace(0.0, TWO_PI, 241)
        values = [float(motion.at(arb(float(phase)))[0].mid()) for phase in phases]
        crossings = int((np.diff(np.signbit(values)) != 0).sum())
        rows = (result.solution_frequency_index == index) & (result.solution_impacts > 0)
        assert rows.sum() >= crossings
        assert rows.sum() <= crossings + 2  # two roots between neighbouring phases


@pytest.mark.parametrize("small", [1e-3, 1e-5])
@pytest.mark.parametrize("law", [Rigid(1.0), Linear(10.0, 0.0)])
def test_the_higher_of_almost_equal_peaks_is_the_extreme(law: Law, small: float) -> None:
    """Where twice the drive's frequency dominates, a period has two peaks of almost one height."""
    M, C, K = np.eye(1), 0.02 * np.eye(1), np.eye(1)
    far = Constraint((0,), (1.0,), None, 1e3, law=law)
    matrices = (SymmetricMatrix.dense(A) for A in (M, K))
    system = System(*matrices, (far,), C=SymmetricMatrix.dense(C))
    Omega = np.linspace(0.31, 0.69, 40)
    load = (driven.Force((0,), (1.0,), small), driven.Force((0,), (1.0,), 1.0, 2, 0.4))
    result = solved(driven.Problem(system, Omega, load, outputs=frozenset({"extremes"})))
    theta = np.linspace(0.0, TWO_PI, 200_001)
    for row, rate in enumerate(Omega):
        x = np.zeros_like(theta)
        for h, amplitude, phase in ((1, small, 0.0), (2, 1.0, 0.4)):
            response = amplitude / (1.0 - (h * rate) ** 2 + 0.02j * h * rate)
            x += (response * np.exp(1j * (h * theta + phase))).real
        bend = 4.0 * np.abs(x).max() * (theta[1] / 2.0) ** 2 / 2.0
        assert -1e-13 < result.solution_x_max[row, 0] - x.max() < bend
        assert -1e-13 < x.min() - result.solution_x_min[row, 0] < bend


def test_symmetric_motions_tend_to_impact_modes() -> None:
    """As damping, load and loss of energy vanish together, linearly in them."""
    n, Omega = 4, np.array([2.15])
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    one = SymmetricMatrix.diagonal(np.ones(n))
    stiff = SymmetricMatrix.dense(K)
    elastic = System(one, stiff, (Constraint.at(1, 1.0),))
    family = impact_modes.Problem(elastic, Omega * 2.0 / np.pi, Omega=Omega)
    p = impact_modes.solve(family, impact_modes.plan(family)).impulse[0, 0]
    expected = 2.0 * p / (Omega[0] * 2.0 / np.pi)
    differences = []
    for small in (1e-2, 1e-3, 1e-4):
        wall = Constraint.at(1, 1.0, restitution=1.0 - small)
        system = System(one, stiff, (wall,), C=SymmetricMatrix.dense(small * K))
        load = (driven.Force((0,), (1.0,), 50.0 * small),)
        result = solved(driven.Problem(system, Omega, load, sequence=driven.SYMMETRIC))
        momenta = result.impact_momentum[result.impact_side > 0]
        differences.append(np.abs(momenta - expected).min())
    assert differences[0] < 0.5 * expected
    assert differences[1] / differences[0] < 0.2
    assert differences[2] / differences[1] < 0.2


def test_without_load_and_loss_they_are_impact_modes() -> None:
    n, Omega = 5, np.array([0.7, 1.9, 2.2, 2.5])
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    system = System(
        SymmetricMatrix.diagonal(np.ones(n)), SymmetricMatrix.dense(K), (Constraint.at(2, 1.0),)
    )
    result = solved(driven.Problem(system, Omega, sequence=driven.SYMMETRIC))
    outputs = frozenset({"impulse", "reason", "stability"})
    family = impact_modes.Problem(system, Omega * 2.0 / np.pi, Omega=Omega, outputs=outputs)
    expected = impact_modes.solve(family, impact_modes.plan(family))
    momentum = result.impact_momentum[::2]
    assert momentum == pytest.approx(np.pi * expected.impulse[:, 0] / Omega, rel=1e-11)
    assert (result.solution_reason == expected.reason).all()
    unstable = expected.stability > 1.01
    assert result.solution_stability[unstable] == pytest.approx(
        expected.stability[unstable] ** 2, rel=1e-9
    )


def test_critical_damping_has_a_solution() -> None:
    case = replace(
        Case.random(1), M=np.eye(1), K=np.eye(1), C=2.0 * np.eye(1), force=np.zeros(1),
        constraint=Constraint((0,), (1.0,), None, 0.05, 0.5), loads=[(0, 1.0, 1, 0.0)],
        Omega=np.array([1.5]), periods=1, side=1, symmetric=False,
    )  # fmt: skip
    result = solved(case.problem)
    motion = case.motion(1.5)
    for row in np.flatnonzero(result.solution_impacts):
        at = int(np.flatnonzero(result.impact_solution == row)[0])
        phase, p, _, _ = motion.refined(float(result.impact_phase[at]))
        assert off(phase, float(result.impact_phase[at])) <= result.error_phase[at]
        assert off(-p, float(result.impact_momentum[at])) <= result.error_momentum[at]
    assert result.solution_impacts.max() == 1


class TestRefused:
    """What cannot be answered names its field or its reason."""

    WALL = Constraint((0,), (1.0,), None, 1.0, 0.5)
    ONE = SymmetricMatrix.diagonal([1.0])

    def _problem(self, **options: Any) -> driven.Problem:
        system = options.pop("system", System(self.ONE, self.ONE, (self.WALL,)))
        load = options.pop("load", (driven.Force((0,), (1.0,), 1.0),))
        return driven.Problem(system, np.array([1.3]), load, **options)

    @pytest.mark.parametrize(
        ("options", "field"),
        [
            ({"sequence": driven.SYMMETRIC}, "sequence"),
            ({"sequence": (driven.Impact(0, -1),)}, "sequence"),
            ({"sequence": (driven.Impact(1),)}, "sequence"),
            ({"sequence": ()}, "sequence"),
            ({"periods": 0}, "periods"),
            ({"load": (driven.Force((1,), (1.0,), 1.0),)}, "load"),
            ({"load": (driven.Force((0,), (1.0,), np.inf),)}, "load"),
            ({"load": (driven.Force((0,), (1.0,), 1.0, harmonic=0),)}, "load"),
            ({"outputs": frozenset({"waveform"})}, "tau"),
            ({"phases": np.zeros((1, 2))}, "start"),
        ],
    )
    def test_wrong_fields(self, options: dict[str, Any], field: str) -> None:
        with pytest.raises(ModelError) as caught:
            self._problem(**options)
        assert caught.value.pointer[0] == field

    def test_a_constant_load_on_a_rigid_body_that_no_impact_pushes_back(self) -> None:
        """Of two masses that nothing joins, that without a stop falls for ever."""
        two = SymmetricMatrix.diagonal([1.0, 1.0])
        nothing = SymmetricMatrix.diagonal([0.0, 0.0])
        free = System(two, nothing, (self.WALL,), force=np.array([1.0, 0.5]))
        problem = self._problem(system=free)
        with pytest.raises(PlanError, match="no impact of the sequence pushes back") as caught:
            solved(problem)
        assert caught.value.pointer == ("system", "force")


def test_the_order_of_multipliers_does_not_depend_on_rounding() -> None:
    """Without impacts all are on one circle, as the damping is proportional to the mass."""
    n = 6
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    one = np.ones(n)
    system = System(
        SymmetricMatrix.diagonal(one),
        SymmetricMatrix.dense(K),
        (Constraint((2,), (1.0,), None, 0.5, 0.8),),
        C=SymmetricMatrix.diagonal(0.05 * one),
    )
    load = (driven.Force((1,), (1.0,), 1.0),)
    result = solved(driven.Problem(system, np.linspace(0.3, 1.9, 17), load))
    values = result.multipliers_real + 1j * result.multipliers_imaginary
    free = result.solution_impacts == 0
    assert free.sum() == 17
    angles = np.angle(values[free])
    assert (angles[:, :n] >= 0.0).all()
    assert (angles[:, n:] <= 0.0).all()
    assert (np.diff(np.abs(angles[:, :n])) >= 0.0).all()
    assert (np.diff(np.abs(angles[:, n:])) >= 0.0).all()
    coupled = values[~free & np.isfinite(values).all(axis=1)]
    assert coupled.shape[0] > 5
    for row in coupled:
        above = np.flatnonzero(row.imag > 0.0)
        partner = np.abs(row[:, np.newaxis] - row[above].conj()).argmin(axis=0)
        assert (partner == above + 1).all()


@pytest.mark.parametrize(("damping", "n"), [(0.01, 40), (0.1, 40), (0.3, 25), (0.001, 25)])
def test_the_largest_multiplier_alone_is_that_of_all(damping: float, n: int) -> None:
    """It is the first of all of them, and its type is that of the first."""
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    wall = Constraint((n // 2,), (1.0,), None, 0.5, 0.8)
    one, stiff = SymmetricMatrix.diagonal(np.ones(n)), SymmetricMatrix.dense(K)
    system = System(one, stiff, (wall,), C=SymmetricMatrix.dense(damping * K))
    Omega = np.linspace(0.1, 1.9, 23)
    load = (driven.Force((1,), (1.0,), 1.0),)
    largest, every = (
        solved(driven.Problem(system, Omega, load, outputs=frozenset({name})))
        for name in ("stability", "multipliers")
    )
    assert (every.solution_impacts > 0).sum() > 10
    assert largest.multipliers_real is None
    apart = np.abs(largest.solution_stability - every.solution_stability)
    assert (apart <= largest.error_stability + every.error_stability).all()
    assert (every.error_stability < 1e-9 * np.maximum(1.0, every.solution_stability)).all()
    assert (largest.solution_bifurcation == every.solution_bifurcation).all()


@pytest.mark.parametrize(("Omega", "largest"), [(1.54, 5248.7), (1.9, 292.55)])
def test_multipliers_of_many_modes_are_those_of_the_dense_monodromy(
    Omega: float, largest: float
) -> None:
    """One is far outside the circle on which hundreds of others are crowded."""
    n, k = 300, 0.8
    d = n // 2
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    C = 0.02 * K
    one, stiff = SymmetricMatrix.diagonal(np.ones(n)), SymmetricMatrix.dense(K)
    wall = Constraint((d,), (1.0,), None, 0.5, k)
    system = System(one, stiff, (wall,), C=SymmetricMatrix.dense(C))
    load = (driven.Force((d,), (1.0,), 1.0),)
    outputs = frozenset({"stability", "multipliers"})
    result = solved(driven.Problem(system, np.array([Omega]), load, outputs=outputs))
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]])
    flow = scipy.linalg.expm(A * TWO_PI / Omega)
    struck = np.zeros(n)
    struck[d] = 1.0
    X = np.linalg.solve(K - Omega**2 * np.eye(n) + 1j * Omega * C, struck)
    moduli = []
    for at, row in enumerate(result.impact_solution):
        turn = np.exp(1j * result.impact_phase[at])
        kick = np.append(np.zeros(n), -struck) * result.impact_momentum[at]
        after = np.append((X * turn).real, (1j * Omega * X * turn).real)
        after += np.linalg.solve(np.eye(2 * n) - flow, kick)
        before, force = after - kick, np.append(np.zeros(n), struck * turn.real)
        law = np.eye(2 * n)
        law[n + d, n + d] = -k
        jump = (A @ after + force - law @ (A @ before + force)) / before[n + d]
        saltation = law + np.outer(jump, np.append(struck, np.zeros(n)))
        expected = np.linalg.eigvals(saltation @ flow)
        values = result.multipliers_real[row] + 1j * result.multipliers_imaginary[row]
        apart = np.abs(values[:, np.newaxis] - expected)
        ours, theirs = linear_sum_assignment(apart)
        # The dense matrices have roundings of their own.
        allowed = result.error_multipliers_real[row] + 1e-10 * np.abs(expected).max()
        assert (apart[ours, theirs] <= allowed[ours]).all()
        assert (allowed < 1e-7 * np.abs(expected).max()).all()
        moduli.append(result.solution_stability[row])
    assert max(moduli) == pytest.approx(largest, rel=1e-4)


@pytest.mark.parametrize("gap", [0.0, 0.5])
@pytest.mark.parametrize(
    "loads",
    [
        [(1, 1.0, 1), (1, 0.5, 2)],  # nothing of them reaches the stop
        [(0, 1.0, 1), (0, 1e-310, 2)],
        [(0, 1.0, 1), (0, 1e-300, 3), (1, 1.0, 7)],
        [(0, 1.0, 1), (0, 1e-3, 1000)],
    ],
)
def test_harmonics_that_hardly_reach_the_stop(
    gap: float, loads: list[tuple[int, float, int]]
) -> None:
    one, K = SymmetricMatrix.diagonal(np.ones(2)), SymmetricMatrix.diagonal(np.array([1.0, 2.0]))
    C = SymmetricMatrix.diagonal(np.array([0.1, 0.2]))
    system = System(one, K, (Constraint((0,), (1.0,), None, gap, 0.8),), C=C)

    def found(terms: list[tuple[int, float, int]]) -> driven.Result:
        load = tuple(driven.Force((dof,), (1.0,), size, h, 0.3) for dof, size, h in terms)
        outputs = frozenset({"exists"})
        return solved(driven.Problem(system, np.array([0.7, 0.9]), load, outputs=outputs))

    result = found(loads)
    if loads[0][0] == 1:
        assert result.solution_impacts.tolist() == [0, 0]
        return
    alone = found(loads[:1])
    assert result.solution_impacts.tolist() == alone.solution_impacts.tolist()
    expected = np.sort(alone.impact_momentum)
    assert np.sort(result.impact_momentum) == pytest.approx(expected, rel=1e-3)


OSCILLATOR = System(
    SymmetricMatrix.diagonal(np.ones(1)), SymmetricMatrix.diagonal(np.ones(1)),
    (Constraint((0,), (1.0,), 0.5, 0.5, 0.8),),
)  # fmt: skip


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("Omega", "harmonic", "sequence"),
    [
        (1.0, 1, (driven.Impact(0),)),
        (0.5, 2, (driven.Impact(0),)),
        (1.0, 1, (driven.Impact(0), driven.Impact(0, -1))),
        (1.0, 1, driven.SYMMETRIC),
        (1.0 / 3.0, 3, driven.SYMMETRIC),
    ],
)
def test_a_resonance_without_damping_is_singular(
    Omega: float, harmonic: int, sequence: Any
) -> None:
    load = (driven.Force((0,), (1.0,), 1.0, harmonic),)
    result = solved(
        driven.Problem(
            OSCILLATOR,
            np.array([0.97 * Omega, Omega]),
            load,
            sequence=sequence,
            outputs=frozenset(driven.OUTPUTS),
            tau=np.array([0.0, 0.4]),
        )
    )
    (row,) = np.flatnonzero(result.solution_frequency_index == 1)
    assert result.solution_impacts[row] == 0
    assert Reason(int(result.solution_reason[row])) is Reason.SINGULAR
    assert not result.solution_exists[row]
    assert not result.solution_certified[row]
    for name in ("x_max", "x_min", "rms", "energy_lost", "energy", "work"):
        assert np.isnan(getattr(result, f"solution_{name}")[row]).all()
        assert np.isinf(getattr(result, f"error_{name}")[row]).all()
        others = np.delete(getattr(result, f"solution_{name}"), row, axis=0)
        assert np.isfinite(others).all()
    assert np.isnan(result.waveform[row]).all()
    assert np.isinf(result.error_waveform[row]).all()
    assert result.solution_stability[row] == pytest.approx(1.0, abs=1e-15)


def free_masses(
    masses: tuple[float, ...], constraints: tuple[Constraint, ...], ground: float = 0.0
) -> System:
    """Return masses in a row that springs and dampers join, held by nothing but stops."""
    n = len(masses)
    K = np.diag(np.r_[1.0, np.full(n - 2, 2.0), 1.0]) - np.eye(n, k=1) - np.eye(n, k=-1)
    matrices = SymmetricMatrix.diagonal(np.array(masses)), SymmetricMatrix.dense(K)
    C = SymmetricMatrix.dense(0.1 * K + ground * np.eye(n))
    return System(*matrices, constraints, C=C)


class TestFreeBodies:
    """Structures that nothing but their stops holds."""

    LOAD = (driven.Force((0,), (1.0,), 1.0),)
    OUTPUTS = frozenset({"exists", "extremes"})

    def problem(self, system: System, sequence: Any) -> driven.Problem:
        Omega = np.array([0.8, 1.9])
        return driven.Problem(system, Omega, self.LOAD, sequence=sequence, outputs=self.OUTPUTS)

    @pytest.mark.parametrize("ground", [0.0, 0.03])
    @pytest.mark.parametrize("count", [1, 2])
    def test_impacts_that_push_one_way_have_no_motion(self, ground: float, count: int) -> None:
        system = free_masses((1.0, 2.0, 0.7), (Constraint((0,), (1.0,), 0.3, 0.3, 0.8),), ground)
        problem = self.problem(system, (driven.Impact(0, -1),) * count)
        step = driven.plan(problem).step(Stage.IMPULSE)
        assert step is not None
        assert "gain momentum" in step.reason
        assert solved(problem).solution_impacts.tolist() == [0, 0]

    @pytest.mark.parametrize("n", [3, 500])
    def test_impacts_that_push_both_ways_are_refused_where_damping_couples(self, n: int) -> None:
        """The ground takes more of light masses: the body does not slide as it is."""
        masses = tuple(np.linspace(1.0, 2.0, n).tolist())
        system = free_masses(masses, (Constraint((0,), (1.0,), 0.3, 0.3, 0.8),), 0.03)
        problem = self.problem(system, (driven.Impact(0, 1), driven.Impact(0, -1)))
        with pytest.raises(ModelError, match="damping couples") as caught:
            solved(problem)
        assert caught.value.pointer == ("sequence",)
        if n == 3:
            symmetric = solved(replace(problem, sequence=driven.SYMMETRIC))
            assert (symmetric.solution_impacts == 2).sum() >= 2

    @pytest.mark.parametrize("ground", [0.0, 0.03])
    def test_impacts_that_push_both_ways_find_the_symmetric_motions(self, ground: float) -> None:
        """Their impulses cancel; the mean position of the body is one more unknown."""
        wall = (Constraint((0,), (1.0,), 0.3, 0.3, 0.8),)
        system = free_masses((1.0, 1.0, 1.0), wall, ground)
        problem = self.problem(system, (driven.Impact(0, 1), driven.Impact(0, -1)))
        both, symmetric = solved(problem), solved(replace(problem, sequence=driven.SYMMETRIC))
        found = 0
        for row in np.flatnonzero(symmetric.solution_impacts):
            mine = symmetric.impact_solution == row
            here = both.solution_frequency_index == symmetric.solution_frequency_index[row]
            near = [
                np.abs(both.impact_momentum[both.impact_solution == other] - momenta).max()
                for other in np.flatnonzero(here & (both.solution_impacts == 2))
                for momenta in [symmetric.impact_momentum[mine]]
            ]
            found += min(near, default=np.inf) < 1e-9
        assert found >= 2

    @pytest.mark.parametrize(("n", "planned"), [(3, True), (60, False)])
    def test_plans_tell_what_is_quickly_known(self, n: int, planned: bool) -> None:
        """A mass in the middle is missing: it follows its neighbours, and all are free."""
        wall, masses = (Constraint((0,), (1.0,), 0.3, 0.3, 0.8),), np.ones(n)
        joined = free_masses(tuple(masses), wall)
        masses[1] = 0.0
        system = System(SymmetricMatrix.diagonal(masses), joined.K, wall)
        problem = self.problem(system, (driven.Impact(0, -1),))
        step = driven.plan(problem).step(Stage.IMPULSE)
        assert step is not None
        assert ("gain momentum" in step.reason) == planned
        assert (solved(problem).solution_impacts == 0).all()

    def test_a_stop_between_two_free_masses_does_not_move_both(self) -> None:
        """Their distance is that of one mass, the reduced one, on the spring between them."""
        m = (1.3, 0.7)
        wall = Constraint((0, 1), (1.0, -1.0), None, 0.4, 0.8)
        problem = self.problem(free_masses(m, (wall,)), (driven.Impact(0),))
        result = solved(problem)
        reduced = m[0] * m[1] / sum(m)
        one = SymmetricMatrix.diagonal(np.ones(1))
        alone = System(
            SymmetricMatrix.diagonal(np.array([reduced])), one,
            (Constraint((0,), (1.0,), None, 0.4, 0.8),), C=SymmetricMatrix.diagonal([0.1]),
        )  # fmt: skip
        load = (driven.Force((0,), (1.0,), reduced / m[0]),)
        expected = solved(replace(problem, system=alone, load=load, dofs=None))
        assert (expected.solution_impacts == 1).sum() >= 2
        assert result.solution_impacts.tolist() == expected.solution_impacts.tolist()
        assert result.impact_phase == pytest.approx(expected.impact_phase, abs=1e-12)
        assert result.impact_momentum == pytest.approx(expected.impact_momentum, rel=1e-12)
        assert result.solution_reason.tolist() == expected.solution_reason.tolist()
