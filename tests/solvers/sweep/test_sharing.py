"""A stage is computed once for all points that do not invalidate it: counted."""

from __future__ import annotations

import gc
import weakref
from collections import Counter
from typing import Any

import numpy as np
import pytest

from vibroimpact_solvers import (
    attractors,
    impact_modes,
    periodic_motions,
    spectrum,
    sweep,
    time_history,
)
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.impact_modes import modal
from vibroimpact_solvers.kernels import families, response
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.spectrum import methods
from vibroimpact_solvers.time_history import basis, modal_damping, structure

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


class Driven:
    """Two masses with drag between two stops, pushed by a constant and a varying load."""

    def __init__(self, kind: str, points: int = 15) -> None:
        K = SymmetricMatrix.dense([[2.0, -1.0], [-1.0, 1.5]])
        M = SymmetricMatrix.dense([[1.0, 0.1], [0.1, 1.2]])
        C = SymmetricMatrix.dense([[0.1, 0.0], [0.0, 0.05]])
        # Periodic motions have no constant load.
        force = np.array([0.0, 0.8]) if kind == "time-history" else None
        self.kind, self.whole = kind, System(M, K, self._limiters(0.3, 0.3), C=C, force=force)
        self.gaps, self.restitutions = np.linspace(0.2, 0.5, points // 3), np.array([0.1, 0.5, 0.9])

    def _limiters(self, gap: float, restitution: float) -> tuple[Constraint, ...]:
        upper = Constraint((1,), (1.0,), None, gap, restitution)
        return Constraint.at(0, 2.0 * gap, restitution), upper

    def at(self, index: tuple[int, ...]) -> Any:
        gap, restitution = float(self.gaps[index[0]]), float(self.restitutions[index[1]])
        system = self.whole.limited(self._limiters(gap, restitution))
        if self.kind == "periodic-motions":
            drive = (periodic_motions.Force((0,), (1.0,), 1.0),)
            return periodic_motions.Problem(system, np.array([0.9, 1.7]), drive, constraint=1)
        start = np.array([[0.0, 0.0]]), np.array([[1.0, -0.5]])
        if self.kind == "attractors":
            drive = (attractors.Force((0,), (1.0,), 1.0),)
            return attractors.Problem(system, np.array([0.9]), *start, drive, settle=40, observe=40)
        state = time_history.State(start[0][0], start[1][0])
        load = (time_history.Harmonic(0, 0.5, 0.9),)
        outputs = frozenset({"impacts", "contacts", "x"})
        return time_history.Problem(
            system, state, 40.0, np.array([7.0, 40.0]), outputs=outputs, load=load
        )

    def problem(self) -> sweep.Problem:
        path = ("system", "constraints", 0)
        axes = [("gap", self.gaps), ("restitution", self.restitutions)]
        return sweep.Problem(
            self.kind,
            tuple(
                sweep.Axis(name, name, values, stage=sweep.rule(self.kind, (*path, name)).stage)
                for name, values in axes
            ),
            self.at,
            self.whole,
        )


@pytest.fixture
def factorised(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count spectra, factorisations, and modes with coordinates held fixed."""
    counts: Counter[str] = Counter()

    def count(owner: Any, name: str) -> None:
        counted = getattr(owner, name)

        def call(*args: Any, **options: Any) -> Any:
            counts[name] += 1
            return counted(*args, **options)

        monkeypatch.setattr(owner, name, call)

    monkeypatch.setattr(methods, "CACHE", spectrum.Cache(2**30))
    count(methods, "_compute")
    for name in ("factorize", "is_positive_definite"):
        count(SymmetricMatrix, name)
    for name in ("with_contacts", "without_contacts"):
        count(structure, name)
    return counts


KINDS_OF_MOTION = ("time-history", "periodic-motions", "attractors")


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("kind", KINDS_OF_MOTION)
def test_walls_and_restitution_factorise_nothing(kind: str, factorised: Counter[str]) -> None:
    """As often for all points as for one, in which both masses rest."""
    driven = Driven(kind)
    problem = driven.problem()
    factorised.clear()
    result = sweep.solve(problem, sweep.plan(problem))
    of_all = Counter(factorised)
    assert (result.arrays["status"] == 0).all()
    assert of_all["_compute"] == 1
    # Attractors are verified as periodic motions, whose load is no part of the structure.
    assert of_all["without_contacts"] == (2 if kind == "attractors" else 1)
    # Either mass rests, or both.
    assert of_all["with_contacts"] <= 3
    assert of_all["factorize"] <= 3
    if kind == "time-history":
        assert of_all["with_contacts"] > 0
        assert result.arrays["contact_count"].any()
    sweep.solve(problem, sweep.plan(problem))
    again = Counter(factorised)
    assert again == of_all, again  # all of it is kept for as long as the structure is


class Loaded(Driven):
    """The same, whose load varies in size and phase; damping couples its modes."""

    amplitudes, phases = np.linspace(0.5, 1.1, 5), np.array([0.0, 0.4, 0.9])

    def at(self, index: tuple[int, ...]) -> Any:
        amplitude, phase = float(self.amplitudes[index[0]]), float(self.phases[index[1]])
        system = self.whole.limited(self._limiters(0.3, 0.5))
        if self.kind == "periodic-motions":
            drive = (periodic_motions.Force((0,), (1.0,), amplitude, phase=phase),)
            return periodic_motions.Problem(system, np.array([0.9, 1.7]), drive, constraint=1)
        start = np.array([[0.0, 0.0]]), np.array([[1.0, -0.5]])
        if self.kind == "attractors":
            drive = (attractors.Force((0,), (1.0,), amplitude, phase=phase),)
            return attractors.Problem(system, np.array([0.9]), *start, drive, settle=40, observe=40)
        load = (time_history.Harmonic(0, amplitude, 0.9, phase),)
        state, t = time_history.State(start[0][0], start[1][0]), np.array([7.0, 20.0])
        return time_history.Problem(system, state, 20.0, t, load=load)

    def problem(self) -> sweep.Problem:
        axes = [("amplitude", self.amplitudes), ("phase", self.phases)]
        return sweep.Problem(
            self.kind,
            tuple(
                sweep.Axis(name, name, values, stage=sweep.rule(self.kind, ("load", 0, name)).stage)
                for name, values in axes
            ),
            self.at,
            self.whole,
        )


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("kind", KINDS_OF_MOTION)
def test_loads_factorise_nothing(
    kind: str, factorised: Counter[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Modes, their damping and complex modes are those of the structure, whatever drives it."""

    def count(owner: Any, name: str) -> None:
        counted = getattr(owner, name)

        def call(*args: Any, **options: Any) -> Any:
            factorised[name] += 1
            return counted(*args, **options)

        monkeypatch.setattr(owner, name, call)

    count(modal_damping, "of_modes")
    count(basis, "complex_modes")
    problem = Loaded(kind).problem()
    factorised.clear()
    result = sweep.solve(problem, sweep.plan(problem))
    assert (result.arrays["status"] == 0).all()
    assert factorised["_compute"] == 1
    assert factorised["of_modes"] == 1 + factorised["with_contacts"]
    # With and without chains of modes; attractors in the unit of time of their motions, too.
    assert factorised["complex_modes"] <= (1 if kind == "time-history" else 3)
    assert factorised["factorize"] <= 3


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("kind", KINDS_OF_MOTION)
def test_motions_between_other_walls_have_the_numbers_that_they_have_alone(kind: str) -> None:
    problem = Driven(kind).problem()
    result = sweep.solve(problem, sweep.plan(problem))
    offsets = {name: values for name, values in result.arrays.items() if name.endswith("_offset")}
    solver = problem.swept_kind.solver
    for index in np.ndindex(problem.shape):
        point = Driven(kind).problem().at(index)  # whose structure nothing was prepared for
        alone = solver.solve(point, solver.plan(point))
        for name, meaning in result.meanings.items():
            values = getattr(alone, name, None)
            if not isinstance(values, np.ndarray) or meaning.coordinate:
                continue
            rows = meaning.dims[0]
            if f"{rows}_offset" in offsets:
                start = int(offsets[f"{rows}_offset"][index])
                of_point = result.arrays[name][start : start + len(values)]
            else:
                of_point = result.arrays[name][index]
            np.testing.assert_array_equal(of_point, values, err_msg=name)


@pytest.mark.needs("compiled kernels")
def test_what_was_prepared_is_forgotten_with_its_structure() -> None:
    driven = Driven("time-history")
    problem = driven.at((0, 0))
    time_history.solve(problem, time_history.plan(problem))
    system, body = weakref.ref(problem.system), weakref.ref(problem.system.body)
    assert time_history.prepared(problem.system)
    gc.disable()  # nor does it wait for that
    try:
        del problem
        assert system() is None
        del driven
        assert body() is None
    finally:
        gc.enable()
