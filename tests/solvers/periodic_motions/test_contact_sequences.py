"""Motions with several contacts a period, against motions that are followed exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from tests.reference.balls import Structure
from tests.reference.stopped import Stop, StoppedMotion
from tests.solvers.periodic_motions.test_stops import Case
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers import spectrum
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.stops.orbits import Orbit
from vibroimpact_solvers.periodic_motions.stops.scenes import Scenes
from vibroimpact_solvers.periodic_motions.stops.sequences import solutions
from vibroimpact_solvers.results.periodic_motions import Result

ALL = frozenset(driven.OUTPUTS)
CONTACT = (
    "phase", "time", "duration", "impulse", "peak_force", "velocity", "indentation",
    "start_indentation", "energy_lost",
)  # fmt: skip


@dataclass
class Two:
    """A structure between two stops of different laws, and its drive of some harmonics."""

    M: Any
    K: Any
    C: Any
    stops: tuple[tuple[Any, float, int, float, float], ...]  # row, wall, side, k, c
    load: tuple[tuple[int, float, int, float], ...]  # dof, amplitude, harmonic, phase
    Omega: float

    @classmethod
    def random(cls, seed: int) -> Two:
        """Return a chain whose ends strike."""
        rng = np.random.default_rng(seed)
        n = 2 + seed % 3
        M = np.diag(rng.uniform(0.5, 2.0, n))
        K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
        C = rng.uniform(0.05, 0.2) * K + 0.1 * np.eye(n)
        rows = np.eye(n)[0], np.eye(n)[-1]
        stops = (
            (rows[0], float(rng.uniform(0.1, 0.5)), 1, 20.0, float(rng.uniform(0.2, 1.5))),
            (rows[1], float(rng.uniform(0.1, 0.5)), -1, 40.0, 0.0 if seed % 2 else 0.5),
        )
        load = ((0, 1.0, 1, 0.0), (n - 1, 0.7, 1 + seed % 3, 1.0))
        return cls(M, K, C, stops, load, float(rng.uniform(0.6, 1.4)))

    def problem(self, sequence: tuple[driven.Impact, ...], periods: int = 1) -> Problem:
        """Return the solvers' problem."""
        constraints = tuple(
            Constraint(
                tuple(np.flatnonzero(row).tolist()), tuple(row[row != 0.0].tolist()),
                wall if side < 0 else None, wall if side > 0 else None, law=Linear(k, c),
            )
            for row, wall, side, k, c in self.stops
        )  # fmt: skip
        M, K, C = (SymmetricMatrix.dense(each) for each in (self.M, self.K, self.C))
        load = tuple(driven.Force((i,), (1.0,), f, q, phase) for i, f, q, phase in self.load)
        return Problem(
            System(M, K, constraints, C=C), np.array([self.Omega]), load, periods, sequence,
            outputs=ALL, tau=np.linspace(0.0, 1.0, 7),
        )  # fmt: skip

    def follow(self, x: Any, v: Any, begin: float, until: float) -> StoppedMotion:
        """Return the motion from a state at a time in 256-bit arithmetic, until later."""
        load = tuple(
            (i, f, q * self.Omega, phase + q * self.Omega * begin) for i, f, q, phase in self.load
        )
        stops = [
            Stop(row, wall if side < 0 else None, wall if side > 0 else None, k, c)
            for row, wall, side, k, c in self.stops
        ]
        motion = StoppedMotion(Structure(self.M, self.K, self.C, None, load), stops, x, v)
        motion.run(until, [until])
        return motion


FIRST, SECOND = driven.Impact(0, 1), driven.Impact(1, -1)


def scenes_of(problem: Problem) -> Scenes:
    method = spectrum.choose(problem.system)
    return Scenes(problem.system, problem.forces(), 2.0 * math.pi / problem.Omega[0], method)


def state_at_begin(one: Orbit) -> tuple[Any, Any, float]:
    """Return displacements, velocities and the time at the first switching."""
    scenes, time = one.cell.scenes, float(one.times[0])
    side = one.side(0)
    flat = one.states[0] + one.cell.at(one.scenes[0], time)[0]
    q, rate = side.coordinates_of(flat)
    modal = side.vectors @ (q + side.basis.still) + side.origin
    free = scenes.open.basis.modes
    x = free.shapes @ modal + free.base
    return x, scenes.scale * free.shapes @ (side.vectors @ rate), time / scenes.scale


def results(problem: Problem) -> tuple[Result, list[Orbit]]:
    """Return the result, and the orbits of its solutions."""
    result = driven.solve(problem, driven.plan(problem))
    return result, [one.orbit for one in next(solutions(problem, scenes_of(problem)))]


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("seed", [0, 6, 9, 10, 11])
def test_motions_return(seed: int) -> None:
    """A motion that exists goes through its contacts, as long and as hard, and returns."""
    case = Two.random(seed)
    problem = case.problem((FIRST, SECOND))
    result, orbits = results(problem)
    assert result.solution_exists is not None
    assert result.contact_solution is not None
    assert result.solution_contacts is not None
    rows = [k for k in range(len(orbits)) if result.solution_exists[k] and orbits[k].switchings]
    assert rows
    T = 2.0 * math.pi / case.Omega
    for row in rows:
        x, v, begin = state_at_begin(orbits[row])
        # A little before the end, where the first contact of the next period begins.
        late = 1e-7 * T
        z0 = case.follow(x, v, begin, T + 0.5 * late)
        n = len(case.M)
        table = [c for c in z0.motion.contacts if float(c.stop - c.start) > 10.0 * late]
        mine = np.flatnonzero(result.contact_solution == row)
        assert len(table) == mine.size == 2
        own = {int(result.contact_constraint[k]): k for k in mine.tolist()}  # type: ignore[index]
        for contact in table:
            k = own[contact.constraint]
            for name, value in (
                ("duration", contact.stop - contact.start), ("impulse", contact.impulse),
                ("peak_force", contact.peak_force), ("indentation", contact.indentation),
            ):  # fmt: skip
                stated = float(getattr(result, f"contact_{name}")[k])
                error = float(getattr(result, f"error_contact_{name}")[k])
                assert abs(stated - float(value)) <= error + 1e-12 * abs(stated)
            since = float(contact.start) + begin
            apart = math.fmod(since - float(result.contact_time[k]), T)  # type: ignore[index]
            assert min(abs(apart), T - abs(apart)) < 1e-10 * T
        # The state half of what is left over later is the one at the beginning, moved on.
        again = case.follow(x, v, begin, 0.5 * late)
        for i in range(2 * n):
            assert float(z0.z[i, 0]) == pytest.approx(float(again.z[i, 0]), abs=1e-9)


def test_work_is_what_is_lost() -> None:
    """The work of the load is the energy lost, for phantoms as for motions."""
    for seed in range(4):
        result, _ = results(Two.random(seed).problem((FIRST, SECOND)))
        assert result.solution_work is not None
        assert result.solution_energy_lost is not None
        assert result.error_work is not None
        apart = np.abs(result.solution_work - result.solution_energy_lost)
        assert (apart <= 1e-10 * np.abs(result.solution_work) + result.error_work).all()


@pytest.mark.parametrize("seed", [0, 6, 10])
def test_multipliers_by_differences(seed: int) -> None:
    """Multipliers are those of the map over a period, by differences of motions."""
    case = Two.random(seed)
    result, orbits = results(case.problem((FIRST, SECOND)))
    assert result.solution_exists is not None
    assert result.multipliers_real is not None
    assert result.multipliers_imaginary is not None
    row = next(k for k, one in enumerate(orbits) if result.solution_exists[k] and one.switchings)
    one, n, T = orbits[row], len(case.M), 2.0 * math.pi / case.Omega
    x, v, begin = state_at_begin(one)
    # From the middle of the longest part without a contact on, where deviations switch nothing.
    lengths = [
        length if not loaded else 0.0
        for length, loaded in zip(one.lengths.tolist(), one.scenes, strict=True)
    ]
    part = int(np.argmax(lengths))
    after = float(one.times[part] - one.times[0] + 0.5 * one.lengths[part]) / one.cell.scenes.scale
    moved = case.follow(x, v, begin, after)
    start = np.array([float(moved.z[i, 0]) for i in range(2 * n)])
    columns = []
    for direction in np.eye(2 * n):
        ends = []
        for size in (1e-7, -1e-7):
            z = start + size * direction
            motion = case.follow(z[:n], z[n:], begin + after, T)
            ends.append([float(motion.z[i, 0]) for i in range(2 * n)])
        columns.append((np.array(ends[0]) - np.array(ends[1])) / 2e-7)
    expected = np.linalg.eigvals(np.array(columns).T)
    stated = result.multipliers_real[row] + 1j * result.multipliers_imaginary[row]
    for value in expected:
        assert np.abs(stated - value).min() < 1e-6


@pytest.mark.parametrize("seed", [2, 4, 5, 6, 11])
def test_one_contact_is_what_isolation_finds(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Motions with one contact, whose equation is solved otherwise, have the same numbers."""
    problem = Case.random(seed).problem()
    plan = driven.plan(problem)
    closed = driven.solve(problem, plan)
    monkeypatch.setattr(Problem, "searched", property(lambda self: True))
    found = driven.solve(problem, plan)
    assert closed.solution_exists is not None
    assert found.solution_exists is not None
    assert closed.contact_solution is not None
    assert found.contact_solution is not None
    compared = 0
    for row in np.flatnonzero(closed.solution_exists & (closed.solution_contacts == 1)).tolist():
        (k,) = np.flatnonzero(closed.contact_solution == row)
        length = closed.contact_duration[k]  # type: ignore[index]
        near = np.abs(found.contact_duration - length) < 1e-8 * length
        (j,) = np.flatnonzero(near)
        other = int(found.contact_solution[j])
        compared += 1
        assert found.solution_exists[other]
        for name in CONTACT:
            one, two = (float(getattr(each, f"contact_{name}")[at])
                        for each, at in ((closed, k), (found, j)))  # fmt: skip
            error = sum(float(getattr(each, f"error_contact_{name}")[at])
                        for each, at in ((closed, k), (found, j)))  # fmt: skip
            assert abs(one - two) <= error
        for name in ("x_max", "x_min", "rms", "energy", "work", "energy_lost", "stability"):
            one, two = (getattr(each, f"solution_{name}")[at]
                        for each, at in ((closed, row), (found, other)))  # fmt: skip
            error = sum(getattr(each, f"error_{name}")[at]
                        for each, at in ((closed, row), (found, other)))  # fmt: skip
            assert (np.abs(one - two) <= error).all()
        assert closed.waveform is not None
        assert found.waveform is not None
        np.testing.assert_allclose(closed.waveform[row], found.waveform[other], atol=1e-9)
    assert compared


def oscillator(law: Linear, wall: float = 0.0) -> System:
    one = SymmetricMatrix.diagonal([1.0])
    stop = Constraint((0,), (1.0,), None, wall, law=law)
    return System(one, one, (stop,), C=SymmetricMatrix.diagonal([0.1]))


def test_a_flip_doubles_the_period() -> None:
    """Two unlike contacts in two periods, where the motion with one in each is unstable."""
    load = (driven.Force((0,), (1.0,), 1.0),)
    system, Omega = oscillator(Linear(100.0)), np.array([2.9])
    one = Problem(system, Omega, load)
    first = driven.solve(one, driven.plan(one))
    two = Problem(system, Omega, load, 2, (driven.Impact(0), driven.Impact(0)))
    second = driven.solve(two, driven.plan(two))
    assert first.solution_exists is not None
    assert first.solution_stability is not None
    assert second.solution_exists is not None
    assert second.solution_stability is not None
    assert second.contact_solution is not None
    assert second.contact_duration is not None
    row = int(np.flatnonzero(first.solution_exists)[0])
    assert first.solution_stability[row] > 1.0
    stable = np.flatnonzero(second.solution_exists & (second.solution_stability < 1.0))
    assert stable.size == 1
    durations = second.contact_duration[second.contact_solution == stable[0]]
    assert abs(durations[0] - durations[1]) > 0.01 * durations[0]
    # Both multipliers are a pair, whose product is what damping makes of areas in two periods.
    modulus = math.exp(-0.5 * 0.1 * 2.0 * 2.0 * math.pi / 2.9)
    assert second.solution_stability[stable[0]] == pytest.approx(modulus, rel=1e-9)


def test_a_response_begins_with_the_frequency_before() -> None:
    """All frequencies of a range have the motion that is followed along it."""
    case = Two.random(10)
    problem = case.problem((FIRST, SECOND)).at(np.linspace(case.Omega, 1.005 * case.Omega, 3))
    result = driven.solve(problem, driven.plan(problem))
    assert result.solution_exists is not None
    assert result.complete is not None
    assert not result.complete.any()
    exists = result.solution_exists & (result.solution_contacts == 2)
    assert set(result.solution_frequency_index[exists].tolist()) == {0, 1, 2}


def test_the_search_begins_where_it_is_asked_to() -> None:
    case = Two.random(10)
    whole = case.problem((FIRST, SECOND))
    result, _ = results(whole)
    assert result.contact_phase is not None
    assert result.contact_solution is not None
    assert result.solution_exists is not None
    row = int(
        result.contact_solution[np.flatnonzero(result.solution_exists[result.contact_solution])[0]]
    )
    phases = result.contact_phase[result.contact_solution == row]
    begun = Problem(
        whole.system, whole.Omega, whole.load, 1, whole.sequence, phases=phases[np.newaxis]
    )
    again = driven.solve(begun, driven.plan(begun))
    assert again.contact_phase is not None
    apart = np.abs(again.contact_phase[:, np.newaxis] - phases).min(axis=0)
    assert (apart < 1e-9).all()


@pytest.mark.parametrize(
    ("options", "pointer", "code"),
    [
        ({"load": ()}, ("load",), "not_possible"),
        ({"sequence": (driven.Impact(0), driven.Impact(1))}, ("sequence", 1, "constraint"),
         "index_out_of_range"),
        ({"sequence": driven.SYMMETRIC, "system": System(
            SymmetricMatrix.diagonal([1.0]), SymmetricMatrix.diagonal([1.0]),
            (Constraint((0,), (1.0,), 0.1, 0.1, law=Linear(5.0)),)),
          "load": (driven.Force((0,), (1.0,), 1.0), driven.Force((0,), (1.0,), 1.0, 3))},
         ("load",), "not_possible"),
    ],
)  # fmt: skip
def test_errors_name_the_field(options: Any, pointer: Any, code: str) -> None:
    given = {
        "system": oscillator(Linear(10.0)), "Omega": np.array([1.0]),
        "load": (driven.Force((0,), (1.0,), 1.0),),
    }  # fmt: skip
    with pytest.raises(ModelError) as caught:
        Problem(**(given | options))
    assert (caught.value.pointer, caught.value.code) == (pointer, code)


def test_a_free_body_under_a_constant_load_is_refused() -> None:
    system = System(
        SymmetricMatrix.diagonal([1.0]), SymmetricMatrix.diagonal([0.0]),
        (Constraint((0,), (1.0,), 0.0, None, law=Linear(100.0, 1.0)),), force=np.array([-1.0]),
    )  # fmt: skip
    load = (driven.Force((0,), (1.0,), 1.0),)
    twice = (driven.Impact(0, -1), driven.Impact(0, -1))
    problem = Problem(system, np.array([1.0]), load, 2, twice)
    with pytest.raises(ModelError) as caught:
        driven.solve(problem, driven.plan(problem))
    assert (caught.value.pointer, caught.value.code) == (("system", "force"), "free_body")
