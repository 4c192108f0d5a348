"""Motions with one impact per cell: in closed form, whether or not it balances a constant load."""

from __future__ import annotations

from vibroimpact_solvers.arrays import Booleans
from vibroimpact_solvers.periodic_motions import closed_form, falling
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions


def solutions(driven: Driven, cells: Cells, problem: Problem) -> tuple[Solutions, Booleans]:
    """Return all solutions with one impact per cell, shape (solution, 1) each.

    Also whether none can be missing at a frequency, shape (frequency,).
    """
    (impact,) = problem.impacts
    if cells.sign > 0.0 and driven.balance.loaded:
        return falling.solutions(driven, cells, impact)
    return closed_form.solutions(driven, cells, impact)
