"""Sequences of several impacts, against closed forms and time histories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers import time_history
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System


def solved(problem: driven.Problem) -> driven.Result:
    return driven.solve(problem, driven.plan(problem))


def structure(n: int = 4, restitution: float = 0.9) -> System:
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    return System(
        SymmetricMatrix.diagonal(np.ones(n)),
        SymmetricMatrix.dense(K),
        (Constraint.at(1, 1.0, restitution=restitution),),
        C=SymmetricMatrix.dense(0.03 * K),
    )


LOAD = (driven.Force((0,), (1.0,), 0.5),)


def test_two_impacts_find_the_symmetric_motions() -> None:
    Omega = np.array([0.6, 0.75, 1.2])
    closed = solved(driven.Problem(structure(), Omega, LOAD, sequence=driven.SYMMETRIC))
    both = (driven.Impact(0, 1), driven.Impact(0, -1))
    searched = solved(driven.Problem(structure(), Omega, LOAD, sequence=both))
    assert (closed.solution_impacts == 2).sum() >= 2
    for row in np.flatnonzero(closed.solution_impacts):
        at = int(np.flatnonzero(closed.impact_solution == row)[0])
        same = searched.solution_frequency_index == closed.solution_frequency_index[row]
        near = same[searched.impact_solution] & (
            np.abs(searched.impact_phase - closed.impact_phase[at]) < 1e-9
        )
        match = np.flatnonzero(near)
        assert match.size == 1
        place = int(match[0])
        momentum = searched.impact_momentum[place]
        allowed = closed.error_momentum[at] + searched.error_momentum[place]
        assert abs(momentum - closed.impact_momentum[at]) <= allowed
        other = int(searched.impact_solution[place])
        assert searched.solution_stability[other] == pytest.approx(
            closed.solution_stability[row], rel=1e-9
        )
        assert searched.solution_exists[other] == closed.solution_exists[row]


@pytest.mark.parametrize(
    ("gap", "Omega", "periods", "impacts"), [(0.0, 3.5, 2, 1), (0.0, 3.0, 4, 4), (0.2, 2.7, 4, 3)]
)
def test_motions_of_several_periods_are_what_time_histories_settle_on(
    gap: float, Omega: float, periods: int, impacts: int
) -> None:
    one = SymmetricMatrix.diagonal([1.0])
    wall = Constraint((0,), (1.0,), None, gap, 0.8)
    system = System(one, one, (wall,), C=SymmetricMatrix.diagonal([0.1]))
    end = 400.0 * 2.0 * np.pi / Omega
    history_problem = time_history.Problem(
        system, time_history.State(np.array([-0.3]), np.array([0.0])), end,
        load=(time_history.Harmonic(0, 1.0, Omega, 0.0),), outputs=frozenset({"impacts"}),
    )  # fmt: skip
    history = time_history.solve(history_problem, time_history.plan(history_problem))
    times, momenta = history.impact_time[-impacts:], history.impact_impulse[-impacts:]
    phases = Omega * times - 2.0 * np.pi * np.floor(Omega * times[0] / (2.0 * np.pi))
    problem = driven.Problem(
        system, np.array([Omega]), (driven.Force((0,), (1.0,), 1.0),), periods,
        (driven.Impact(0),) * impacts, phases=phases[np.newaxis],
    )  # fmt: skip
    result = solved(problem)
    stable = result.solution_exists & (result.solution_stability < 1.0)
    stable &= result.solution_impacts == impacts
    (row,) = np.flatnonzero(stable)
    mine = result.impact_solution == row
    begin, period = int(np.argmax(momenta)), 2.0 * np.pi * periods / Omega
    assert result.impact_momentum[mine] == pytest.approx(np.roll(momenta, -begin), abs=1e-6)
    since, told = np.roll(times, -begin) - times[begin], result.impact_time[mine]
    assert np.mod(told - told[0], period) == pytest.approx(np.mod(since, period), abs=1e-6)
    assert result.solution_work[row] == pytest.approx(result.solution_energy_lost[row], rel=1e-11)


def shifted(phases: np.ndarray, momenta: np.ndarray, periods: int) -> set[tuple[int, ...]]:
    """Return a motion as it is when late by periods of the drive, each impact as two numbers."""
    turns = np.arange(periods)[:, np.newaxis]
    late = np.mod((phases + 2.0 * np.pi * turns) / (2.0 * np.pi * periods), 1.0)
    late = np.round(late * 1e6) % 1e6
    order = np.argsort(late, axis=1)
    both = np.take_along_axis(late, order, axis=1), np.round(1e6 * momenta)[order]
    return {tuple(row) for row in np.concatenate(both, axis=1).astype(int).tolist()}


@pytest.mark.parametrize(
    ("Omega", "periods", "impacts", "motions"), [(2.6, 3, 3, 6), (2.7, 2, 2, 7), (0.9, 1, 2, 3)]
)
def test_motions_and_phantoms_are_listed_once_whichever_impact_is_first(
    Omega: float, periods: int, impacts: int, motions: int
) -> None:
    """Late by a period of the drive, a motion of several periods is the same motion."""
    one = SymmetricMatrix.diagonal([1.0])
    wall = Constraint((0,), (1.0,), None, 0.0, 0.8)
    system = System(one, one, (wall,), C=SymmetricMatrix.diagonal([0.1]))
    problem = driven.Problem(
        system, np.array([Omega]), (driven.Force((0,), (1.0,), 1.0),), periods,
        (driven.Impact(0),) * impacts,
    )  # fmt: skip
    result = solved(problem)
    seen = set[tuple[int, ...]]()
    rows = np.flatnonzero(result.solution_impacts)
    for row in rows:
        mine = result.impact_solution == row
        phases, momenta = Omega * result.impact_time[mine], result.impact_momentum[mine]
        same = shifted(phases, momenta, periods)
        assert not seen & same
        seen |= same
        assert np.abs(momenta[0]) >= np.abs(momenta).max() - 1e-6
    assert rows.size == motions


def test_an_impact_is_at_its_time_in_the_period_of_the_motion() -> None:
    """The displacement at that part of the period is the wall's position."""
    one, gap, periods = SymmetricMatrix.diagonal([1.0]), 0.2, 4
    system = System(
        one, one, (Constraint((0,), (1.0,), None, gap, 0.8),), C=SymmetricMatrix.diagonal([0.1])
    )
    problem = driven.Problem(
        system, np.array([2.7]), (driven.Force((0,), (1.0,), 1.0, phase=0.3),), periods,
        (driven.Impact(0),) * 3,
    )  # fmt: skip
    first = solved(problem)
    period = 2.0 * np.pi * periods / 2.7
    assert first.impact_time.size
    assert (first.impact_time.min() >= 0.0) & (first.impact_time.max() < period)
    assert np.mod(2.7 * first.impact_time, 2.0 * np.pi) == pytest.approx(first.impact_phase)
    tau = first.impact_time / period
    outputs = frozenset({"exists", "waveform"})
    waveform = solved(replace(problem, tau=tau, outputs=outputs)).waveform
    assert waveform is not None
    at = waveform[first.impact_solution, np.arange(tau.size), 0]
    assert at == pytest.approx(np.full(tau.size, gap), abs=1e-11)
    assert (first.error_time * 2.7 >= first.error_phase).all()
    assert first.error_time.max() < 1e-9


def test_starts_of_the_request_lead_to_their_solution() -> None:
    Omega = np.array([0.75])
    both = (driven.Impact(0, 1), driven.Impact(0, -1))
    every = solved(driven.Problem(structure(), Omega, LOAD, sequence=both))
    row = int(np.flatnonzero(every.solution_impacts)[0])
    phases = every.impact_phase[every.impact_solution == row]
    guess = np.array([[phases[0] + 1e-3, phases[0] + np.mod(phases[1] - phases[0], 2 * np.pi)]])
    one = solved(driven.Problem(structure(), Omega, LOAD, sequence=both, phases=guess))
    assert (one.solution_impacts > 0).sum() == 1
    assert one.impact_phase == pytest.approx(phases, abs=1e-9)


def test_stable_motions_attract_and_are_repeated() -> None:
    """The time history from a motion's own state has its impacts while errors do not grow."""
    Omega = np.array([0.75])
    tau = np.array([0.0])
    problem = driven.Problem(
        structure(), Omega, LOAD, sequence=driven.SYMMETRIC, tau=tau,
        outputs=frozenset({"exists", "multipliers", "waveform"}),
    )  # fmt: skip
    result = solved(problem)
    rows = np.flatnonzero(result.solution_exists & (result.solution_impacts > 0))
    assert rows.size
    row = int(rows[0])
    step = 1e-5
    fine = driven.Problem(
        structure(), Omega, LOAD, sequence=driven.SYMMETRIC, tau=np.array([0.0, step, 1.0 - step]),
        outputs=frozenset({"waveform"}),
    )  # fmt: skip
    x, later, earlier = solved(fine).waveform[row]
    period = 2.0 * np.pi / Omega[0]
    v = (later - earlier) / (2.0 * step * period)  # to 1e-9
    load = (time_history.Harmonic(0, 0.5, float(Omega[0]), 0.0),)
    history_problem = time_history.Problem(
        structure(), time_history.State(x, v), period, load=load, outputs=frozenset({"impacts"})
    )
    history = time_history.solve(history_problem, time_history.plan(history_problem))
    mine = result.impact_solution == row
    order = np.argsort(result.impact_phase[mine])
    assert history.impact_time == pytest.approx(
        result.impact_phase[mine][order] / Omega[0], abs=1e-6
    )
    assert history.impact_impulse == pytest.approx(result.impact_momentum[mine][order], abs=1e-6)


@pytest.mark.parametrize("Omega", [1.5, 2.2])
@pytest.mark.parametrize("coupling", [0.0, 0.05])
def test_impacts_of_two_walls_may_coincide(Omega: float, coupling: float) -> None:
    """A symmetric structure driven in phase strikes both, as half of it strikes one."""
    K = np.array([[2.0, -1.0], [-1.0, 2.0]])
    walls = [Constraint((dof,), (1.0,), None, 0.2, 0.8) for dof in range(2)]
    ones, C = SymmetricMatrix.diagonal([1.0, 1.0]), coupling * K if coupling else 0.1 * np.eye(2)
    both = System(ones, SymmetricMatrix.dense(K), tuple(walls), C=SymmetricMatrix.dense(C))
    one = SymmetricMatrix.diagonal([1.0])
    half = System(one, one, tuple(walls[:1]), C=SymmetricMatrix.diagonal(C.sum(axis=1)[:1]))
    outputs = frozenset(driven.OUTPUTS) - {"waveform"}
    sequence = driven.Impact(0), driven.Impact(1)
    load = (driven.Force((0, 1), (1.0, 1.0), 1.0),)
    pairs = driven.Problem(both, np.array([Omega]), load, sequence=sequence, outputs=outputs)
    alone = driven.Problem(
        half, np.array([Omega]), (driven.Force((0,), (1.0,), 1.0),), outputs=outputs
    )
    result, expected = (driven.solve(each, driven.plan(each)) for each in (pairs, alone))
    for row in np.flatnonzero(expected.solution_exists & (expected.solution_impacts == 1)):
        (k,) = np.flatnonzero(expected.impact_solution == row)
        phases = result.impact_phase.reshape(-1, 2)
        near = np.abs(phases - expected.impact_phase[k]).max(axis=1) < 1e-9
        (same,) = np.flatnonzero(near)
        pushed = result.impact_momentum.reshape(-1, 2)[same]
        assert pushed == pytest.approx(expected.impact_momentum[k], rel=1e-10)
        two = int(np.flatnonzero(result.solution_impacts == 2)[same])
        assert result.solution_exists[two]
        mine, theirs = (
            each.multipliers_real[of] + 1j * each.multipliers_imaginary[of]
            for each, of in ((result, two), (expected, row))
        )
        for multiplier in theirs:
            assert np.abs(mine - multiplier).min() < 1e-9
        for multiplier in mine:
            assert np.abs(mine - multiplier.conjugate()).min() < 1e-9
        energies = result.solution_energy_lost[two], expected.solution_energy_lost[row]
        assert energies[0] == pytest.approx(2.0 * energies[1], rel=1e-10)
    assert (expected.solution_exists & (expected.solution_impacts == 1)).any()
