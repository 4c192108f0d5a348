"""Where motions settle that carry degrees of freedom without mass along."""

from __future__ import annotations

import numpy as np
import pytest

from vibroimpact_solvers import attractors
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.periodic_motions import Force

K = np.array([[2.0, -1.0, 0.0], [-1.0, 3.0, -1.0], [0.0, -1.0, 2.0]])
MASSES, DAMPERS = np.array([1.0, 0.0, 1.5]), np.array([0.2, 0.0, 0.1])
MASSIVE = [0, 2]


def problem(K: Floats, dofs: list[int], x: Floats, v: Floats) -> attractors.Problem:
    system = System(
        SymmetricMatrix.diagonal(MASSES[dofs]),
        SymmetricMatrix.dense(K),
        (Constraint.at(0, gap=0.3, restitution=0.7),),
        C=SymmetricMatrix.diagonal(DAMPERS[dofs]),
    )
    load = (Force((0,), (1.0,), 1.0, 1, 0.0),)
    return attractors.Problem(system, np.array([1.7]), x[:, dofs], v[:, dofs], load)


def states() -> tuple[Floats, Floats]:
    rng = np.random.default_rng(0)
    x, v = 0.2 * rng.standard_normal((8, 3)), rng.standard_normal((8, 3))
    x[:, 1] = v[:, 1] = 0.0
    return x, v


@pytest.mark.needs("compiled kernels")
def test_attractors_are_those_of_the_structure_condensed_by_hand() -> None:
    x, v = states()
    whole = problem(K, [0, 1, 2], x, v)
    condensed = K[np.ix_(MASSIVE, MASSIVE)] - np.outer(K[MASSIVE, 1], K[1, MASSIVE]) / K[1, 1]
    few = problem(condensed, MASSIVE, x, v)
    result, expected = (attractors.solve(each, attractors.plan(each)) for each in (whole, few))
    np.testing.assert_array_equal(result.settled_attractor, expected.settled_attractor)
    np.testing.assert_array_equal(result.attractor_period, [1, 1])
    np.testing.assert_allclose(result.attractor_stability, expected.attractor_stability, rtol=1e-10)
    for name in ("attractor_x", "attractor_v"):
        rows = getattr(result, name)
        np.testing.assert_allclose(rows[:, MASSIVE], getattr(expected, name), atol=1e-10)
        np.testing.assert_allclose(rows[:, 1], (rows[:, 0] + rows[:, 2]) / 3.0, atol=1e-14)


@pytest.mark.parametrize("name", ["x", "v"])
def test_states_that_contradict_the_static_relation_are_refused(name: str) -> None:
    given = dict(zip("xv", states(), strict=True))
    given[name][3, 1] = 5.0
    with pytest.raises(ModelError, match="follows the others") as caught:
        problem(K, [0, 1, 2], **given)
    assert (caught.value.pointer, caught.value.code) == (("initial", name), "massless_state")
