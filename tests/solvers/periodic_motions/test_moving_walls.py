"""Periodic motions of structures with linear stops whose walls move with the drive.

Against long time histories with walls of the same frequency, and a Runge-Kutta method.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.reference.stopped_runge_kutta import StoppedMotion
from tests.solvers.time_history.test_moving_walls import course_of
from vibroimpact_solvers import attractors, time_history
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.flexibility import in_series
from vibroimpact_solvers.laws import Law, Linear, Rigid
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.walls import Samples, Swing, Turn, Wall

ALL = frozenset(driven.OUTPUTS)
UPPER, LOWER = driven.Impact(0, 1), driven.Impact(0, -1)
TAU = np.linspace(0.0, 1.0, 65)[:-1]
TURNS = 120
LOAD = (driven.Force((0,), (1.0,), 1.0, 1, 0.3),)


def structure(n: int, stops: Any, seed: int, damping: float) -> System:
    """Return masses in a row, with unequal springs and masses."""
    rng = np.random.default_rng(seed)
    k, m = rng.uniform(0.7, 1.3, n + 1), rng.uniform(0.7, 1.3, n)
    K = np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
    C = SymmetricMatrix.dense(damping * K + 0.05 * np.eye(n))
    return System(SymmetricMatrix.diagonal(m), SymmetricMatrix.dense(K), stops, C=C)


def random_case(seed: int) -> tuple[System, float, Any]:
    """Return 1, 3 or 10 masses with one stop or two, a frequency and a load, or none."""
    rng = np.random.default_rng(seed)
    n = int(rng.choice([1, 3, 10]))
    stops = []
    for place, dof in enumerate(rng.choice(n, min(n, int(rng.integers(1, 3))), replace=False)):
        law = Linear(10.0 ** rng.uniform(0.0, 2.0), float(rng.choice([0.0, 0.3, 2.0])))
        swing, gap = Turn(rng.uniform(0.05, 0.5), 1, rng.uniform(0.0, 6.0)), rng.uniform(0.0, 0.4)
        wall = (swing,) if place == 0 or rng.random() < 0.6 else ()
        stops.append(Constraint((int(dof),), (1.0,), None, gap, law=law, wall=wall))
    system = structure(n, tuple(stops), seed, rng.uniform(0.1, 0.5))
    return system, float(rng.uniform(0.5, 2.0)), LOAD if rng.random() < 0.7 else ()


def motions(
    system: System, Omega: Any, load: Any = (), sequence: Any = (UPPER,), **more: Any
) -> Any:
    given = {"outputs": ALL, "tau": TAU} | more
    problem = driven.Problem(system, np.atleast_1d(Omega), load, sequence=sequence, **given)
    return driven.solve(problem, driven.plan(problem))


def swinging(system: System, Omega: float) -> System:
    """Return the structure with walls that swing with frequencies of their own."""
    stops = []
    for c in system.constraints:
        turns: list[Any] = list(c.wall)  # type: ignore[arg-type]
        wall = tuple(Swing(w.amplitude, w.harmonic * Omega, w.phase) for w in turns)
        stops.append(Constraint(c.dofs, c.weights, c.lower, c.upper, law=c.law, wall=wall))
    other = system.limited(stops)
    return other if system.flexibility is None else in_series(other, system.flexibility)


def settled(system: System, Omega: float, load: Any, tau: Any = TAU) -> Any:
    """Return the last period of a long motion from rest, and one before."""
    zero, T = np.zeros(system.n), 2.0 * math.pi / Omega
    terms = tuple(
        time_history.Harmonic(dof, f.amplitude * w, f.harmonic * Omega, f.phase)
        for f in load
        for dof, w in zip(f.dofs, f.weights, strict=True)
    )
    t = np.concatenate([[(TURNS - 1) * T], TURNS * T + T * tau, [(TURNS + 1) * T]])
    problem = time_history.Problem(
        swinging(system, Omega), time_history.State(zero, zero), float(t[-1]), t=t, load=terms,
        outputs=frozenset({"x", "v", "force", "contacts"}),
    )  # fmt: skip
    return time_history.solve(problem, time_history.plan(problem))


def the_row(result: Any, long: Any, contacts: int) -> int:
    """Return the row of the motion that a long history has settled on."""
    rows = np.flatnonzero(result.solution_contacts == contacts)
    apart = np.abs(result.waveform[rows] - long.x[1:-1]).max(axis=(1, 2))
    row = int(rows[apart.argmin()])
    assert apart.min() < 1e-8
    assert result.solution_exists[row]
    assert result.solution_certified[row]
    assert result.solution_stability[row] < 1.0
    return row


def reference(system: System, Omega: float, load: Any) -> StoppedMotion:
    def force(t: float) -> Any:
        total = np.zeros(system.n)
        for f in load:
            total[list(f.dofs)] += f.amplitude * math.cos(f.harmonic * Omega * t + f.phase)
        return total

    walls = [course_of(c.wall) for c in swinging(system, Omega).constraints]
    return StoppedMotion(system, force, np.zeros((len(walls), len(walls))), walls)


def multipliers_of(system: System, Omega: float, load: Any, z: Any) -> Any:
    """Return multipliers by central differences of a period's motion."""
    T, n, columns = 2.0 * math.pi / Omega, system.n, []
    for one in 1e-5 * np.eye(2 * n):
        ends = [
            reference(system, Omega, load).follow((z + d)[:n], (z + d)[n:], np.array([T]))[-1]
            for d in (one, -one)
        ]
        columns.append((ends[0] - ends[1]) / 2e-5)
    return np.linalg.eigvals(np.column_stack(columns))


SETTLING = [14, 27, 35, 54, 12, 19, 88, 41, 28, 1, 31, 3, 8, 2, 72, 15, 66]
"""Seeds of cases that settle on motions with one or two contacts in a period."""


@pytest.mark.parametrize("seed", SETTLING)
def test_motions_are_those_on_which_histories_settle(seed: int) -> None:
    """Of 1, 3 and 10 masses, with one stop or two, with and without a load beside the walls."""
    system, Omega, load = random_case(seed)
    long, T = settled(system, Omega, load), 2.0 * math.pi / Omega
    assert np.abs(long.x[0] - long.x[1]).max() < 1e-10
    last = (long.contact_start >= (TURNS - 0.5) * T) & (long.contact_start < (TURNS + 0.5) * T)
    order = tuple(driven.Impact(int(a), 1) for a in long.contact_constraint[last])
    assert len(order) in (1, 2)
    result = motions(system, Omega, load, order)
    row = the_row(result, long, len(order))
    own = 1e-10 + np.abs(long.x[0] - long.x[1]).max()
    off = result.error_waveform[row] + long.error_x[1:-1] + own
    assert (np.abs(result.waveform[row] - long.x[1:-1]) <= off).all()
    assert result.error_waveform[row].max() < 1e-10
    assert (result.solution_x_max[row] >= long.x[1:-1].max(axis=0) - own).all()
    assert (result.solution_x_min[row] <= long.x[1:-1].min(axis=0) + own).all()
    contacts = np.flatnonzero(result.contact_solution == row)
    for k in np.flatnonzero(last):
        phase = long.contact_start[k] * Omega
        apart = np.mod(result.contact_phase[contacts] - phase + 1.0, 2.0 * math.pi) - 1.0
        apart[result.contact_constraint[contacts] != long.contact_constraint[k]] = np.inf
        here = contacts[np.abs(apart).argmin()]
        assert np.abs(apart).min() < 1e-8
        duration = long.contact_stop[k] - long.contact_start[k]
        assert abs(result.contact_duration[here] - duration) < 1e-8
        for name in ("velocity", "impulse", "peak_force", "indentation"):
            mine, theirs = (getattr(each, f"contact_{name}") for each in (result, long))
            assert abs(mine[here] - theirs[k]) < 1e-8 * (1.0 + abs(theirs[k])), name
    loss = result.contact_energy_lost[contacts].sum() - long.contact_energy_lost[last].sum()
    assert abs(loss) < 1e-8
    lost = result.error_work + result.error_energy_lost
    assert (np.abs(result.solution_work - result.solution_energy_lost) <= lost)[row]


@pytest.mark.parametrize("seed", [27, 19, 1, 31, 54])
def test_a_runge_kutta_method_returns_to_them_with_their_multipliers(seed: int) -> None:
    system, Omega, load = random_case(seed)
    long, T = settled(system, Omega, load), 2.0 * math.pi / Omega
    last = (long.contact_start >= (TURNS - 0.5) * T) & (long.contact_start < (TURNS + 0.5) * T)
    order = tuple(driven.Impact(int(a), 1) for a in long.contact_constraint[last])
    result = motions(system, Omega, load, order)
    row, one = the_row(result, long, len(order)), reference(system, Omega, load)
    z = np.concatenate([long.x[1], long.v[1]])
    states = one.follow(long.x[1], long.v[1], np.append(T * TAU, T))
    assert np.abs(states[-1] - z).max() < 1e-9
    assert np.abs(states[:-1, : system.n] - result.waveform[row]).max() < 1e-9
    expected = multipliers_of(system, Omega, load, z)
    found = result.multipliers_real[row] + 1j * result.multipliers_imaginary[row]
    for value in expected:
        assert np.abs(found - value).min() < 1e-6
    assert abs(np.abs(expected).max() - result.solution_stability[row]) < 1e-6


@pytest.mark.parametrize(("damping", "close"), [(0.0, 1e-5), (2.0, 1e-3)])
def test_the_walls_do_the_work(damping: float, close: float) -> None:
    """By sums along a history without a load, whose forces jump where a dashpot is met."""
    stop = Constraint((1,), (1.0,), 0.3, 0.2, law=Linear(8.0, damping), wall=(Turn(0.4, 1, 0.5),))
    system, Omega = structure(2, (stop,), 3, 0.3), 1.1
    tau, walls = np.arange(8192) / 8192.0, (UPPER, LOWER)
    result, long = motions(system, Omega, (), walls), settled(system, Omega, (), tau)
    fine = motions(system, Omega, (), walls, tau=tau)
    row = the_row(fine, long, 2)
    phase = 2.0 * np.pi * tau + 0.5
    side = np.sign(long.x[1:-1, 1] - 0.4 * np.cos(phase))
    power = -side * long.force[1:-1, 0] * -0.4 * Omega * np.sin(phase)
    T = 2.0 * math.pi / Omega
    assert result.solution_work[row] == pytest.approx(T * power.mean(), rel=close)
    assert system.C is not None
    v = long.v[1:-1]
    dragged = T * ((v @ system.C.to_dense()) * v).sum(axis=1).mean()
    contacts = result.contact_energy_lost[result.contact_solution == row].sum()
    assert result.solution_energy_lost[row] == pytest.approx(dragged + contacts, rel=close)
    assert (contacts > 0.01) == (damping > 0.0)
    x = long.x[1:-1]
    np.testing.assert_allclose(result.solution_rms[row], np.sqrt((x**2).mean(axis=0)), rtol=1e-8)
    extremes = result.solution_x_max[row], result.solution_x_min[row]
    np.testing.assert_allclose(extremes, (x.max(axis=0), x.min(axis=0)), rtol=1e-5)
    # Without a contact nothing moves but the walls.
    assert np.abs(result.waveform[0]).max() <= result.error_waveform[0].max() < 1e-14
    assert not result.solution_exists[0]


def test_the_energy_is_that_of_the_structure() -> None:
    """At the beginning of the first contact, by the state that a history has there."""
    system, Omega, load = random_case(27)
    long, T = settled(system, Omega, load), 2.0 * math.pi / Omega
    result = motions(system, Omega, load)
    row, start = the_row(result, long, 1), long.contact_start[-1]
    at = start - T if start > TURNS * T else start
    again = settled(system, Omega, load, np.array([(at + T) / T - TURNS]))
    x, v = again.x[1], again.v[1]
    energy = 0.5 * (x @ (system.K @ x) + v @ (system.M @ v))
    assert result.solution_energy[row] == pytest.approx(energy, rel=1e-8)


def test_symmetric_motions() -> None:
    """Both walls of a coordinate swing together: half of the period mirrors the other."""
    stop = Constraint((0,), (1.0,), 0.3, 0.3, law=Linear(12.0, 0.5), wall=(Turn(0.2, 1, 1.2),))
    system, Omega = structure(3, (stop,), 4, 0.3), 0.9
    result, long = motions(system, Omega, LOAD, "symmetric"), settled(system, Omega, LOAD)
    row = the_row(result, long, 2)
    contacts = np.flatnonzero(result.contact_solution == row)
    assert result.contact_side[contacts].tolist() in ([1, -1], [-1, 1])
    forces = np.sort(long.contact_peak_force[-2:])
    np.testing.assert_allclose(np.sort(result.contact_peak_force[contacts]), forces, rtol=1e-9)
    lost = result.error_work + result.error_energy_lost
    assert (np.abs(result.solution_work - result.solution_energy_lost) <= lost)[row]


def test_walls_have_harmonics_of_their_own_and_several_frequencies_are_independent() -> None:
    """Two harmonics, with a flexibility in series; a search finds what histories settle on."""
    stop = Constraint(
        (1,), (1.0,), None, 0.2, law=Linear(15.0), wall=(Turn(0.1, 2, 1.2), Turn(0.2))
    )
    system = in_series(structure(2, (stop,), 5, 0.4), [[0.02]])
    Omega = np.array([0.8, 0.9])
    result = motions(system, Omega, LOAD)
    for f, each in enumerate(Omega.tolist()):
        alone, long = motions(system, each, LOAD), settled(system, each, LOAD)
        row = the_row(alone, long, 1)
        (there,) = np.flatnonzero(
            (result.solution_frequency_index == f) & (result.solution_contacts == 1)
            & result.solution_exists
        )  # fmt: skip
        np.testing.assert_array_equal(result.waveform[there], alone.waveform[row])


def test_a_wall_that_moves_like_its_structure_is_one_at_rest() -> None:
    """A frame that moves as a whole: relative motions are those under the inertia forces."""
    Omega, A = 1.2, 0.3
    K, law = np.array([[2.0, -1.0], [-1.0, 1.5]]), Linear(20.0, 0.4)
    M, C = SymmetricMatrix.diagonal([1.0, 1.3]), SymmetricMatrix.dense(0.3 * K)

    def structure_(*wall: Turn) -> System:
        stop = Constraint((1,), (1.0,), None, 0.1, law=law, wall=wall)
        return System(M, SymmetricMatrix.dense(K), (stop,), C=C)

    # The base of the springs to the ground moves with the wall, by forces K r and C r'.
    moved = A * (K @ np.ones(2))
    load = [driven.Force((0, 1), tuple(moved.tolist()), 1.0)]
    load.append(driven.Force((0, 1), tuple((0.3 * Omega * moved).tolist()), 1.0, 1, 0.5 * math.pi))
    absolute = motions(structure_(Turn(A)), Omega, tuple(load))
    inertia = driven.Force((0, 1), (1.0, 1.3), A * Omega**2)
    relative = motions(structure_(), Omega, (inertia,))
    np.testing.assert_array_equal(absolute.solution_exists, relative.solution_exists)
    for name in ("contact_phase", "contact_duration", "contact_peak_force", "solution_stability"):
        np.testing.assert_allclose(
            getattr(absolute, name), getattr(relative, name), rtol=1e-9, atol=1e-12
        )
    shift = A * np.cos(2.0 * np.pi * TAU)[:, np.newaxis]
    np.testing.assert_allclose(absolute.waveform, relative.waveform + shift, atol=1e-10)


@pytest.mark.parametrize(
    ("wall", "law", "where", "message"),
    [
        ((Turn(0.1),), Rigid(0.8), (), "constraint 0 is rigid"),
        ((Swing(0.1, 2.0),), Linear(3.0), (0, "frequency"), "not a frequency"),
        (Samples((0.0, 9.0), (0.0, 0.1)), Linear(3.0), (), "time-history"),
    ],
)
def test_other_walls_are_refused(wall: Wall, law: Law, where: Any, message: str) -> None:
    one = SymmetricMatrix.diagonal([1.0])
    system = System(one, one, (Constraint((0,), (1.0,), None, 0.1, law=law, wall=wall),))
    with pytest.raises(ModelError, match=message) as refused:
        motions(system, 1.3, LOAD)
    assert refused.value.pointer == ("system", "constraints", 0, "wall", *where)


def test_kinds_and_structures_that_do_not_have_them_say_so() -> None:
    one = SymmetricMatrix.diagonal([1.0])
    stop = Constraint((0,), (1.0,), None, 0.1, law=Linear(3.0), wall=(Turn(0.1),))
    system = System(one, one, (stop,))
    with pytest.raises(ModelError, match="offered by time-history and periodic-motions"):
        attractors.Problem(system, np.array([1.3]), np.zeros((1, 1)), np.zeros((1, 1)), LOAD)
    zero = time_history.State(np.zeros(1), np.zeros(1))
    with pytest.raises(ModelError, match="there is no drive's harmonic"):
        time_history.Problem(system, zero, 1.0, t=np.array([1.0]))
    for turn in ({"amplitude": math.inf}, {"amplitude": 1.0, "harmonic": 0}):
        with pytest.raises(ModelError):
            Turn(**turn)  # type: ignore[arg-type]
    light = SymmetricMatrix.diagonal([1.0, 0.0])
    stiff = SymmetricMatrix.dense([[2.0, -1.0], [-1.0, 2.0]])
    with pytest.raises(ModelError, match="all degrees of freedom have mass"):
        motions(System(light, stiff, (stop,)), 1.3, LOAD)
    # Three directions in a plane: the third wall cannot stand still.
    both = SymmetricMatrix.diagonal([1.0, 2.0])
    stops = [
        Constraint((0, 1), row, None, 0.1, law=Linear(3.0), wall=wall)
        for row, wall in (((1.0, 0.0), (Turn(0.1),)), ((0.0, 1.0), ()), ((1.0, 1.0), ()))
    ]
    with pytest.raises(ModelError, match="depend on one another") as refused:
        motions(System(both, both, stops), 1.3, LOAD)  # type: ignore[arg-type]
    assert refused.value.pointer[:2] == ("system", "constraints")
