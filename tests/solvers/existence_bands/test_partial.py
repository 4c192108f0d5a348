"""Bands of large sparse structures by few natural modes, against those by all modes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.solvers.impact_modes.test_partial import GAP, membrane
from vibroimpact_solvers import existence_bands, receptance, spectrum
from vibroimpact_solvers.existence_bands import Problem
from vibroimpact_solvers.existence_bands.search import poles_near_harmonics
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step


def problem(system: System) -> Problem:
    bound = spectrum.largest_frequency(system)
    return Problem(system, 0.302 * bound, 0.32 * bound)


@pytest.mark.parametrize("uneven", [True, False])
def test_the_poles_are_all_there(uneven: bool) -> None:
    case = problem(membrane(18, uneven=uneven))
    roots = spectrum.spectrum(case.system).roots
    every = (roots[:, np.newaxis] / np.arange(1.0, 9.0, 2.0)).ravel()
    inside = np.sort(every[(every >= case.start) & (every <= case.stop)])
    assert inside.size > 3
    np.testing.assert_allclose(
        np.sort(poles_near_harmonics(case, receptance.ExpansionSize.of(None))), inside, rtol=1e-12
    )


def test_bands_are_those_of_all_modes() -> None:
    system = membrane(18, (Constraint.at(100, GAP), Constraint.at(300, 20 * GAP)))
    case = Problem(*(system, *_range(system)), active=(0,))
    plan = existence_bands.plan(case)
    step = plan.step(Stage.SPECTRUM)
    assert step is not None
    assert step.method == receptance.METHOD
    result = existence_bands.solve(case, plan)
    full = _by_all_modes(plan)
    expected = existence_bands.solve(case, full)
    assert result.band_start is not None
    assert result.band_start.size > 2
    for name in ("band_start", "band_stop"):
        np.testing.assert_allclose(getattr(result, name), getattr(expected, name), rtol=1e-8)
    np.testing.assert_array_equal(result.band_start_reason, expected.band_start_reason)
    np.testing.assert_array_equal(result.rejected_reason, expected.rejected_reason)


def _range(system: System) -> tuple[float, float]:
    case = problem(system)
    return case.start, case.stop


def _by_all_modes(plan: Plan) -> Plan:
    steps = [
        Step(Stage.SPECTRUM, spectrum.Method.DENSE, "all modes")
        if step.stage is Stage.SPECTRUM
        else step
        for step in plan.steps
    ]
    return Plan(plan.kind, tuple(steps), (Skip("nothing", "for comparison"),))


def test_stability_needs_all_modes() -> None:
    case = problem(membrane(18))
    both = Problem(case.system, case.start, case.stop, outputs=frozenset({"stability"}))
    step = existence_bands.plan(both).step(Stage.SPECTRUM)
    assert step is not None
    assert step.method != receptance.METHOD
