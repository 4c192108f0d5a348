"""The momentum exchanged per impact, 2 p/omega, is what integrated motions lose at their walls."""

from __future__ import annotations

import numpy as np
import pytest

from vibroimpact_solvers import impact_modes, presets, slow_flow, time_history
from vibroimpact_solvers.model import Constraint


@pytest.mark.parametrize("upper", [0.2, 0.3])
def test_of_impact_modes(upper: float) -> None:
    """With equal and with unequal gaps; the time history sums the jumps of the velocity."""
    system = presets.chain(13, [Constraint((5,), (1.0,), 0.2, upper)])
    omega = np.array([1.4])
    problem = impact_modes.Problem(system, omega)
    modes = impact_modes.solve(problem, impact_modes.plan(problem))
    assert modes.exists is not None
    assert modes.exists[0]
    assert modes.momentum is not None
    start = time_history.ImpactMode(float(modes.Omega[0]), ())
    motion = time_history.Problem(
        system, start, float(4.0 / omega[0]), outputs=frozenset({"impacts"})
    )
    result = time_history.solve(motion, time_history.plan(motion))
    above, below = result.impact_side > 0, result.impact_side < 0
    np.testing.assert_allclose(result.impact_impulse[above], modes.momentum[0, 0], rtol=1e-9)
    lower = modes.momentum if modes.momentum_lower is None else modes.momentum_lower
    assert (modes.momentum_lower is None) == (upper == 0.2)
    np.testing.assert_allclose(result.impact_impulse[below], lower[0, 0], rtol=1e-9)


def test_of_slow_flows() -> None:
    system = presets.oscillator([Constraint.at(0, 1.0)], 1.3)
    problem = slow_flow.Problem(
        system,
        "oscillator",
        "family",
        slow_flow.Initial(energy=2.0),
        np.linspace(0.0, 9.0, 10),
        frozenset({"impulse", "error"}),
    )
    result = slow_flow.solve(problem, slow_flow.plan(problem))
    assert result.momentum is not None
    assert result.impact_velocity is not None
    np.testing.assert_allclose(result.momentum, 2.0 * result.impact_velocity[0], rtol=1e-12)
