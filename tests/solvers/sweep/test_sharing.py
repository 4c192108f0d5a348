"""A stage is computed once for all points that do not invalidate it: counted."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

from vibroimpact_solvers import impact_modes, spectrum, sweep
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.impact_modes import modal
from vibroimpact_solvers.kernels import families, response
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.spectrum import methods

MOVED = ("Omega", "omega")


class Grid:
    """Three masses between stops: stiffness, frequency and gap vary."""

    def __init__(
        self,
        constraints: int,
        outputs: frozenset[str],
        places: tuple[int, int, int] = (50, 400, 10),
    ) -> None:
        self.constraints, self.outputs = constraints, outputs
        gaps, frequencies, stiffnesses = places
        self.gaps = np.linspace(0.1, 0.5, gaps)
        self.frequencies = np.linspace(1.1, 4.0, frequencies)
        self.stiffnesses = np.linspace(1.0, 2.0, stiffnesses)
        self.structures = [self._structure(k) for k in self.stiffnesses]

    def _structure(self, k: float) -> System:
        K = SymmetricMatrix.dense([[k + 1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0 + k]])
        return System(SymmetricMatrix.diagonal([1.0, 1.5, 2.0]), K, self._limiters(0.2))

    def _limiters(self, gap: float) -> tuple[Constraint, ...]:
        return tuple(Constraint.at(dof, gap) for dof in range(self.constraints))

    def axes(self) -> tuple[sweep.Axis, ...]:
        return (
            sweep.Axis("gap", "gap", self.gaps, stage=Stage.IMPULSE),
            sweep.Axis("w", "w", self.frequencies, stage=Stage.RESPONSE, changes=MOVED),
            sweep.Axis("K", "K", self.stiffnesses, stage=Stage.SPECTRUM),
        )

    def system(self, gap: int, k: int) -> System:
        return self.structures[k].limited(self._limiters(float(self.gaps[gap])))

    def at(self, index: tuple[int, ...]) -> impact_modes.Problem:
        gap, w, k = index
        return self._point(self.system(gap, k), self.frequencies[w : w + 1])

    def _point(self, system: System, Omega: Floats) -> impact_modes.Problem:
        omega = Omega * 2.0 / np.pi
        return impact_modes.Problem(system, omega, outputs=self.outputs, Omega=Omega)

    def problem(self) -> sweep.Problem:
        return sweep.Problem("impact-modes", self.axes(), self.at, self.structures[0])

    def problem_with_grid(self) -> sweep.Problem:
        """The same points, the frequencies as the grid of the base instead of an axis."""

        def at(index: tuple[int, ...]) -> impact_modes.Problem:
            gap, k = index
            return self._point(self.system(gap, k), self.frequencies)

        gaps, _, stiffnesses = self.axes()
        return sweep.Problem("impact-modes", (gaps, stiffnesses), at, self.structures[0])


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count spectra, and frequencies at which responses are summed."""
    counts: Counter[str] = Counter()

    def spectra(system: System, method: Any) -> spectrum.Spectrum:
        counts["spectrum"] += 1
        return compute(system, method)

    def bordered(*args: Any) -> None:
        counts["bordered"] += args[2].size
        solutions(*args)

    def scalar(*args: Any) -> Any:
        counts["scalar"] += args[3].size
        return response_one(*args)

    compute, solutions, response_one = methods._compute, families.solutions, response.response_one
    monkeypatch.setattr(methods, "CACHE", spectrum.Cache(2**30))
    monkeypatch.setattr(methods, "_compute", spectra)
    monkeypatch.setattr(modal.families, "solutions", bordered)
    monkeypatch.setattr(modal.response, "response_one", scalar)
    return counts


class TestTenStiffnesses400FrequenciesFiftyGaps:
    def solve(self, constraints: int, outputs: frozenset[str]) -> tuple[sweep.Result, Plan]:
        problem = Grid(constraints, outputs).problem_with_grid()
        plan = sweep.plan(problem)
        return sweep.solve(problem, plan), plan

    @pytest.mark.needs("compiled kernels")
    def test_two_constraints_cost_ten_spectra_and_4000_responses(
        self, counted: Counter[str]
    ) -> None:
        result, plan = self.solve(2, frozenset({"impulse"}))
        assert counted == {"spectrum": 10, "bordered": 4000}
        assert {step.stage: step.count for step in plan.steps} == {
            Stage.SPECTRUM: 10,
            Stage.RESPONSE: 4_000,
            Stage.IMPULSE: 200_000,
        }
        assert result.arrays["impulse"].shape == (50, 10, 400, 2)

    @pytest.mark.needs("compiled kernels")
    def test_one_constraint_costs_ten_spectra_and_4000_sums(self, counted: Counter[str]) -> None:
        self.solve(1, frozenset({"impulse"}))
        assert counted == {"spectrum": 10, "scalar": 4000}

    @pytest.mark.needs("compiled kernels")
    def test_motions_that_are_followed_cost_their_responses_once_more_for_all_gaps(
        self, counted: Counter[str]
    ) -> None:
        self.solve(2, frozenset({"exists"}))
        assert counted["spectrum"] == 10
        assert 4000 < counted["bordered"] <= 8000


@pytest.mark.needs("compiled kernels")
def test_frequencies_may_be_an_axis_of_their_own(counted: Counter[str]) -> None:
    grid = Grid(2, frozenset({"impulse"}), places=(5, 40, 10))
    problem = grid.problem()
    plan = sweep.plan(problem)
    result = sweep.solve(problem, plan)
    assert counted == {"spectrum": 10, "bordered": 400}
    assert [step.count for step in plan.steps] == [10, 400, 2000]
    assert result.meanings["Omega"].dims == ("w", "frequency")
    np.testing.assert_array_equal(result.arrays["Omega"][:, 0], grid.frequencies)


@pytest.mark.needs("compiled kernels")
def test_every_point_has_the_numbers_that_it_has_alone() -> None:
    outputs = frozenset({"impulse", "exists", "reason", "shape", "energy", "harmonics"})
    problem = Grid(2, outputs, places=(3, 7, 2)).problem()
    result = sweep.solve(problem, sweep.plan(problem))
    for index in np.ndindex(3, 7, 2):
        point = problem.at(index)
        alone = impact_modes.solve(point, impact_modes.plan(point))
        for name in (*outputs, "relative_error", "condition", "certified", "witness"):
            np.testing.assert_array_equal(result.arrays[name][index], getattr(alone, name))


def test_the_plan_says_what_is_shared() -> None:
    problem = Grid(2, frozenset({"impulse"}), places=(5, 40, 10)).problem()
    skips = {skip.what: skip.why for skip in sweep.plan(problem).skips}
    assert skips["spectrum at 1990 of 2000 points"] == "gap, w: invalidates later stages only"
    assert skips["response at 1600 of 2000 points"] == "gap: invalidates later stages only"
