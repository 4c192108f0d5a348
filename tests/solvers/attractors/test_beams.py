"""Attractors of beams, which rest at their stops and are not observed for longer than matters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.solvers.beams import GAP, OMEGA, cantilever
from vibroimpact_solvers import attractors
from vibroimpact_solvers.attractors import Force, observed
from vibroimpact_solvers.model import Constraint

OBSERVED = 360


def _settled() -> attractors.Result:
    beam = cantilever(8)
    tip = beam.n - 2
    system = replace(beam, constraints=(Constraint((tip,), (1.0,), None, GAP, 0.3),))
    still = np.zeros((1, beam.n))
    load = (Force((tip,), (1.0,), 3.0),)
    problem = attractors.Problem(
        system, np.array([1.1 * OMEGA]), still, still, load, settle=40, observe=OBSERVED, longest=4
    )
    return attractors.solve(problem, attractors.plan(problem))


def test_a_motion_that_rests_and_returns_is_what_it_is_when_observed_to_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    short = _settled()
    monkeypatch.setattr(observed, "_returns", lambda problem, result: False)
    whole = _settled()
    periods = [round(1.0 / each.error_impact_rate[0]) for each in (short, whole)]
    assert periods[0] < 0.75 * periods[1]
    assert periods[1] == OBSERVED
    for name in ("nature", "period", "rests"):
        (one,), (other,) = (getattr(each, f"attractor_{name}") for each in (short, whole))
        assert one == other
    assert short.attractor_rests[0]
    for name in ("x", "v"):
        one, other = (getattr(each, f"attractor_{name}") for each in (short, whole))
        error = sum(getattr(each, f"error_{name}") for each in (short, whole))
        assert (np.abs(one - other) <= error).all()
    apart = abs(short.attractor_impact_rate[0] - whole.attractor_impact_rate[0])
    assert apart <= short.error_impact_rate[0] + whole.error_impact_rate[0]
    assert short.impact_phase.size == whole.impact_phase.size
    assert short.impact_phase == pytest.approx(whole.impact_phase, abs=1e-8)
