"""Branches of a structure whose natural frequencies differ by a factor of a hundred thousand."""

from __future__ import annotations

import numpy as np
import pytest

from tests.solvers.beams import OMEGA, cantilever
from vibroimpact_solvers import branches, periodic_motions
from vibroimpact_solvers.branches.impacts import Impacts
from vibroimpact_solvers.periodic_motions import Force, Problem

OUTPUTS = frozenset({"exists", "stability"})


def _problem() -> branches.Problem:
    system = cantilever(8)
    load = (Force((system.n - 2,), (1.0,), 3.0),)

    def at(Omega: float) -> Problem:
        return Problem(system, np.array([Omega]), load, outputs=OUTPUTS)

    return branches.Problem(at, 0.7 * OMEGA, 1.3 * OMEGA, system, frequency=True)


def test_a_branch_passes_through_the_motions_of_the_closed_form(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Newton's method reaches each of them in a few steps: its matrix is as good as exact."""
    evaluations, evaluate = list[int](), Impacts._equations_at

    def counted(curve: Impacts, point: bytes) -> object:
        evaluations.append(1)
        return evaluate(curve, point)

    monkeypatch.setattr(Impacts, "_equations_at", counted)
    problem = _problem()
    result = branches.solve(problem, branches.plan(problem))
    struck = np.flatnonzero(result.solution_impacts)
    assert struck.size > 100
    assert len(evaluations) < 7 * struck.size
    for row in struck[::20].tolist():
        (impact,) = np.flatnonzero(result.impact_solution == row)
        one = problem.at(float(result.solution_parameter[row]))
        known = periodic_motions.solve(one, periodic_motions.plan(one))
        late = np.angle(np.exp(1j * (known.impact_phase - result.impact_phase[impact])))
        place = int(np.abs(late).argmin())
        assert abs(late[place]) <= known.error_phase[place] + result.error_phase[impact]
        apart = abs(known.impact_momentum[place] - result.impact_momentum[impact])
        assert apart <= known.error_momentum[place] + result.error_momentum[impact]
