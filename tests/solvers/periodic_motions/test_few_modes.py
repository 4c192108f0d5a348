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
        outputs=frozenset({"exists", "stability"}),
    )  # fmt: skip
    result: Any = driven.solve(problem, driven.plan(problem))
    rows_ = np.flatnonzero(result.solution_exists & (result.solution_contacts == 1))
    (row_,) = rows_[result.solution_stability[rows_] < 1.0]
    (contact,) = np.flatnonzero(result.contact_solution == row_)
    return float(result.contact_duration[contact]) * 1.2 * float(kept[0]) / (2.0 * np.pi)


CANTILEVER = {
    3: (0.222420, 0.223195),
    5: (0.223017, 0.223190),
    8: (0.223146, 0.223188),
    12: (0.223176, 0.223188),
    20: (0.223185, 0.223188),
    40: (0.223187, 0.223187),
}
PLATE = {
    5: (0.299808, 0.326419),
    8: (0.275994, 0.309055),
    12: (0.300937, 0.313459),
    20: (0.308626, 0.314593),
    60: (0.314633, 0.314633),
}
"""Modes -> durations in periods, without and with the flexibility of the others, in docs.

The last rows are the whole structures."""


@pytest.mark.parametrize(
    ("modes", "table", "gain"), [(cantilever(), CANTILEVER, 30.0), (plate(), PLATE, 100.0)]
)
def test_the_flexibility_of_the_others_stands_for_them(
    modes: Modes, table: dict[int, tuple[float, float]], gain: float
) -> None:
    """Twenty modes are nearer to the whole structure by a factor with it, for the plate by 100."""
    squares, rows = modes
    stiffness = 10.0 * float(squares[0] / rows[0] ** 2)
    computed = {
        count: tuple(duration(modes, count, stiffness, residual=each) for each in (False, True))
        for count in table
    }
    for count, stated in table.items():
        assert np.abs(np.subtract(computed[count], stated)).max() < 6e-7
    whole = computed[squares.size][0]
    without, with_it = (abs(value - whole) for value in computed[20])
    assert with_it * gain < without
    assert all(abs(b - whole) < abs(a - whole) for a, b in list(computed.values())[:-1])
