"""Motions with degrees of freedom without mass, against those of the condensed structure."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.reference.balls import Structure
from tests.reference.rigid import RigidMotion
from tests.solvers.massless.condensable import Condensable, condensable
from tests.solvers.structures import referenced
from vibroimpact_solvers import branches, ensemble, impact_modes, sweep, time_history
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.plan import Stage
from vibroimpact_solvers.time_history import Harmonic, Power, Sampled, State

ALL = frozenset(time_history.OUTPUTS)
TIMES = np.linspace(0.0, 8.0, 17)
EPS = 2.0**-52


def state(case: Condensable, seed: int = 1) -> State:
    rng = np.random.default_rng(seed)
    n = case.massive.size
    return State(rng.uniform(-0.02, 0.02, n), rng.standard_normal(n))


def spread(case: Condensable, of: State) -> State:
    return State(case.spread(of.x), case.spread(of.v))


def history(system: System, initial: State, **other: Any) -> time_history.Result:
    given: dict[str, Any] = {"t": TIMES, "outputs": ALL} | other
    problem = time_history.Problem(system, initial, 8.0, **given)
    return time_history.solve(problem, time_history.plan(problem))


def follows(case: Condensable, result: Any, size: float = 1e-13) -> None:
    """Displacements and velocities without mass are those of the static relation."""
    for values in (result.x, result.v):
        follow = values[..., case.massive] @ case.static.T
        room = size * (1.0 + np.abs(values).max()) * (1.0 + np.abs(case.static).sum())
        assert np.abs(values[..., case.massless] - follow).max() < room


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("restitution", [1.0, 0.7, 0.0])
@pytest.mark.parametrize("digits", [None, 40])
def test_impacts_and_contacts_are_those_of_the_reference(
    restitution: float, digits: int | None
) -> None:
    """The reference has 77 digits; with 40, all doubles are right to rounding."""
    case = condensable(3, 4, 3)
    limiters = (Constraint.at(0, 0.05, restitution), Constraint.at(2, 0.1, restitution))
    damped, load = restitution < 1.0, ()
    if restitution == 0.0:  # it presses: contacts last
        load = ((0, 0.6, 0.9, 0.3),)
    start, whole = state(case), case.whole(limiters, damped=damped)
    harmonic = tuple(Harmonic(int(case.massive[dof]), *rest) for dof, *rest in load)
    tolerance = None if digits is None else 1e-15
    result = history(whole, spread(case, start), load=harmonic, digits=digits, tolerance=tolerance)
    condensed = case.condensed(limiters, damped=damped)
    _, rows = referenced(condensed)
    C = None if condensed.C is None else condensed.C.to_dense()
    structure = Structure(condensed.M.to_dense(), condensed.K.to_dense(), C, load=load)
    motion = RigidMotion(structure, rows, [restitution] * 2, start.x, start.v).run(8.0, TIMES)
    by_hand = history(
        condensed, start, load=tuple(Harmonic(*term) for term in load),
        digits=digits, tolerance=tolerance,
    )  # fmt: skip
    assert result.impact_time is not None
    assert result.contact_start is not None
    assert result.x is not None
    assert result.v is not None
    # The reference lists the impacts of a chatter, and those of coordinates in contact, otherwise.
    assert result.impact_time.size == by_hand.count_impacts > 3
    assert len(motion.contacts) == result.contact_start.size
    assert bool(result.contact_start.size) == (restitution < 1.0)
    size = 1e-8 if digits is None else 4.0 * EPS
    if restitution == 1.0:
        size = max(result.error_condition, 8.0) * EPS
        times = np.array([float(i.time) for i in motion.impacts])
        np.testing.assert_allclose(result.impact_time, times, atol=100.0 * size)
        impulses = np.array([abs(float(i.impulse)) for i in motion.impacts])
        np.testing.assert_allclose(result.impact_impulse, impulses, atol=100.0 * size)
    states = np.array([[float(z) for z in entries.entries()] for entries in motion.states])
    n, largest = case.massive.size, np.abs(states).max()
    # The condition is relative to the state in the norm of energy.
    np.testing.assert_allclose(result.x[:, case.massive], states[:, :n], atol=20.0 * size * largest)
    np.testing.assert_allclose(
        result.v[:, case.massive], states[:, n : 2 * n], atol=100.0 * size * largest
    )
    follows(case, result)
    if restitution == 1.0:
        assert result.error_energy_drift is not None
        assert result.error_energy_drift < 1e-12
    if digits is not None:
        assert result.error_digits == digits


def test_energy_is_that_of_the_whole_structure() -> None:
    case = condensable(4, 5, 4)
    whole = case.whole((Constraint.at(1, 0.05),))
    result = history(whole, spread(case, state(case)))
    assert result.x is not None
    assert result.v is not None
    energy = 0.5 * np.einsum("ti,ij,tj->t", result.v, case.M, result.v)
    energy += 0.5 * np.einsum("ti,ij,tj->t", result.x, case.K, result.x)
    np.testing.assert_allclose(result.energy, energy, rtol=1e-12)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-12)
    assert result.count_impacts > 5


@pytest.mark.needs("compiled kernels")
def test_other_methods_and_limiters_agree() -> None:
    """Soft limiters, an integrator, sampled loads and starts on impact modes."""
    case = condensable(5, 4, 3)
    limiters, start = (Constraint.at(1, 0.1),), state(case)
    pairs = (case.whole(limiters), spread(case, start)), (case.condensed(limiters), start)
    samples = np.array([0.0, 1.0, 3.0, 9.0]), np.array([0.0, 0.3, -0.2, 0.1])
    direction = np.array([0.2, 0.0, 1.0, 0.0])
    for other in (
        {"limiter": Power(3.0, 10.0, 0.5), "outputs": frozenset({"x", "v", "energy"})},
        {"method": "DOP853", "tolerance": 1e-10, "outputs": frozenset({"x", "v", "energy"})},
        {"load": True},
    ):
        results = []
        for system, initial in pairs:
            given = dict(other)
            if "load" in other:
                along = direction if system.n == 4 else case.spread(direction)
                given["load"] = (Sampled(along, *samples),)
            results.append(history(system, initial, **given))
        ours, theirs = results
        np.testing.assert_allclose(ours.x[:, case.massive], theirs.x, atol=1e-7)
        np.testing.assert_allclose(ours.energy, theirs.energy, atol=1e-7)
        follows(case, ours, 1e-8 if "method" in other else 1e-12)


def test_a_start_on_an_impact_mode_stays_on_it() -> None:
    case = condensable(5, 4, 3)
    mode = time_history.ImpactMode(4.0)
    ours = history(case.whole((Constraint.at(1, 0.1),)), mode)  # type: ignore[arg-type]
    theirs = history(case.condensed((Constraint.at(1, 0.1),)), mode)  # type: ignore[arg-type]
    assert ours.x is not None
    assert ours.count_impacts == theirs.count_impacts
    np.testing.assert_allclose(ours.x[:, case.massive], theirs.x, atol=1e-9)
    follows(case, ours)


def test_a_whole_state_starts_the_same_motion() -> None:
    """Zeros stand for the static relation; states that satisfy it are the same."""
    case = condensable(6, 4, 3)
    whole, start = case.whole((Constraint.at(1, 0.1, 0.8),)), state(case)
    short = history(whole, spread(case, start))
    full = State(*(case.spread(z) for z in (start.x, start.v)))
    full.x[case.massless], full.v[case.massless] = case.static @ start.x, case.static @ start.v
    long = history(whole, full)
    np.testing.assert_array_equal(long.x, short.x)
    np.testing.assert_allclose(short.x[0], full.x, atol=1e-15)  # type: ignore[index]
    # The energy of a start decides which walls are out of reach.
    assert short.impact_time is not None
    assert long.impact_time is not None
    np.testing.assert_array_equal(long.impact_time, short.impact_time)


@pytest.mark.needs("compiled kernels")
def test_ensembles_are_their_motions() -> None:
    case = condensable(7, 4, 3)
    whole = case.whole((Constraint.at(1, 0.05, 0.8),))
    rng = np.random.default_rng(2)
    x = case.spread(rng.uniform(-0.02, 0.02, (5, 4)))
    v = case.spread(rng.standard_normal((5, 4)))
    problem = ensemble.Problem(whole, x, v, 8.0, TIMES, outputs=ALL)
    result = ensemble.solve(problem, ensemble.plan(problem))
    assert result.x is not None
    for place in range(5):
        alone = history(whole, State(x[place], v[place]))
        np.testing.assert_allclose(result.x[place], alone.x, atol=1e-13)
    follows(case, result)


def test_sweeps_are_their_points() -> None:
    """Each point of a sweep over the gap is the impact mode computed alone."""
    case = condensable(8, 4, 3)
    gaps, omega = np.array([0.1, 0.2, 0.4]), np.array([1.0, 2.3])

    def at(index: tuple[int, ...]) -> impact_modes.Problem:
        system = whole.limited((replace(whole.constraints[0], lower=gaps[index[0]],
                                        upper=gaps[index[0]]),))  # fmt: skip
        return impact_modes.Problem(system, omega)

    whole = case.whole((Constraint.at(1, 0.1),))
    axis = sweep.Axis("system.constraints.0.gap", "gap", gaps, stage=Stage.IMPULSE)
    problem = sweep.Problem("impact-modes", (axis,), at, whole)
    result = sweep.solve(problem, sweep.plan(problem))
    for place in range(3):
        alone = impact_modes.solve(at((place,)), impact_modes.plan(at((place,))))
        np.testing.assert_allclose(result.arrays["impulse"][place], alone.impulse, rtol=1e-13)


@pytest.mark.needs("compiled kernels")
def test_periodic_motions_are_those_of_the_condensed_structure() -> None:
    """And extremes without mass are those of the waveform by the static relation."""
    case = condensable(9, 4, 3)
    limiters = (Constraint.at(1, 0.1, 0.8),)
    tau = np.linspace(0.0, 1.0, 2001)
    results = []
    for system, dof in ((case.whole(limiters, damped=True), int(case.massive[2])),
                        (case.condensed(limiters, damped=True), 2)):  # fmt: skip
        force = driven.Force((dof,), (1.0,), 0.5)
        problem = driven.Problem(
            system, np.array([0.9, 1.3, 2.0]), (force,), sequence=driven.SYMMETRIC,
            outputs=frozenset(driven.OUTPUTS), tau=tau,
        )  # fmt: skip
        results.append(driven.solve(problem, driven.plan(problem)))
    ours, theirs = results
    assert ours.impact_momentum.size == theirs.impact_momentum.size > 0
    np.testing.assert_allclose(ours.impact_momentum, theirs.impact_momentum, rtol=1e-10)
    np.testing.assert_array_equal(ours.solution_exists, theirs.solution_exists)
    np.testing.assert_allclose(ours.solution_stability, theirs.solution_stability, rtol=1e-9)
    np.testing.assert_allclose(ours.solution_work, theirs.solution_work, rtol=1e-9)
    np.testing.assert_allclose(ours.solution_x_max[:, case.massive], theirs.solution_x_max)
    follow = theirs.waveform @ case.static.T
    np.testing.assert_allclose(ours.waveform[..., case.massless], follow, atol=1e-10)
    np.testing.assert_allclose(ours.solution_x_max[:, case.massless], follow.max(axis=1), atol=1e-4)


@pytest.mark.needs("compiled kernels")
def test_branches_are_those_of_the_condensed_structure() -> None:
    case = condensable(10, 3, 2)
    limiters = (Constraint((1,), (1.0,), None, 0.1, 0.8),)
    results = []
    for system, dof in ((case.whole(limiters, damped=True), int(case.massive[1])),
                        (case.condensed(limiters, damped=True), 1)):  # fmt: skip
        load = (driven.Force((dof,), (1.0,), 0.5),)

        def at(Omega: float, system: System = system, load: Any = load) -> driven.Problem:
            outputs = frozenset({"exists", "stability"})
            return driven.Problem(system, np.array([Omega]), load, outputs=outputs)

        problem = branches.Problem(at, 1.0, 1.6, system, frequency=True)
        results.append(branches.solve(problem, branches.plan(problem)))
    ours, theirs = results
    np.testing.assert_array_equal(ours.point_type, theirs.point_type)
    np.testing.assert_allclose(ours.point_parameter, theirs.point_parameter, rtol=1e-8)
