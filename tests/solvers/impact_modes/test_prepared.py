"""The second call with the same structure finds it prepared, and nothing outlives the structure."""

from __future__ import annotations

import gc
import weakref
from unittest import mock

import numpy as np

from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers.impact_modes import family_solver
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.presets import chain


def solved(system: System, omega: float, active: tuple[int, ...] = ()) -> modes.Result:
    outputs = frozenset({"impulse", "exists", "energy", "stability"})
    problem = modes.Problem(system, np.array([omega]), active, outputs)
    return modes.solve(problem, modes.plan(problem))


def test_the_second_call_prepares_nothing() -> None:
    system = chain(5, [Constraint.at(1, 0.2), Constraint.at(3, 0.3)])
    family, make = family_solver.ModalFamily, family_solver.ModalFamily.__init__
    with mock.patch.object(family, "__init__", autospec=True, side_effect=make) as made:
        for omega in (1.3, 1.4, 1.5):
            for active in ((0,), (1,), (0, 1)):
                solved(system, omega, active)
    assert made.call_count == 3


def test_what_is_prepared_has_the_numbers_of_a_new_structure() -> None:
    limiters = [Constraint.at(1, 0.2), Constraint.at(3, 0.3)]
    system = chain(5, limiters)
    for omega in (1.3, 1.4):
        for active in ((0,), (0, 1)):
            again, new = solved(system, omega, active), solved(chain(5, limiters), omega, active)
            for name in ("impulse", "energy", "energy_error", "stability"):
                np.testing.assert_array_equal(getattr(again, name), getattr(new, name))


def test_nothing_outlives_the_structure() -> None:
    system = chain(4, [Constraint.at(1, 0.2)])
    solved(system, 1.4)
    gone = weakref.ref(system)
    del system
    gc.collect()
    assert gone() is None
