"""Choice of the methods for motions with stops of finite stiffness."""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import StrEnum
from typing import Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.plan import Stage, Step

_BOX: Final = 0.6  # radians of what turns fastest in half a box, about
_FEW: Final = 60.0  # boxes at least
_MOST: Final = 20_000.0
_ROOTS: Final = 2.0  # solutions at a frequency with contact, about
_SOLUTION, _CONTACT, _EXTREMES, _MULTIPLIER = 160.0, 170.0, 48.0, 32.0  # bytes


class Method(StrEnum):
    """How the durations of contact phases are found."""

    ISOLATION = "isolation of durations"


def steps(problem: Problem) -> Iterator[Step]:
    """Yield the steps of a problem with stops of finite stiffness."""
    system, count = problem.system, float(problem.Omega.size)
    method = spectrum.choose(system)
    size = spectrum.nbytes(system, method)
    if size > spectrum.MEMORY:
        message = f"the natural modes of the structure take more than {size / 1e9:.0f} GB"
        raise PlanError(message, ("system",))
    yield spectrum.step(system, method)
    n = 2.0 * float(system.n)
    turns = _turns(problem)
    boxes = min(_MOST, _FEW + turns / _BOX) * count
    flops = 6.0 * n**3 + boxes * (1e5 + 4.0 * n**3)
    rows = (2.0 + _ROOTS) * count
    contacts = (1.0 + _ROOTS) * count
    cell = "half of the period" if problem.symmetric else "the period"
    reason = f"one contact in {cell}: all durations are roots of one equation, isolated with bounds"
    written = _SOLUTION * rows + _CONTACT * contacts
    yield Step(Stage.IMPULSE, Method.ISOLATION, reason, flops, written, bounded=False)
    outputs = problem.outputs
    if "exists" in outputs:
        reason = "bounds along both phases: no other switching of a stop is missed"
        flops = rows * 100.0 * n * (20.0 + turns)
        yield Step(Stage.EXISTENCE, "safe steps", reason, flops, 26.0 * rows, bounded=False)
    dofs = float(problem.output_dofs.size)
    if {"extremes", "energy"} & outputs:
        reason = "quadrature over both phases, exact to rounding"
        nodes = 100.0 + 6.0 * turns
        wide = dofs * ("extremes" in outputs) + float(system.n) * ("energy" in outputs)
        flops = rows * nodes * (1e3 + 8.0 * wide * n)
        size = rows * (_EXTREMES * dofs + 48.0)
        yield Step(Stage.ENERGY, "quadrature", reason, flops, size, bounded=False)
    if "waveform" in outputs:
        assert problem.tau is not None
        flops = rows * problem.tau.size * n * (30.0 + 2.0 * dofs)
        size = 8.0 * rows * (problem.tau.size + 1.0) * dofs
        yield Step(Stage.WAVEFORM, "superposition", "as requested", flops, size, bounded=False)
    if {"stability", "multipliers"} & outputs:
        reason = "eigenvalues of the product of both flows and of the jump of the force"
        size = rows * (24.0 + _MULTIPLIER * n * ("multipliers" in outputs))
        flops = _ROOTS * count * 30.0 * n**3
        yield Step(Stage.STABILITY, "monodromy", reason, flops, size, bounded=False)


def _turns(problem: Problem) -> float:
    """Return by how many radians what turns fastest turns in a period, the mean one.

    That is the fastest mode that damping leaves for a while, or the structure at the stop.
    """
    period = 2.0 * math.pi * problem.periods / problem.Omega
    fastest = spectrum.largest_frequency(problem.system)
    law = problem.system.constraints[problem.impacts[0].constraint].law
    assert isinstance(law, Linear)
    stiff = spectrum.largest_frequency(problem.system) if law.stiffness else 0.0
    return float(np.mean(period * max(fastest, stiff)))
