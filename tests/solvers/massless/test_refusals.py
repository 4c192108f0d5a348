"""What structures with degrees of freedom without mass do not take, each with its field."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from vibroimpact_solvers import ensemble, presets, slow_flow, time_history
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.time_history import Harmonic, Sampled, State

MASSES = SymmetricMatrix.diagonal([1.0, 0.0, 1.0])
STIFFNESS = [[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]]
K = SymmetricMatrix.dense(STIFFNESS)
STOP = (Constraint.at(0, 1.0),)
SYSTEM = System(MASSES, K, STOP)


def dense(*rows: list[float]) -> SymmetricMatrix:
    return SymmetricMatrix.dense(list(rows))


@pytest.mark.parametrize(
    ("fields", "pointer", "code", "words"),
    [
        ({"constraints": (Constraint.at(1, 1.0),)}, ("constraints", 0), "massless_constraint",
         "give the stop a mass"),
        ({"constraints": (*STOP, Constraint((0, 1), (1.0, -1.0), 1.0, 1.0))},
         ("constraints", 1), "massless_constraint", "dof 1 has no mass"),
        ({"force": np.array([0.0, 1.0, 0.0])}, ("force",), "massless_load", "dof 1"),
        ({"C": SymmetricMatrix.diagonal([0.1, 0.1, 0.0])}, ("C",), "massless_damping", r"\(1\)"),
        ({"C": dense([1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 0.0])}, ("C",),
         "massless_damping", "damping"),
        ({"K": dense([2.0, 0.0, -1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 2.0])}, ("K",),
         "massless_not_held", "not held by springs"),
        ({"K": dense([2.0, 1.0, 0.0], [1.0, -2.0, 1.0], [0.0, 1.0, 2.0])}, ("K",),
         "massless_not_held", "not positive definite"),
        ({"M": dense([1.0, 0.1, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 1.0])}, ("M",),
         "not_positive_definite", "coupled to others by mass"),
        ({"M": dense([1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0])}, ("M",),
         "not_positive_definite", "not positive definite"),
        ({"M": dense([1.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 1.0])}, ("M",),
         "not_positive_definite", "without its rows that are zero"),
        ({"M": SymmetricMatrix.diagonal([1.0, 0.0, -1.0])}, ("M",), "not_positive_definite",
         "not positive definite"),
        ({"M": SymmetricMatrix.diagonal([0.0, 0.0, 0.0])}, ("M",), "not_positive_definite",
         "no degree of freedom has mass"),
    ],
)  # fmt: skip
def test_structures_are_refused_with_their_field(
    fields: dict[str, Any], pointer: tuple[Any, ...], code: str, words: str
) -> None:
    given: dict[str, Any] = {"M": MASSES, "K": K, "constraints": STOP} | fields
    with pytest.raises(ModelError, match=words) as caught:
        System(**given)
    assert (caught.value.pointer, caught.value.code) == (pointer, code)


def test_a_weight_of_zero_does_not_act() -> None:
    System(MASSES, K, (Constraint((0, 1), (1.0, 0.0), 1.0, 1.0),))


def test_other_limiters_are_checked_too() -> None:
    with pytest.raises(ModelError, match="dof 1 has no mass"):
        SYSTEM.limited([Constraint.at(1, 1.0)])


@pytest.mark.parametrize("name", ["x", "v"])
def test_states_that_contradict_the_static_relation_are_refused(name: str) -> None:
    given = {"x": np.array([0.2, 0.0, 0.4]), "v": np.array([0.2, 0.0, 0.4])}
    time_history.Problem(SYSTEM, State(**given), 1.0)
    given[name] = np.array([0.2, 0.3, 0.4])
    time_history.Problem(SYSTEM, State(**given), 1.0)
    given[name] = np.array([0.2, 0.300001, 0.4])
    with pytest.raises(
        ModelError, match=r"it is at 0\.3\d*, not at 0\.300001; .* or zero"
    ) as caught:
        time_history.Problem(SYSTEM, State(**given), 1.0)
    assert caught.value.pointer == ("initial", name)
    several = {part: np.array([np.zeros(3), values]) for part, values in given.items()}
    with pytest.raises(ModelError, match="dof 1 has no mass") as caught:
        ensemble.Problem(SYSTEM, **several, t_end=1.0)
    assert caught.value.pointer == ("initial", name)


def test_loads_are_refused_with_their_field() -> None:
    start = State(np.zeros(3), np.ones(3) * [1.0, 0.0, 1.0])
    sampled = Sampled(np.array([0.0, 1.0, 0.0]), np.array([0.0, 2.0]), np.array([0.0, 1.0]))
    for term, field in ((Harmonic(1, 1.0, 2.0), "dof"), (sampled, "direction")):
        with pytest.raises(ModelError, match="a load acts on dof 1, without mass") as caught:
            time_history.Problem(SYSTEM, start, 1.0, load=(term,))
        assert caught.value.pointer == ("load", 0, field)
    with pytest.raises(ModelError, match="a load acts on dof 1, without mass") as caught:
        driven.Problem(SYSTEM, np.array([1.0]), (driven.Force((0, 1), (1.0, 1.0), 0.5),))
    assert caught.value.pointer == ("load", 0, "dof")


def test_slow_flows_are_refused() -> None:
    whole = presets.two_mass([Constraint.at(0, 1.0)], 1.0)
    system = System(SymmetricMatrix.diagonal([1.0, 0.0]), whole.K, whole.constraints)
    initial = slow_flow.Initial()
    with pytest.raises(ModelError, match="every degree of freedom has mass") as caught:
        slow_flow.Problem(system, "two_oscillator", "exact", initial, np.array([0.0]))
    assert caught.value.pointer == ("system", "M")
