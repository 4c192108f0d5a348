"""Periodic attractors by Newton's method, begun at the impacts that time histories end with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroimpact_solvers import periodic_motions
from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.attractors.observed import Impacts
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.attractors.verdicts import Verdict, sequence
from vibroimpact_solvers.errors import SolverError, attempt
from vibroimpact_solvers.periodic_motions import SYMMETRIC, Impact
from vibroimpact_solvers.results.attractors import Nature, Verification

MOST_IMPACTS: Final = 32
"""Impacts per period up to which sequences are confirmed."""
_SAME: Final = 1e-3  # difference of phases, rad


@dataclass(frozen=True, eq=False, slots=True)
class Confirmed:
    """The impacts of one period of an attractor, and what Newton's method says of them.

    Errors are nan where it does not confirm the motion, whose impacts are then those of its time
    history.
    """

    verification: Verification
    impacts: Impacts
    phase: Floats
    errors: tuple[Floats, Floats, Floats]  # of phases, momenta and velocities
    stability: float = np.nan
    stability_error: float = np.inf


def confirmed(problem: Problem, settled: Verdict, *, newton: bool) -> Confirmed:
    """Confirm an attractor, where that is asked for and possible."""
    periodic = settled.nature is Nature.PERIODIC
    impacts = sequence(problem, settled) if periodic else settled.motion.impacts.between(0.0, 0.0)
    phase = np.mod(float(problem.Omega[0]) * impacts.time, 2.0 * np.pi)
    nothing = np.full(phase.size, np.nan)

    def unconfirmed(why: Verification) -> Confirmed:
        return Confirmed(why, impacts, phase, (nothing, nothing, nothing))

    if not periodic:
        return unconfirmed(Verification.NOT_PERIODIC)
    if settled.motion.rests:
        return unconfirmed(Verification.RESTS)
    if impacts.time.size > MOST_IMPACTS:
        return unconfirmed(Verification.TOO_LONG)
    if not newton:
        return unconfirmed(Verification.NOT_REACHED)
    for sequence_of in (_symmetric, _general):
        solved = attempt(sequence_of, problem, settled, impacts)
        at = (
            None
            if solved is None or isinstance(solved, SolverError)
            else _at(solved, phase, impacts)
        )
        if at is not None:
            return _of_solution(solved, at, impacts)
    return unconfirmed(Verification.NOT_REACHED)


def _of_solution(solved: periodic_motions.Result, at: Integers, impacts: Impacts) -> Confirmed:
    """Return what the solution says to which these rows of impacts belong, in their order.

    Without impacts it is the motion without any.
    """
    assert solved.solution_stability is not None
    assert solved.error_stability is not None
    none = int(np.flatnonzero(solved.solution_impacts == 0)[0]) if at.size == 0 else -1
    row = int(solved.impact_solution[at[0]]) if at.size else none
    modulus, error = float(solved.solution_stability[row]), float(solved.error_stability[row])
    why = Verification.UNSTABLE if modulus > 1.0 + error else Verification.CONFIRMED
    exact = Impacts(
        impacts.time, solved.impact_constraint[at], solved.impact_side[at],
        solved.impact_velocity[at], np.abs(solved.impact_momentum[at]),
    )  # fmt: skip
    errors = solved.error_phase[at], solved.error_momentum[at], solved.error_velocity[at]
    return Confirmed(why, exact, solved.impact_phase[at], errors, modulus, error)


def _symmetric(
    problem: Problem, settled: Verdict, impacts: Impacts
) -> periodic_motions.Result | None:
    """Return the motions with one impact at each wall, half a period apart; None: it has others.

    They are known also where a body is held by nothing but its stops.
    """
    one = impacts.constraint
    if one.size != 2 or one[0] != one[1] or impacts.side[0] == impacts.side[1]:
        return None
    given = problem.driven(settled.period, SYMMETRIC, constraint=int(one[0]))
    return periodic_motions.solve(given, periodic_motions.plan(given))


def _general(problem: Problem, settled: Verdict, impacts: Impacts) -> periodic_motions.Result:
    """Return the periodic motions with the sequence of impacts."""
    struck = zip(impacts.constraint.tolist(), impacts.side.tolist(), strict=True)
    phases = float(problem.Omega[0]) * (impacts.time - impacts.time[:1])
    if impacts.time.size:
        phases += np.mod(float(problem.Omega[0]) * impacts.time[0], 2.0 * np.pi)
    given = problem.driven(
        settled.period,
        tuple(Impact(constraint, side) for constraint, side in struck),
        phases[np.newaxis] if phases.size > 1 else None,
    )
    return periodic_motions.solve(given, periodic_motions.plan(given))


def _at(solved: periodic_motions.Result, phase: Floats, impacts: Impacts) -> Integers | None:
    """Return the rows of these impacts of an admissible solution, None: there is none."""
    assert solved.solution_exists is not None
    for row in np.flatnonzero(solved.solution_impacts == phase.size).tolist():
        mine = np.flatnonzero(solved.impact_solution == row)
        for first in range(max(1, mine.size)):
            at = np.roll(mine, -first)
            apart = np.abs(solved.impact_phase[at] - phase)
            same = np.minimum(apart, 2.0 * np.pi - apart) < _SAME
            same &= solved.impact_constraint[at] == impacts.constraint
            same &= solved.impact_side[at] == impacts.side
            if solved.solution_exists[row] and same.all():
                return at
    return None
