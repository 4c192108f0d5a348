"""Periodic motions with stops of finite stiffness, against motions that are followed exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from tests.reference.balls import Structure
from tests.reference.stopped import Stop, StoppedMotion
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers import spectrum, time_history
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.periodic_motions.stops import search
from vibroimpact_solvers.periodic_motions.stops.parts import Part
from vibroimpact_solvers.periodic_motions.stops.phases import Phases
from vibroimpact_solvers.periodic_motions.stops.prescribed import Cells
from vibroimpact_solvers.periodic_motions.stops.search import Search

ALL = frozenset(driven.OUTPUTS)


@dataclass
class Case:
    """A random structure between a stop and its drive."""

    M: Any
    C: Any
    K: Any
    row: Any
    stiffness: float
    damping: float
    force: Any
    Omega: float
    wall: float
    side: int
    symmetric: bool

    @classmethod
    def random(cls, seed: int, largest: int = 6) -> Case:
        """Return one with damping from 0.1 to 20 %, walls before and behind the place of rest."""
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, largest + 1))
        spread = rng.standard_normal((3, n, n))
        M, K = np.diag(rng.uniform(0.5, 2.0, n)), spread[1] @ spread[1].T + 0.3 * np.eye(n)
        ratio = 10.0 ** rng.uniform(-3.0, -0.7)
        coupled = spread[2] @ spread[2].T / n + 0.05 * np.eye(n)
        C = ratio * (K + M) if seed % 3 else 2.0 * ratio * coupled
        row = np.zeros(n)
        row[n // 2] = 1.0
        if n > 1 and seed % 5 == 0:
            row[0] = -0.5
        mass = 1.0 / (row @ np.linalg.solve(M, row))
        squares = scipy.linalg.eigh(K, M, eigvals_only=True)
        decades = 3.0 if rng.random() < 0.8 else 5.0
        stiffness = float(mass * squares[-1] * 10.0 ** rng.uniform(0.0, decades))
        damping = 0.0 if seed % 4 == 0 else 10.0 ** rng.uniform(-3.0, 0.3)
        force = rng.standard_normal(n)
        Omega = float(math.sqrt(squares[int(rng.integers(0, n))]) * rng.uniform(0.5, 1.5))
        swing = abs(row @ np.linalg.solve(K - Omega**2 * M + 1j * Omega * C, force))
        wall, symmetric = float(swing * rng.uniform(-1.2, 1.1)), seed % 7 == 0
        return cls(
            M, C, K, row, stiffness, float(2.0 * damping * math.sqrt(stiffness * mass)), force,
            Omega, abs(wall) if symmetric else wall, 1 if seed % 2 or symmetric else -1, symmetric,
        )  # fmt: skip

    def problem(self, outputs: frozenset[str] = ALL, tau: int = 5) -> driven.Problem:
        """Return the solvers' problem."""
        dofs = tuple(np.flatnonzero(self.row).tolist())
        lower, upper = (None, self.wall) if self.side > 0 else (self.wall, None)
        if self.symmetric:
            lower = upper = self.wall
        stop = Constraint(
            dofs, tuple(self.row[[*dofs]].tolist()), lower, upper,
            law=Linear(self.stiffness, self.damping),
        )  # fmt: skip
        M, K, C = (SymmetricMatrix.dense(matrix) for matrix in (self.M, self.K, self.C))
        load = tuple(driven.Force((i,), (1.0,), float(f)) for i, f in enumerate(self.force))
        sequence: Any = (driven.Impact(0, self.side),)
        return driven.Problem(
            System(M, K, (stop,), C=C), np.array([self.Omega]), load,
            sequence=driven.SYMMETRIC if self.symmetric else sequence, outputs=outputs,
            tau=np.linspace(0.0, 1.0, tau),
        )  # fmt: skip

    def follow(self, x: Any, v: Any, phase: float, until: float) -> StoppedMotion:
        """Return the motion from a state in 256-bit arithmetic, to an end."""
        load = tuple((i, float(f), self.Omega, phase) for i, f in enumerate(self.force))
        structure = Structure(self.M, self.K, self.C, None, load)
        lower, upper = (None, self.wall) if self.side > 0 else (-self.wall, None)
        if self.symmetric:
            lower, upper = self.wall, self.wall
        # Walls are distances from the zero of the coordinate, on the other side negative.
        stop = Stop(self.row, -lower if self.side < 0 and lower is not None else lower, upper,
                    self.stiffness, self.damping)  # fmt: skip
        motion = StoppedMotion(structure, [stop], x, v)
        motion.run(until, [until])
        return motion


def solved(case: Case) -> tuple[driven.Result, list[tuple[Any, Any, float, float]]]:
    """Return the result of a case, and its states at the beginnings of contacts."""
    problem = case.problem()
    result = driven.solve(problem, driven.plan(problem))
    phases = Phases.of(problem, spectrum.choose(problem.system))
    cells = Cells.of(phases, problem)
    durations_of, _ = Search(problem, phases).contacts(cells)
    states = []
    for k in range(durations_of.d.size):
        part = Part.at_entry(phases, cells, durations_of, k)
        q, rate = phases.open.coordinates_of(part.states(np.zeros(1))[0])
        modes, still = phases.open.basis.modes, phases.open.basis.still
        x, v = modes.shapes @ (q + still) + modes.base, phases.scale * modes.shapes @ rate
        states.append((x, v, float(durations_of.phase[k]), float(durations_of.d[k]) / phases.scale))
    return result, states


@pytest.mark.parametrize("seed", [0, 1, 3, 4, 5, 6, 7, 10, 13, 14, 17, 19])
def test_motions_return(seed: int) -> None:
    """An admissible motion goes through one contact and returns; a phantom does not."""
    case = Case.random(seed)
    result, states = solved(case)
    T = 2.0 * math.pi / case.Omega
    first = int((result.solution_contacts == 0).sum()) + (0 if case.symmetric else 1)
    assert result.solution_exists is not None
    assert result.contact_solution is not None
    for k, (x, v, phase, d) in enumerate(states):
        row = first + k
        contact = int(np.flatnonzero(result.contact_solution == row)[0])
        until = 0.5 * T if case.symmetric else T
        if not result.solution_exists[row]:
            continue
        motion = case.follow(x, v, phase, until * (1.0 - 1e-9))
        table = motion.motion.contacts
        # Rounding of the state may let it touch the wall once more, for no time.
        long = [c for c in table if float(c.stop - c.start) > 1e-6 * d]
        assert len(long) == 1
        ends = float(long[0].stop)
        assert result.error_contact_duration is not None
        growth = 1e3 * max(1.0, float(result.error_x_max[row].max()))  # type: ignore[index]
        error = float(result.error_contact_duration[contact])
        assert abs(ends - d) <= 4.0 * error + growth * 1e-15 * T
        z = motion.z
        n = len(case.M)
        sign = -1.0 if case.symmetric else 1.0
        back = np.array([float(z[i, 0]) for i in range(2 * n)])
        assert sign * back[:n] == pytest.approx(x, abs=1e-6 * np.abs(x).max() + 1e-9)
        for name, value in (
            ("impulse", long[0].impulse), ("peak_force", long[0].peak_force),
            ("indentation", long[0].indentation), ("energy_lost", long[0].energy_lost),
        ):  # fmt: skip
            stated = float(getattr(result, f"contact_{name}")[contact])
            off = float(getattr(result, f"error_contact_{name}")[contact])
            if name != "energy_lost":  # a released stop gives its energy back later
                assert abs(stated - float(value)) <= off + 1e-12 * abs(stated)


def test_motion_that_begins_under_compression() -> None:
    """The only motion with one contact of this oscillator regains its force beyond the wall."""
    wall = Constraint((0,), (1.0,), None, -1.0, law=Linear(1.0, 1.0))
    one = SymmetricMatrix.diagonal([1.0])
    system = System(one, one, (wall,), C=SymmetricMatrix.diagonal([0.05]))
    problem = driven.Problem(system, np.array([1.5]), (driven.Force((0,), (1.0,), 0.5),))
    result = driven.solve(problem, driven.plan(problem))
    assert result.complete is not None
    assert result.complete.all()
    assert result.solution_contacts is not None
    assert result.solution_exists is not None
    assert result.contact_duration is not None
    assert result.contact_start_indentation is not None
    assert result.solution_exists.tolist() == [False, False, True]
    assert result.solution_contacts.tolist() == [0, 1, 1]
    assert result.contact_duration[1] == pytest.approx(3.457427, abs=1e-6)
    assert result.contact_start_indentation[1] > 0.1
    assert result.solution_work == pytest.approx(result.solution_energy_lost, rel=1e-13)


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(
    ("second", "wall"),
    [(0.0, 1.045), (0.0, 1.046), (0.0, 1.0462), (0.05, 0.9942), (0.05, 0.9946)],
)
def test_a_wall_that_is_left_for_a_short_time(second: float, wall: float) -> None:
    """A stop that is released for long, leaves its wall shortly and is loaded there again.

    A settled time history goes through the motion, which therefore exists, with one harmonic of the
    load or two.
    """
    Omega = 0.5
    stop = Constraint((0,), (1.0,), None, -wall, law=Linear(4.0, 6.0))
    one, C = SymmetricMatrix.diagonal([1.0]), SymmetricMatrix.diagonal([0.1])
    system = System(one, one, (stop,), C=C)
    load = (driven.Force((0,), (1.0,), 1.0), driven.Force((0,), (1.0,), second, 2))
    problem = driven.Problem(system, np.array([Omega]), load if second else load[:1])
    result = driven.solve(problem, driven.plan(problem))
    T = 2.0 * math.pi / Omega
    harmonics = tuple(
        time_history.Harmonic(0, each.amplitude, each.harmonic * Omega) for each in problem.load
    )
    given = time_history.Problem(
        system, time_history.State(np.zeros(1), np.zeros(1)), 42.0 * T,
        t=np.linspace(40.0 * T, 41.0 * T, 20001), outputs=frozenset({"x", "contacts"}),
        load=harmonics,
    )  # fmt: skip
    history = time_history.solve(given, time_history.plan(given))
    assert history.contact_start is not None
    assert history.contact_stop is not None
    assert history.x is not None
    open_part = float((history.x[:, 0] < -wall).mean())
    assert 0.0 < open_part < 0.025
    (k,) = np.flatnonzero((history.contact_start > 40.0 * T) & (history.contact_start < 41.0 * T))
    phase = math.fmod(Omega * float(history.contact_start[k]), 2.0 * math.pi)
    duration = float(history.contact_stop[k] - history.contact_start[k])
    assert result.contact_phase is not None
    assert result.contact_duration is not None
    assert result.contact_solution is not None
    assert result.solution_exists is not None
    assert result.solution_certified is not None
    near = np.abs(result.contact_duration - duration) < 1e-9 * T
    (row,) = np.flatnonzero(near)
    assert result.contact_phase[row] == pytest.approx(phase, abs=1e-8)
    assert result.solution_exists[result.contact_solution[row]]
    assert result.solution_certified[result.contact_solution[row]]


def direct(case: Case, d: float, regained: bool) -> tuple[float, float, Any, Any, Any]:
    """Return the equation in the duration, phase, state and generators by matrix exponentials."""
    n = len(case.M)
    inverse, row = np.linalg.inv(case.M), case.side * case.row
    generators = []
    for loaded in (0.0, 1.0):
        A = np.zeros((2 * n + 3, 2 * n + 3))
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n, :n] = -inverse @ (case.K + loaded * case.stiffness * np.outer(row, row))
        A[n : 2 * n, n : 2 * n] = -inverse @ (case.C + loaded * case.damping * np.outer(row, row))
        A[n : 2 * n, 2 * n] = inverse @ case.force
        A[2 * n, 2 * n + 1], A[2 * n + 1, 2 * n] = -case.Omega, case.Omega
        A[n : 2 * n, -1] = inverse @ row * loaded * case.stiffness * case.wall
        generators.append(A)
    T = (math.pi if case.symmetric else 2.0 * math.pi) / case.Omega
    flows = []
    for A, time in zip(generators, (T - d, d), strict=True):
        rates, vectors = np.linalg.eig(A)
        flows.append(((vectors * np.exp(rates * time)) @ np.linalg.inv(vectors)).real)
    flow, period = flows[1], flows[0] @ flows[1]
    sign = -1.0 if case.symmetric else 1.0
    top = np.linalg.solve(sign * np.eye(2 * n) - period[: 2 * n, : 2 * n], period[: 2 * n, 2 * n :])
    start = np.vstack([top, np.eye(3)])
    dent = np.concatenate([row, np.zeros(n + 2), [-case.wall]])
    force = np.concatenate(
        [case.stiffness * row, case.damping * row, [0, 0, -case.stiffness * case.wall]]
    )
    q, r = (force if regained else dent) @ start, force @ flow @ start
    Q, R = q[0] - 1j * q[1], r[0] - 1j * r[1]
    A, across = q[2] * R.conjugate() - r[2] * Q.conjugate(), (Q.conjugate() * R).imag
    theta = float(np.angle(1j * (r[2] * Q.conjugate() - q[2] * R.conjugate()) / across))
    z = start @ [math.cos(theta), math.sin(theta), 1.0]
    return abs(A) ** 2 - across**2, theta, z, generators, (dent, force)


def admissible(case: Case, d: float, regained: bool) -> bool:
    """Whether samples along a motion show one contact."""
    _, _, z, (opened, loaded), (dent, force) = direct(case, d, regained)
    T, n = (math.pi if case.symmetric else 2.0 * math.pi) / case.Omega, len(case.M)
    rate = np.concatenate([np.zeros(n), dent[:n], np.zeros(3)])
    if not regained and not rate @ z > 0.0:
        return False
    step = scipy.linalg.expm(loaded * d / 400.0)
    small = 1e-9 * case.stiffness
    for _ in range(399):
        z = step @ z
        if force @ z < -small:
            return False
    z, step = step @ z, scipy.linalg.expm(opened * (T - d) / 1000.0)
    released = case.damping > 0.0
    for _ in range(999):
        z = step @ z
        deep = float(dent @ z)
        if case.symmetric and -deep - 2.0 * case.wall > 1e-9:
            return False
        if released and float(force @ z) > small:
            return False
        released = released and deep > 0.0
        if not released and deep > 1e-9:
            return False
    return released or not regained


@pytest.mark.parametrize("seed", range(100, 106))
def test_a_scan_finds_no_other(seed: int) -> None:
    """No admissible motion that a scan of the duration finds is missing."""
    case = Case.random(seed, largest=4)
    problem = case.problem(frozenset({"exists"}))
    result = driven.solve(problem, driven.plan(problem))
    assert result.contact_duration is not None
    assert result.contact_start_indentation is not None
    T = (math.pi if case.symmetric else 2.0 * math.pi) / case.Omega
    durations = np.linspace(0.0, T, 401)[1:-1]
    for regained in (False, True) if case.damping > 0.0 else (False,):
        values = np.array([direct(case, d, regained)[0] for d in durations.tolist()])
        for i in np.flatnonzero(values[:-1] * values[1:] < 0.0).tolist():
            low, high = durations[i], durations[i + 1]
            for _ in range(44):
                middle = 0.5 * (low + high)
                if (direct(case, middle, regained)[0] > 0.0) == (values[i] > 0.0):
                    low = middle
                else:
                    high = middle
            if not admissible(case, low, regained):
                continue
            near = np.abs(result.contact_duration - low) < 1e-6 * T
            near &= (result.contact_start_indentation > 0.0) == regained
            assert near.any(), (low / T, regained)
            assert result.solution_exists is not None
            assert result.contact_solution is not None
            assert result.solution_exists[result.contact_solution[near]].any()


def test_multipliers_by_differences() -> None:
    """Multipliers are those of the map over a period, by differences of histories."""
    case = Case.random(33, largest=2)
    result, states = solved(case)
    assert result.solution_exists is not None
    first = 1 if case.symmetric else 2
    rows = [k for k in range(len(states)) if result.solution_exists[first + k]]
    assert rows
    x, v, phase, _ = states[rows[0]]
    n, T = len(case.M), 2.0 * math.pi / case.Omega
    # Between contacts, where deviations do not reach a switching.
    back = 0.02 * T
    A = np.block([
        [np.zeros((n, n)), np.eye(n)],
        [-np.linalg.solve(case.M, case.K), -np.linalg.solve(case.M, case.C)],
    ])  # fmt: skip
    H = np.linalg.solve(case.K - case.Omega**2 * case.M + 1j * case.Omega * case.C, case.force)
    steady = np.concatenate([H, 1j * case.Omega * H])

    def on(t: float) -> Any:
        return (steady * np.exp(1j * (phase + case.Omega * t))).real

    start = on(-back) + scipy.linalg.expm(-A * back) @ (np.concatenate([x, v]) - on(0.0))
    columns = []
    for direction in np.eye(2 * n):
        ends = []
        for size in (1e-7, -1e-7):
            z = start + size * direction
            motion = case.follow(z[:n], z[n:], phase - case.Omega * back, T)
            ends.append([float(motion.z[i, 0]) for i in range(2 * n)])
        columns.append((np.array(ends[0]) - np.array(ends[1])) / 2e-7)
    expected = np.linalg.eigvals(np.array(columns).T)
    assert result.multipliers_real is not None
    assert result.multipliers_imaginary is not None
    row = first + rows[0]
    stated = result.multipliers_real[row] + 1j * result.multipliers_imaginary[row]
    for value in expected:
        assert np.abs(stated - value).min() < 1e-6


def cantilever(count: int, wall: float, stiffness: float) -> System:
    """Return a clamped beam by some of its modes: EI = 100, mass per length 0.8, length 1."""
    roots = [1.875104068711961, 4.694091132974174, 7.854757438237613, 10.995540734875467]
    roots += [(2 * j - 1) * math.pi / 2.0 for j in range(5, count + 1)]
    squares = np.array(roots[:count]) ** 4 * 100.0 / 0.8
    tips = 2.0 / math.sqrt(0.8) * (-1.0) ** np.arange(count)
    stop = Constraint(tuple(range(count)), tuple(tips.tolist()), None, wall, law=Linear(stiffness))
    ratio = 0.02 / math.sqrt(squares[0])
    C = 2.0 * ratio * squares * 0.5
    one = np.ones(count)
    return System(
        SymmetricMatrix.diagonal(one), SymmetricMatrix.diagonal(squares), (stop,),
        C=SymmetricMatrix.diagonal(C + 0.01 * math.sqrt(squares[0])),
    )  # fmt: skip


def test_a_cantilever_converges() -> None:
    """Durations of contacts converge as modes are added."""
    durations_of = []
    for count in (3, 5, 8, 12, 20):
        system = cantilever(count, 0.01, 1e4)
        tips = np.asarray(system.constraints[0].weights)
        load = (driven.Force(tuple(range(count)), tuple(tips.tolist()), 3.0),)
        Omega = np.array([1.2 * 1.875104068711961**2 * math.sqrt(100.0 / 0.8)])
        problem = driven.Problem(system, Omega, load)
        result = driven.solve(problem, driven.plan(problem))
        assert result.solution_exists is not None
        assert result.contact_solution is not None
        assert result.contact_duration is not None
        exist = result.solution_exists[result.contact_solution]
        durations_of.append(float(result.contact_duration[exist].max()))
    apart = np.abs(np.diff(durations_of))
    assert (apart[1:] < 0.6 * apart[:-1]).all()
    assert apart[-1] < 1e-3 * durations_of[-1]


def test_rigid_limit() -> None:
    """A stiffer stop tends to an elastic impact, as its stiffness to the power of -1/2."""
    case = replace(Case.random(5, largest=3), damping=0.0, symmetric=False, side=1, stiffness=1e6)
    H = np.linalg.solve(case.K - case.Omega**2 * case.M + 1j * case.Omega * case.C, case.force)
    case = replace(case, wall=0.6 * float(abs(case.row @ H)))
    problem = case.problem(frozenset({"extremes", "exists"}))
    (stop,) = problem.system.constraints
    rigid = Constraint(stop.dofs, stop.weights, None, case.wall)
    other = replace(problem.system, constraints=(rigid,))
    limit = driven.solve(
        hard := driven.Problem(other, problem.Omega, problem.load), driven.plan(hard)
    )
    mobility = float(case.row @ np.linalg.solve(case.M, case.row))
    apart = []
    for stiffness in (1e6, 1e8):
        soft = replace(case, stiffness=stiffness).problem(frozenset({"extremes", "exists"}))
        result = driven.solve(soft, driven.plan(soft))
        assert result.contact_duration is not None
        assert result.contact_impulse is not None
        short = math.pi / math.sqrt(stiffness * mobility)
        near = np.flatnonzero(np.abs(result.contact_duration - short) < 0.2 * short)
        assert near.size
        apart.append(
            min(
                abs(float(result.contact_impulse[near[0]]) - float(p))
                for p in limit.impact_momentum
            )
        )
    assert apart[0] / apart[1] == pytest.approx(10.0, rel=0.1)


def oscillator(wall: float, law: Linear) -> System:
    """Return a damped oscillator with one wall."""
    stop = Constraint((0,), (1.0,), None, wall, law=law)
    one = SymmetricMatrix.diagonal([1.0])
    return System(one, one, (stop,), C=SymmetricMatrix.diagonal([0.05]))


def test_a_harmonic_is_another_frequency_over_more_periods() -> None:
    """cos(2 Omega t) over a period is the load of twice the frequency over two."""
    system = oscillator(0.3, Linear(10.0, 0.1))
    Omega, load = np.array([0.5, 0.75, 1.0]), driven.Force((0,), (1.0,), 1.0)
    second = driven.Problem(system, Omega, (replace(load, harmonic=2),))
    twice = driven.Problem(system, 2.0 * Omega, (load,), periods=2)
    found, true = (driven.solve(each, driven.plan(each)) for each in (second, twice))
    assert found.solution_exists is not None
    assert true.solution_exists is not None
    assert found.contact_duration is not None
    assert true.contact_duration is not None
    assert found.solution_exists.tolist() == true.solution_exists.tolist()
    assert found.contact_duration.size > 6
    np.testing.assert_allclose(found.contact_duration, true.contact_duration, rtol=1e-9)


def test_no_clearance() -> None:
    """Without a clearance motions are as large as the load, and their contacts as long."""
    system, Omega = oscillator(0.0, Linear(10.0)), np.array([0.9, 1.3])
    sizes = []
    for amplitude in (1.0, 3.0):
        load = (driven.Force((0,), (1.0,), amplitude),)
        problem = driven.Problem(system, Omega, load)
        sizes.append(driven.solve(problem, driven.plan(problem)))
    one, other = sizes
    assert one.solution_exists is not None
    assert one.contact_solution is not None
    assert one.contact_peak_force is not None
    assert other.contact_peak_force is not None
    exists = one.solution_exists[one.contact_solution]
    assert exists.any()
    ratio = other.contact_peak_force[exists] / one.contact_peak_force[exists]
    np.testing.assert_allclose(ratio, 3.0, rtol=1e-9)


def test_a_search_in_slow_modes_finds_what_is_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no proof is tried, the motions of a beam are found all the same."""
    system = cantilever(9, 0.01, 1e4)
    tips = np.asarray(system.constraints[0].weights)
    load = (driven.Force(tuple(range(9)), tuple(tips.tolist()), 3.0),)
    Omega = np.array([1.1, 1.2, 1.3]) * 1.875104068711961**2 * math.sqrt(100.0 / 0.8)
    problem = driven.Problem(system, Omega, load)
    proved = driven.solve(problem, driven.plan(problem))
    monkeypatch.setattr(search, "WORK", 0.0)
    monkeypatch.setattr(search, "_FEWER", (5,))
    searched = driven.solve(problem, driven.plan(problem))
    assert proved.complete is not None
    assert searched.complete is not None
    assert proved.complete.all()
    assert not searched.complete.any()
    durations_of = []
    for result in (proved, searched):
        assert result.solution_exists is not None
        assert result.contact_solution is not None
        assert result.contact_duration is not None
        durations_of.append(
            result.contact_duration[result.solution_exists[result.contact_solution]]
        )
    assert durations_of[0].size >= 3
    np.testing.assert_allclose(*durations_of, rtol=1e-11)


def test_errors_of_fast_motions_cover_the_balance_of_energy() -> None:
    """Where the mass at a stiff stop turns too often for all nodes, errors say so."""
    problem = driven.Problem(
        oscillator(0.3, Linear(1e7)), np.array([0.8, 1.5]), (driven.Force((0,), (1.0,), 1.0),),
        outputs=frozenset({"exists", "energy"}),
    )  # fmt: skip
    result = driven.solve(problem, driven.plan(problem))
    assert result.solution_work is not None
    assert result.solution_energy_lost is not None
    assert result.error_work is not None
    assert result.error_energy_lost is not None
    apart = np.abs(result.solution_work - result.solution_energy_lost)
    assert (apart <= 1.01 * (result.error_work + result.error_energy_lost)).all()


def test_refusals() -> None:
    """What is not computed with such stops is refused by its field."""
    case = replace(Case.random(3), symmetric=False, side=1)
    problem = case.problem()
    system = problem.system
    impact = driven.Impact(0)
    with pytest.raises(ModelError, match="no load acts") as caught:
        driven.Problem(system, problem.Omega, (), sequence=(impact,))
    assert caught.value.pointer == ("load",)
    mixed = replace(system, constraints=(*system.constraints, Constraint((0,), (1.0,), None, 1e9)))
    with pytest.raises(ModelError, match="rigid stops beside"):
        driven.Problem(mixed, problem.Omega, problem.load)
    free = replace(system, K=SymmetricMatrix.dense(0.0 * case.K), force=np.ones(len(case.M)))
    falling = driven.Problem(free, problem.Omega, problem.load, sequence=(impact,))
    plan = driven.plan(falling)
    with pytest.raises(ModelError) as caught:
        driven.solve(falling, plan)
    assert caught.value.pointer == ("system", "force")


@pytest.mark.parametrize(
    ("K", "rows", "struck", "stiffness"),
    [
        ([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]], [[0.0, 0.0, 1.0]], 1, 20.0),
        ([[1.0, -1.0], [-1.0, 1.0]], [[-1.0, 1.0]], 1, 20.0),
        ([[1.0, -1.0], [-1.0, 1.0]], [[-1.0, 1.0]], 2, 20.0),
        ([[0.0]], [[1.0]], 1, 0.0),
        ([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]],
         [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], 1, 20.0),
    ],
)  # fmt: skip
def test_a_rigid_motion_that_no_stop_resists_is_refused(
    K: Any, rows: Any, struck: int, stiffness: float
) -> None:
    """A free beam above one stop, two masses that only their distance stops, and a dashpot."""
    n, law = len(K), Linear(stiffness, 0.5)
    stops = tuple(Constraint(tuple(range(n)), tuple(row), None, 0.3, law=law) for row in rows)
    one = SymmetricMatrix.diagonal(np.ones(n))
    system = System(one, SymmetricMatrix.dense(np.array(K)), stops)
    load = (driven.Force((0,), (1.0,), 1.0),)
    problem = driven.Problem(
        system, np.array([1.3]), load, sequence=(driven.Impact(0, 1),) * struck
    )
    plan = driven.plan(problem)
    with pytest.raises(ModelError, match="rigid motion") as caught:
        driven.solve(problem, plan)
    assert (caught.value.pointer, caught.value.code) == (("system", "K"), "free_body")


def test_stops_hold_a_free_beam() -> None:
    """Two stops resist both rigid motions; a mirrored half period leaves none."""
    K = SymmetricMatrix.dense(np.outer([1.0, -2.0, 1.0], [1.0, -2.0, 1.0]))
    ends = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    lower, upper = (
        Constraint((0, 1, 2), row, *walls, law=Linear(20.0, 0.5))
        for row, walls in zip(ends, ((0.3, None), (None, 0.3)), strict=True)
    )
    both = Constraint((0, 1, 2), ends[1], 0.3, 0.3, law=Linear(20.0, 0.5))
    one, load = SymmetricMatrix.diagonal(np.ones(3)), (driven.Force((0,), (1.0,), 1.0),)
    cases: list[tuple[tuple[Constraint, ...], Any]] = [
        ((lower, upper), (driven.Impact(0, -1), driven.Impact(1, 1))),
        ((both,), driven.SYMMETRIC),
    ]
    for stops, sequence in cases:
        problem = driven.Problem(System(one, K, stops), np.array([1.3]), load, sequence=sequence)
        result = driven.solve(problem, driven.plan(problem))
        assert result.solution_contacts is not None
        assert result.solution_contacts.size > 0


@pytest.mark.parametrize("lag", [1e-3, 0.0095, 0.1, 3.0])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_extreme_beside_the_beginning_of_the_period_is_found(lag: float, sign: float) -> None:
    """It is at t = 0 or T, where steps of the search from the other end left the period."""
    system = cantilever(1, 10.0, 1e4)
    assert system.C is not None
    mass, stiffness, damping = (
        float(part.to_dense()[0, 0]) for part in (system.M, system.K, system.C)
    )
    Omega = 0.5 * math.sqrt(stiffness)
    receptance = 1.0 / (stiffness - Omega**2 * mass + 1j * Omega * damping)
    force = driven.Force((0,), (1.0,), 1.0, phase=-float(np.angle(receptance)) - sign * lag)
    problem = driven.Problem(
        system, np.array([Omega]), (force,), outputs=frozenset({"extremes", "exists"})
    )
    result = driven.solve(problem, driven.plan(problem))
    (row,) = np.flatnonzero((result.solution_contacts == 0) & result.solution_exists)
    for found, side in ((result.solution_x_max, 1.0), (result.solution_x_min, -1.0)):
        assert found is not None
        assert float(found[row, 0]) == pytest.approx(side * abs(receptance), rel=1e-12, abs=0.0)
