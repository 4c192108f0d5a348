"""Structures by few of their modes, with and without the flexibility of all others, at a stop.

The tables of the documents are computed here: durations of the contact of a driven cantilever and
of a driven plate.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg

from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers import presets
from vibroimpact_solvers.flexibility import in_series
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

FEW = (3, 5, 8, 12, 20)
Modes = tuple[Any, Any]
"""Squares of natural frequencies, ascending, and participations of the stop that is driven."""


def cantilever() -> Modes:
    """Return the modes of a cantilever of 20 elements, at its tip."""
    beam = presets.beam(constraints=(), elements=20)
    squares, shapes = scipy.linalg.eigh(beam.K.to_dense(), beam.M.to_dense())
    return squares, shapes[38]


def plate() -> Modes:
    """Return the 60 lowest modes of a square plate on simple supports, off its middle."""
    m, n = np.meshgrid(np.arange(1, 13), np.arange(1, 13))
    squares = (np.pi**2 * (m**2 + n**2)).ravel() ** 2
    rows = 2.0 * (np.sin(0.4 * np.pi * m) * np.sin(0.45 * np.pi * n)).ravel()
    order = np.argsort(squares, kind="stable")[:60]
    return squares[order], rows[order]


def duration(modes: Modes, count: int, stiffness: float, *, residual: bool) -> float:
    """Return how long the contact of the stable motion with one contact lasts, in periods."""
    squares, rows = modes
    kept, row = np.sqrt(squares[:count]), rows[:count]
    static = float((rows**2 / squares).sum())
    stop = Constraint(
        tuple(range(count)), tuple(row.tolist()), None, 0.5 * static, law=Linear(stiffness)
    )
    system = System(
        SymmetricMatrix.diagonal(np.ones(count)), SymmetricMatrix.diagonal(squares[:count]),
        (stop,), C=SymmetricMatrix.diagonal(0.1 * kept),
    )  # fmt: skip
    if residual:
        system = in_series(system, [[float((rows[count:] ** 2 / squares[count:]).sum())]])
    load = (driven.Force(tuple(range(count)), tuple(row.tolist()), 1.0),)
    problem = driven.Problem(
        system, np.array([1.2 * kept[0]]), load, sequence=(driven.Impact(0, 1),),
        outputs=frozenset({"stability"}),
    )  # fmt: skip
    result = driven.solve(problem, driven.plan(problem))
    rows_ = np.flatnonzero(result.solution_exists & (result.solution_contacts == 1))
    (row_,) = rows_[result.solution_stability[rows_] < 1.0]
    (contact,) = np.flatnonzero(result.contact_solution == row_)
    return float(result.contact_duration[contact]) * 1.2 * float(kept[0]) / (2.0 * np.pi)


@pytest.mark.parametrize("modes", [cantilever(), plate()], ids=["cantilever", "plate"])
def test_five_modes_and_the_flexibility_of_the_others_do_what_twenty_do(modes: Modes) -> None:
    stiffness = 10.0 / float((modes[0][0] ** -1.0) * modes[1][0] ** 2)
    whole = duration(modes, modes[0].size, stiffness, residual=False)
    without = [abs(duration(modes, J, stiffness, residual=False) / whole - 1.0) for J in FEW]
    with_it = [abs(duration(modes, J, stiffness, residual=True) / whole - 1.0) for J in FEW]
    print(whole, without, with_it)
    assert with_it[1] < without[4]
    assert all(more < 0.3 * less for more, less in zip(with_it, without, strict=True))
