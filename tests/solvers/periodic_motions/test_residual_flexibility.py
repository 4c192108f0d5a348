"""Periodic motions of structures whose stops have a residual flexibility in series."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from vibroimpact_solvers import attractors, time_history
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers.flexibility import in_series
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

ALL = frozenset(driven.OUTPUTS)
UPPER = driven.Impact(0, 1)


def motions(system: System, Omega: float, load: Any, sequence: Any = (UPPER,)) -> Any:
    problem = driven.Problem(
        system, np.array([Omega]), load, sequence=sequence, outputs=ALL, tau=np.array([0.0, 0.5])
    )
    return driven.solve(problem, driven.plan(problem))


def settled(system: System, Omega: float, load: Any, turns: int) -> Any:
    """Return the last period of a long motion from rest, and its contacts."""
    zero, T = np.zeros(system.n), 2.0 * math.pi / Omega
    terms = tuple(
        time_history.Harmonic(dof, f.amplitude * w, Omega, f.phase)
        for f in load
        for dof, w in zip(f.dofs, f.weights, strict=True)
    )
    problem = time_history.Problem(
        system, time_history.State(zero, zero), (turns + 1) * T,
        t=turns * T + T * np.array([0.0, 0.5, 0.999]), load=terms,
        outputs=frozenset({"x", "force", "contacts"}),
    )  # fmt: skip
    return time_history.solve(problem, time_history.plan(problem))


def two_stops() -> System:
    """Three masses, two of which strike stops that displace one another."""
    K = np.array([[3.0, -1.0, 0.0], [-1.0, 3.0, -1.0], [0.0, -1.0, 2.0]])
    stops = tuple(
        Constraint((dof,), (1.0,), None, wall, law=Linear(k))
        for dof, wall, k in ((0, 0.3, 20.0), (2, 0.4, 30.0))
    )
    C = SymmetricMatrix.dense(0.2 * K)
    system = System(SymmetricMatrix.diagonal([1.0] * 3), SymmetricMatrix.dense(K), stops, C=C)
    return in_series(system, [[0.02, 0.03], [0.03, 0.06]])


LOAD = (driven.Force((0,), (1.0,), 1.0), driven.Force((2,), (1.0,), 1.3, 1, 0.6))


def test_a_stop_that_displaces_another_against_a_long_history() -> None:
    """With the second stop far away, so that it stays open but moves towards its wall."""
    system = two_stops()
    first, second = system.constraints[0], Constraint((2,), (1.0,), None, 9.0, law=Linear(3.0))
    one = in_series(system.limited((first, second)), [[0.02, 0.03], [0.03, 0.06]])
    result, long = motions(one, 1.3, LOAD), settled(one, 1.3, LOAD, 120)
    (row,) = np.flatnonzero(result.solution_exists & (result.solution_contacts == 1))
    assert result.solution_stability[row] < 1.0
    phase = long.contact_start[-1] * 1.3 % (2.0 * math.pi)
    (contact,) = np.flatnonzero(result.contact_solution == row)
    assert abs(result.contact_phase[contact] - phase) < 1e-9
    for name in ("impulse", "peak_force", "indentation", "velocity"):
        value = getattr(result, f"contact_{name}")[contact]
        assert abs(value - getattr(long, f"contact_{name}")[-1]) < 1e-9 * abs(value), name
    duration = long.contact_stop[-1] - long.contact_start[-1]
    assert abs(result.contact_duration[contact] - duration) < 1e-9
    softer = Linear(1.0 / (1.0 / 20.0 + 0.02))
    other = System(
        one.M, one.K, (Constraint((0,), (1.0,), None, 0.3, law=softer), one.constraints[1]), C=one.C
    )
    same = motions(other, 1.3, LOAD)
    (there,) = np.flatnonzero(same.solution_exists & (same.solution_contacts == 1))
    np.testing.assert_allclose(result.solution_x_max[row], same.solution_x_max[there], rtol=1e-11)
    gap = abs(result.solution_stability[row] - same.solution_stability[there])
    assert gap < 1e-9


@pytest.mark.parametrize("Omega", [1.1, 1.3])
def test_two_stops_in_turn_against_a_long_history(Omega: float) -> None:
    system = two_stops()
    long = settled(system, Omega, LOAD, 150)
    T = 2.0 * math.pi / Omega
    last = np.flatnonzero(long.contact_start > (150 - 0.5) * T)[:2]
    assert set(long.contact_constraint[last].tolist()) == {0, 1}
    overlap = long.contact_start[last[1]] < long.contact_stop[last[0]]
    order = tuple(driven.Impact(int(a), 1) for a in long.contact_constraint[last])
    result = motions(system, Omega, LOAD, order)
    rows = np.flatnonzero(result.solution_exists & (result.solution_contacts == 2))
    assert rows.size == 1
    assert overlap  # both are loaded for a while, where one displaces the other
    for k in last:
        (contact,) = np.flatnonzero(
            (result.contact_solution == rows[0])
            & (result.contact_constraint == long.contact_constraint[k])
        )
        for name in ("impulse", "peak_force", "indentation"):
            value = getattr(result, f"contact_{name}")[contact]
            assert abs(value - getattr(long, f"contact_{name}")[k]) < 1e-8 * abs(value), name
        duration = long.contact_stop[k] - long.contact_start[k]
        assert abs(result.contact_duration[contact] - duration) < 1e-8


def test_attractors_find_the_same() -> None:
    """Where their contacts end, and what they exchange, is what a long history says."""
    system, Omega = two_stops(), 1.1
    problem = attractors.Problem(
        system, np.array([Omega]), np.zeros((1, 3)), np.zeros((1, 3)), LOAD, settle=150
    )
    answer, long = (
        attractors.solve(problem, attractors.plan(problem)),
        settled(system, Omega, LOAD, 150),
    )
    assert answer.attractor_period.tolist() == [1]
    last = np.flatnonzero(long.contact_start > 149.5 * 2.0 * math.pi / Omega)[:2]
    order = np.argsort(long.contact_constraint[last])
    there = np.argsort(answer.contact_constraint)
    for name in ("impulse", "peak_force", "indentation"):
        of = getattr(answer, f"contact_{name}")[there]
        np.testing.assert_allclose(of, getattr(long, f"contact_{name}")[last][order], rtol=1e-8)


def test_the_rigid_limit_of_a_stop_is_its_flexibility() -> None:
    """k_s -> infinity at the rate 1/k_s: the stop of stiffness 1/delta."""
    K, delta = np.array([[2.0, -1.0], [-1.0, 2.0]]), 0.05
    M, C = SymmetricMatrix.diagonal([1.0, 1.0]), SymmetricMatrix.dense(0.1 * K)

    def duration(stiffness: float, series: float) -> float:
        stop = Constraint((0,), (1.0,), None, 0.2, law=Linear(stiffness))
        system = in_series(System(M, SymmetricMatrix.dense(K), (stop,), C=C), [[series]])
        result = motions(system, 1.2, (driven.Force((0,), (1.0,), 1.0),))
        (row,) = np.flatnonzero(result.solution_exists & (result.solution_contacts == 1))
        (contact,) = np.flatnonzero(result.contact_solution == row)
        return float(result.contact_duration[contact])

    limit = duration(1.0 / delta, 0.0)
    off = [duration(k, delta) - limit for k in (1e3, 1e4, 1e5, 1e12)]
    assert 0.0 < off[0] < 0.05
    for less, more in zip(off[1:3], off[:2], strict=True):
        assert 9.0 < more / less < 11.0
    assert abs(off[3]) < 1e-10
