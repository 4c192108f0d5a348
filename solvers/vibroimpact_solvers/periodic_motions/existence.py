"""Which solutions are admissible motions: impulses that push, and limits that are kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.kernels.limit_check import (
    BEYOND,
    KEPT,
    LOWER,
    PASSED,
    UPPER,
    VERDICT,
    FreeMotions,
    check_limits,
)
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.problem import Impact, Problem
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions
from vibroimpact_solvers.results.impact_modes import Reason


@dataclass(frozen=True, eq=False, slots=True)
class Verdicts:
    """Verdicts about solutions, each shape (solution,).

    Parameters
    ----------
    reason : array of int
        Of `Reason`.
    witness : array
        Part of the period, from the drive's phase 0, at which a limit is passed; nan for none.
    constraint : array of int
        The constraint whose limit that is; -1 for none.
    certified : array of bool
        Whether the errors of the motion cannot change the verdict.
    """

    reason: Integers
    witness: Floats
    constraint: Integers
    certified: Booleans


def verdicts(problem: Problem, driven: Driven, cells: Cells, solved: Solutions) -> Verdicts:
    """Decide which solutions exist; paths are examined where the impulses push."""
    look()
    count, m = solved.phase.shape
    impacts = problem.impacts if m else ()
    push = np.array([-impact.side for impact in impacts]) * solved.impulse
    reason = np.full(count, int(Reason.OK))
    reason[(push < 0.0).any(axis=1)] = Reason.NEGATIVE_IMPULSE
    certified: Booleans = np.asarray((np.abs(push) > solved.impulse_error).all(axis=1))
    witness, constraint = np.full(count, np.nan), np.full(count, -1)
    for place in np.flatnonzero(reason == Reason.NEGATIVE_IMPULSE):
        wrong = int(np.argmax(push[place] < 0.0))
        witness[place] = _part(problem, solved.phase[place, wrong])
        constraint[place] = impacts[wrong].constraint
    unbounded = cells.unbounded()[solved.index]
    reason[unbounded], certified[unbounded] = Reason.SINGULAR, False
    checked = np.flatnonzero(reason == Reason.OK)
    if checked.size:
        some = solved.at(checked)
        verdict, which, at = _check(problem, driven, cells, some, impacts)
        reason[checked[verdict >= BEYOND]] = Reason.PENETRATION
        witness[checked], constraint[checked] = at, which
        certified[checked] &= (verdict == KEPT) | (verdict == PASSED)
    return Verdicts(reason, witness, constraint, certified)


def _part(problem: Problem, phase: float) -> float:
    """Return the part of the motion's period that a phase of the drive stands for."""
    return float(np.mod(phase / (2.0 * np.pi * problem.periods), 1.0))


def _check(
    problem: Problem,
    driven: Driven,
    cells: Cells,
    solved: Solutions,
    impacts: tuple[Impact, ...],
) -> tuple[Integers, Integers, Floats]:
    """Return verdicts, constraints and witnesses of the paths of solutions."""
    count, legs = solved.length.shape
    walls = driven.walls
    if problem.symmetric:  # the mirrored half keeps the mirrored limits
        upper = np.minimum(walls[UPPER], -walls[LOWER])
        walls = np.ascontiguousarray([-upper, upper])
    watched = driven.watched(walls)
    every = _legs(problem, driven, cells, solved, impacts)
    decided = np.zeros(count * legs, VERDICT)
    check_limits(driven.pairs.flow, watched, every, decided)
    kinds, which, times = (
        decided[name].reshape(count, legs) for name in ("kind", "constraint", "time")
    )
    worst, row = kinds.argmax(axis=1), np.arange(count)  # of a solution's free motions
    starts = solved.phase if solved.phase.size else np.zeros((count, 1))
    phase = starts[row, worst] + times[row, worst] * (cells.Omega[solved.index])
    return kinds[row, worst], which[row, worst], np.mod(phase / (2.0 * np.pi * problem.periods), 1)


def _legs(
    problem: Problem,
    driven: Driven,
    cells: Cells,
    solved: Solutions,
    impacts: tuple[Impact, ...],
) -> FreeMotions:
    """Return the free motions of solutions as their check takes them, one after the other."""
    count, legs = solved.length.shape
    pairs, constraints = solved.state.shape[-1], driven.level.size
    Y = np.einsum("csj,fhsj->fch", driven.position, cells.steady)
    Y_error = cells.seen_error(driven, driven.position, driven.doubts[0], 2.0 * driven.shape_error)
    starts = solved.phase if impacts else np.zeros((count, 1))
    turned = np.exp(1j * starts[..., np.newaxis] * driven.harmonics)
    amplitude = Y[solved.index, np.newaxis] * turned[:, :, np.newaxis]
    inexact = solved.whole_error + 2.0 * driven.shape_error
    error = np.einsum(
        "csj,mfsj,mj->mfc", np.abs(driven.position), driven.pairs.size(solved.state), inexact
    )
    error += solved.seen_error(driven.position, driven.doubts[0])
    error += Y_error.sum(axis=1)[solved.index, np.newaxis]
    late = solved.phase_error.max(axis=1, initial=0.0)[:, np.newaxis, np.newaxis]
    error += late * (np.abs(amplitude) * driven.harmonics).sum(axis=-1)
    error += 8.0 * EPS * (np.abs(driven.level) + np.abs(amplitude).sum(axis=-1))
    first = np.array([impact.constraint for impact in impacts] or [-1])
    side = np.array([UPPER if impact.side > 0 else LOWER for impact in impacts] or [UPPER])
    last, last_side = np.roll(first, -1), np.roll(side, -1)
    if problem.symmetric:
        last_side = 1 - last_side
    shape = count * legs, constraints, driven.harmonics.size
    rates = np.repeat(cells.Omega[solved.index, np.newaxis] * driven.harmonics, legs, axis=0)
    return FreeMotions(
        np.ascontiguousarray(solved.state.reshape(-1, 2, pairs)),
        np.ascontiguousarray(solved.length.ravel()),
        np.ascontiguousarray(rates),
        np.ascontiguousarray(amplitude.real.reshape(shape)),
        np.ascontiguousarray(amplitude.imag.reshape(shape)),
        np.tile(first, count),
        np.tile(last, count),
        np.tile(side, count),
        np.tile(last_side, count),
        np.ascontiguousarray(error.reshape(-1, constraints)),
    )
