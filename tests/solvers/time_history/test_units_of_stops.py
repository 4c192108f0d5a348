"""Motions with linear stops in other units: the same motion, as accurate."""

from __future__ import annotations

import numpy as np
import pytest

from vibroimpact_solvers import time_history
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

OUTPUTS = frozenset({"x", "v", "force", "contacts"})


def motion(length: float, mass: float, time: float, coupled: bool) -> time_history.Result:
    """Return a motion in units that are so many times smaller than those of the numbers here."""
    stiffness, damping = mass / time**2, mass / time
    K = np.array([[2.0, -1.0], [-1.0, 3.0]])
    C = np.array([[0.1, 0.04], [0.04, 0.02]]) if coupled else 0.01 * K
    stops = (
        Constraint((0,), (1.0,), 0.1 * length, 0.15 * length, law=Linear(90.0 * stiffness)),
        Constraint((1,), (1.0,), None, 0.1 * length, law=Linear(40.0 * stiffness, 0.7 * damping)),
    )
    system = System(
        SymmetricMatrix.dense(mass * np.diag([1.0, 1.5])), SymmetricMatrix.dense(stiffness * K),
        stops, C=SymmetricMatrix.dense(damping * C),
        force=np.array([0.3, 0.1]) * (length * stiffness),
    )  # fmt: skip
    state = time_history.State(np.zeros(2), np.array([1.0, -0.4]) * (length / time))
    load = time_history.Harmonic(1, 0.6 * length * stiffness, 1.3 / time)
    problem = time_history.Problem(
        system, state, 10.0 * time, t=np.linspace(0.0, 10.0, 11) * time, outputs=OUTPUTS,
        load=(load,),
    )  # fmt: skip
    return time_history.solve(problem, time_history.plan(problem))


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize(
    ("length", "mass", "time"),
    [(2.0**20, 1.0, 1.0), (2.0**-30, 1.0, 1.0), (1.0, 2.0**30, 1.0), (2.0**30, 2.0**40, 2.0**9)],
)
def test_other_units(length: float, mass: float, time: float, coupled: bool) -> None:
    """Numbers in other units are the same numbers: what converts states loses none of them."""
    one, other = motion(1.0, 1.0, 1.0, coupled), motion(length, mass, time, coupled)
    force = mass * length / time**2
    units = {
        "x": length, "v": length / time, "force": force, "contact_start": time,
        "contact_stop": time, "contact_impulse": force * time, "contact_peak_force": force,
        "contact_indentation": length, "contact_energy_lost": force * length,
    }  # fmt: skip
    assert one.contact_start is not None
    assert one.contact_start.size > 10
    for name, unit in units.items():
        first, second = getattr(one, name), getattr(other, name) / unit
        error, stated = getattr(one, f"error_{name}"), getattr(other, f"error_{name}") / unit
        assert first.shape == second.shape, name
        assert (np.abs(first - second) <= error + stated).all(), name
        assert np.max(stated) <= 4.0 * np.max(error) <= 1e-9, name
