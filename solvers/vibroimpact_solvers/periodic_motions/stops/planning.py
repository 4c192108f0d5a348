"""Choice of the methods for motions with stops of finite stiffness."""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import StrEnum
from typing import Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.condensation import solve_mass
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.stops.search import WORK
from vibroimpact_solvers.periodic_motions.stops.sequences import (
    HISTORIES,
    OBSERVED,
    SETTLED,
    STARTS,
)
from vibroimpact_solvers.plan import Stage, Step

_BOX: Final = 0.6  # radians of what turns fastest in half a box, about
_FEW: Final = 60.0  # boxes at least
_CUBES: Final = 7e3  # see `isolation`
_SHORT: Final = 600.0  # boxes, about, where not all are examined
_STEPS: Final = 12.0  # of Newton's method from motions of a reduced structure
_NODES: Final = 2.0**16  # nodes times modes at most, see `along`
_ROW: Final = 1e6  # operations of a solution, whatever the structure is
_TURNS: Final = 1e4  # of what turns fastest, more of which do not count
_FOUND: Final = 2.0  # solutions that a search finds, about
_ITERATIONS: Final = 25.0  # of Newton's method from a start, about
_EVALUATION: Final = 9e5  # operations for each contact, whatever the structure is
_REPEATED: Final = 6.0  # starts that solutions before and time histories give, about
_SWITCHING: Final = 5e4  # operations of a contact in a time history
_ROOTS: Final = 2.0  # solutions at a frequency with contact, about
_SOLUTION, _CONTACT, _EXTREMES, _MULTIPLIER = 160.0, 170.0, 48.0, 32.0  # bytes


class Method(StrEnum):
    """How the contact phases are found."""

    ISOLATION = "isolation of durations"
    SEARCH = "newton in switchings"


def steps(problem: Problem) -> Iterator[Step]:
    """Yield the steps of a problem with stops of finite stiffness."""
    system, count = problem.system, float(problem.Omega.size)
    method = spectrum.choose(system)
    size = spectrum.nbytes(system, method)
    if size > spectrum.MEMORY:
        message = f"the natural modes of the structure take more than {size / 1e9:.0f} GB"
        raise PlanError(message, ("system",))
    yield spectrum.step(system, method)
    turns = _turns(problem)
    contacts, rows = float(len(problem.impacts)), (2.0 + _ROOTS) * count
    if problem.searched:
        rows = (1.0 + _FOUND) * count
        yield _search(problem, rows)
    else:
        yield _isolation(problem, turns)
    yield from _along(problem, rows, contacts, turns)


def _search(problem: Problem, rows: float) -> Step:
    """Return the step that looks for sequences of contacts."""
    m, n = float(len(problem.impacts)), 2.0 * problem.system.n
    count, periods = float(problem.Omega.size), float(SETTLED + OBSERVED + problem.periods)
    each = _ITERATIONS * m * (_EVALUATION + 20.0 * n**3)
    started = STARTS if problem.phases is None else len(problem.phases)
    followed = HISTORIES * periods * m * (_SWITCHING + 20.0 * n**2)
    flops = count * ((started + _REPEATED) * each + followed)
    what = "one contact" if m == 1.0 else f"{len(problem.impacts)} contacts"
    why = ", under a load of several harmonics," if m == 1.0 else ""
    reason = (
        f"{what} per period{why}: the times of all switchings by Newton's method, from random "
        f"phases and from {HISTORIES} time histories of {periods:.0f} periods of the drive, which "
        f"may miss a motion{_relative(problem)}"
    )
    written = _SOLUTION * rows + _CONTACT * m * rows
    return Step(Stage.IMPULSE, Method.SEARCH, reason, flops, written, bounded=False)


def _relative(problem: Problem) -> str:
    """Return what a reason says of walls that move."""
    return "; relative to the walls, which move with the drive" if problem.moving else ""


def _isolation(problem: Problem, turns: float) -> Step:
    """Return the step that finds all durations of one contact."""
    system, count = problem.system, float(problem.Omega.size)
    modes = float(system.n)
    n = 2.0 * modes
    boxes = (_FEW + turns / _BOX) * (1.0 + modes**3 / _CUBES)
    starts = 2.0 if system.constraints[problem.impacts[0].constraint].law.lossy else 1.0
    whole = boxes <= WORK
    each = boxes if whole else _SHORT + _STEPS * modes**3 / _CUBES
    flops = 6.0 * n**3 + 1e5 * starts * each * count
    rows = (2.0 + _ROOTS) * count
    contacts = (1.0 + _ROOTS) * count
    cell = "half of the period" if problem.symmetric else "the period"
    reason = f"one contact in {cell}: all durations are roots of one equation, isolated with bounds"
    if not whole:
        reason += "; fast modes make that long, so that some may be missed"
    reason += _relative(problem)
    written = _SOLUTION * rows + _CONTACT * contacts
    return Step(Stage.IMPULSE, Method.ISOLATION, reason, flops, written, bounded=False)


def _along(problem: Problem, rows: float, parts: float, turns: float) -> Iterator[Step]:
    """Yield the steps of what is computed along solutions, of so many contacts each."""
    system, outputs, count = problem.system, problem.outputs, float(problem.Omega.size)
    n = 2.0 * system.n
    if "exists" in outputs:
        reason = "bounds along all phases: no other switching of a stop is missed"
        flops = rows * parts * n * (_ROW + 100.0 * (20.0 + min(turns, _TURNS)))
        name = "safe steps of all phases"
        yield Step(Stage.EXISTENCE, name, reason, flops, 26.0 * rows, bounded=False)
    dofs = float(problem.output_dofs.size)
    if {"extremes", "energy"} & outputs:
        reason = "quadrature over all phases, exact to rounding"
        nodes = min(100.0 * parts + 6.0 * turns, (500.0 + _NODES / system.n) * parts)
        wide = dofs * ("extremes" in outputs) + float(system.n) * ("energy" in outputs)
        flops = rows * (_ROW * parts + nodes * (1e3 + 8.0 * wide * n))
        size = rows * (_EXTREMES * dofs + 48.0)
        yield Step(Stage.ENERGY, "quadrature of all phases", reason, flops, size, bounded=False)
    if "waveform" in outputs:
        assert problem.tau is not None
        flops = rows * problem.tau.size * n * (30.0 + 2.0 * dofs)
        size = 8.0 * rows * (problem.tau.size + 1.0) * dofs
        yield Step(Stage.WAVEFORM, "superposition", "as requested", flops, size, bounded=False)
    if {"stability", "multipliers"} & outputs:
        reason = "eigenvalues of the product of all flows and of the jumps of forces"
        size = rows * (24.0 + _MULTIPLIER * n * ("multipliers" in outputs))
        flops = _ROOTS * count * parts * (_ROW + 30.0 * n**3)
        yield Step(Stage.STABILITY, "monodromy", reason, flops, size, bounded=False)


def _turns(problem: Problem) -> float:
    """Return by how many radians what turns fastest turns in a period, the mean one.

    That is the fastest mode, or the mass at the stop.
    """
    system, periods = problem.system, 2.0 * math.pi * problem.periods / problem.Omega
    constraint = system.constraints[problem.impacts[0].constraint]
    assert isinstance(constraint.law, Linear)
    row = np.zeros(system.n)
    row[[*constraint.dofs]] = constraint.weights
    mobility = float(row @ solve_mass(system)(row))
    at_stop = math.sqrt(constraint.law.stiffness * max(mobility, 0.0))
    return float(np.mean(periods * max(spectrum.largest_frequency(system), at_stop)))
