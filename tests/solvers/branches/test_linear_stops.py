"""Branches with stops of finite stiffness, against integration, formulas and single frequencies.

The oscillator is that of Shaw and Holmes, A periodically forced piecewise linear oscillator,
J. Sound Vib. 90 (1983) 129-155. The integrator is scipy's DOP853, which stops at each switching.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import newton

from tests.solvers.periodic_motions.test_contact_sequences import FIRST, SECOND, Two
from vibroimpact_solvers import branches
from vibroimpact_solvers import periodic_motions as driven
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System

ONE = SymmetricMatrix.diagonal([1.0])
OUTPUTS = frozenset({"exists", "stability"})
DRAG, GAP, K = 0.05, 1.2, 10.0


def motions(
    Omega: float, *, c: float = 0.2, k: float = K, gap: float = GAP, amplitude: float = 1.0,
    symmetric: bool = False,
) -> driven.Problem:  # fmt: skip
    wall = Constraint((0,), (1.0,), gap if symmetric else None, gap, law=Linear(k, c))
    system = System(ONE, ONE, (wall,), C=SymmetricMatrix.diagonal([2.0 * DRAG]))
    sequence: Any = driven.SYMMETRIC if symmetric else (driven.Impact(0),)
    load = (driven.Force((0,), (1.0,), amplitude),)
    return driven.Problem(system, np.array([Omega]), load, sequence=sequence, outputs=OUTPUTS)


def followed(
    at: Callable[[float], driven.Problem], start: float, stop: float, *, frequency: bool = True,
    **options: Any,
) -> branches.Result:  # fmt: skip
    problem = branches.Problem(at, start, stop, at(start).system, frequency, **options)
    return branches.solve(problem, branches.plan(problem))


def points(result: branches.Result, kind: branches.Type) -> np.ndarray:
    return np.flatnonzero(result.point_type == kind)


def period(Omega: float, c: float, t: float, z: np.ndarray, length: float) -> np.ndarray:
    """Return the state of the oscillator a time later, by integration from switching to switching.

    The stop's force is ``max(0, K d + c d')`` beyond the wall.
    """
    end = t + length

    def beyond(_: float, z: np.ndarray) -> float:
        return float(z[0]) - GAP

    def force(_: float, z: np.ndarray) -> float:
        return K * (float(z[0]) - GAP) + c * float(z[1])

    # Open, loaded, or released: beyond the wall without force.
    state = "open" if z[0] < GAP or (z[0] == GAP and z[1] <= 0.0) else "loaded"
    while t < end:

        def rate(t: float, z: np.ndarray, state: str = state) -> list[float]:
            pushed = force(t, z) if state == "loaded" else 0.0
            return [z[1], np.cos(Omega * t) - 2.0 * DRAG * z[1] - z[0] - pushed]

        events: list[Any] = [force] if state == "loaded" else [beyond]
        if state == "released":

            def regained(t: float, z: np.ndarray) -> float:
                return force(t, z)

            events.append(regained)
        for event, direction in zip(events, {"open": (1.0,)}.get(state, (-1.0, 1.0)), strict=False):
            event.terminal, event.direction = True, direction
        # Steps are shorter than contacts: one that spans a whole contact ends where it begins.
        moved = solve_ivp(
            rate, (t, end), z, "DOP853", events=events, rtol=1e-12, atol=1e-13, max_step=0.1
        )
        t, z = float(moved.t[-1]), moved.y[:, -1]
        if moved.status != 1:
            break
        if state == "open":
            state, z = "loaded", np.array([GAP, z[1]])
        elif state == "loaded":
            # Without damping the force ends at the wall.
            state = "released" if z[0] - GAP > 1e-12 else "open"
        elif moved.t_events[0].size:
            state, z = "open", np.array([GAP, z[1]])
        else:
            state = "loaded"
    return z


def multipliers(result: branches.Result, row: int, c: float) -> np.ndarray:
    """Return the multipliers of a listed motion by differences of integrated motions.

    Frequency and time of the contact are those listed. The velocity at which it begins is the one
    at which the integrated motion comes back to the wall: at a fold without damping of the stop
    that is ill-conditioned for the solver, as its error says.
    """
    assert result.contact_solution is not None
    assert result.contact_time is not None
    assert result.contact_duration is not None
    assert result.contact_velocity is not None
    assert result.error_contact_velocity is not None
    (k,) = np.flatnonzero(result.contact_solution == row)
    Omega = float(result.solution_Omega[row])
    T, begin = 2.0 * np.pi / Omega, float(result.contact_time[k])
    (before,) = np.flatnonzero(result.contact_solution == row - 1)
    near = float(result.contact_velocity[before])

    def returned(v: float) -> float:
        return float(period(Omega, c, begin, np.array([GAP, v]), T)[0]) - GAP

    z = np.array([GAP, newton(returned, near, tol=1e-12, x1=near * (1.0 - 1e-3))])
    listed = float(result.contact_velocity[k]), float(result.error_contact_velocity[k])
    assert abs(z[1] - listed[0]) <= listed[1] + 1e-8
    late = float(result.contact_duration[k]) + 0.5 * (T - float(result.contact_duration[k]))
    start, t = period(Omega, c, begin, z, late), begin + late
    assert period(Omega, c, t, start, T) == pytest.approx(start, abs=1e-8)
    sides = [
        [period(Omega, c, t, start + h, T) for h in size * np.eye(2)] for size in (1e-6, -1e-6)
    ]
    return np.asarray(np.linalg.eigvals((np.array(sides[0]) - np.array(sides[1])).T / 2e-6))


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("c", [0.0, 0.2])
def test_folds_and_grazing(c: float) -> None:
    """The branch folds twice and loses its contact where the linear response touches the wall."""
    result = followed(lambda W: motions(W, c=c), 1.3, 1.6, step=0.2)
    assert result.solution_exists is not None
    assert result.solution_exists.all()
    (touch,) = points(result, branches.Type.GRAZING)
    # |1 - W^2 + 2 i d W| = 1 / gap
    W2 = np.roots([1.0, 4.0 * DRAG**2 - 2.0, 1.0 - (1.0 / GAP) ** 2]).max()
    assert abs(result.point_parameter[touch] - np.sqrt(W2)) < result.point_error[touch] < 1e-9
    folds = points(result, branches.Type.FOLD)
    assert folds.size == 2
    stopped = followed(lambda W: motions(W, c=c), 1.4, 1.6, step=0.2, stop_at=frozenset({"fold"}))
    value = stopped.point_parameter[points(stopped, branches.Type.FOLD)[0]]
    assert np.abs(result.point_parameter[folds] - value).min() < 1e-11
    row = int(np.flatnonzero(stopped.solution_parameter == value)[0])
    assert np.abs(multipliers(stopped, row, c) - 1.0).min() < 1e-4


@pytest.mark.needs("compiled kernels")
def test_a_period_doubles_and_a_second_contact_begins() -> None:
    """A branch leaves at a flip, gains and loses a contact, and comes back at the other flip."""
    result = followed(motions, 0.4, 0.46, step=0.2, switch=1)
    flips = points(result, branches.Type.FLIP)
    assert result.solution_contacts is not None
    assert flips.size == 2
    assert result.point_leads_to[flips[0]] == 1
    child = result.solution_branch == 1
    assert (result.solution_periods[child] == 2).all()
    ends = np.sort(result.solution_parameter[child][[0, -1]])
    assert ends == pytest.approx(np.sort(result.point_parameter[flips]), abs=2e-3)
    assert set(result.solution_contacts[child]) == {1, 2}
    # At the flip a multiplier is -1.
    stop_at = frozenset({"flip"})
    stopped = followed(motions, 0.41, 0.43, step=0.2, stop_at=stop_at)
    value = stopped.point_parameter[points(stopped, branches.Type.FLIP)[0]]
    assert np.abs(result.point_parameter[flips] - value).min() < 1e-11
    row = int(np.flatnonzero(stopped.solution_parameter == value)[0])
    assert np.abs(multipliers(stopped, row, 0.2) + 1.0).min() < 1e-4


@pytest.mark.needs("compiled kernels")
def test_a_contact_is_born_where_a_motion_with_one_ceases_to_exist() -> None:
    """Isolation at single frequencies tells on which side there is a motion with one contact."""
    result = followed(motions, 0.54, 0.6, step=0.2)
    births = points(result, branches.Type.GRAZING)
    assert births.size
    assert result.solution_contacts is not None
    for row in births.tolist():
        counts = []
        for side in (-1e-7, 1e-7):
            problem = motions(float(result.point_parameter[row]) + side)
            alone = driven.solve(problem, driven.plan(problem))
            assert alone.solution_exists is not None
            assert alone.solution_contacts is not None
            counts.append(int((alone.solution_exists & (alone.solution_contacts == 1)).sum()))
        assert abs(counts[0] - counts[1]) == 1


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize(
    ("name", "start", "stop", "symmetric"),
    [
        ("amplitude", 0.9, 1.6, False), ("amplitude", 0.9, 1.6, True), ("gap", 1.2, 0.4, False),
        ("k", 5.0, 40.0, False),
    ],
)  # fmt: skip
def test_along_other_numbers(name: str, start: float, stop: float, *, symmetric: bool) -> None:
    """Motions along any path are those that are found at its values alone, within the errors."""

    def at(value: float) -> driven.Problem:
        return motions(1.2, symmetric=symmetric, **{name: value})  # type: ignore[arg-type]

    result = followed(at, start, stop, frequency=False, step=0.2)
    assert result.contact_solution is not None
    assert result.solution_contacts is not None
    struck = np.flatnonzero(result.solution_contacts)
    assert struck.size > 8
    for row in struck[:: max(1, struck.size // 4)].tolist():
        problem = at(float(result.solution_parameter[row]))
        agrees(result, row, driven.solve(problem, driven.plan(problem)))


def agrees(result: branches.Result, row: int, alone: driven.Result) -> None:
    """Check that a motion is one of those that were found by themselves."""
    assert alone.contact_solution is not None
    mine = np.flatnonzero(result.contact_solution == row)
    apart = []
    for other in np.flatnonzero(alone.solution_contacts == mine.size).tolist():
        rows = np.flatnonzero(alone.contact_solution == other)
        far = 0.0
        for name in ("duration", "impulse", "peak_force", "velocity"):
            one, two = (
                np.sort(getattr(of, f"contact_{name}")[at])
                for of, at in ((result, mine), (alone, rows))
            )
            error = max(
                getattr(of, f"error_contact_{name}")[at].max()
                for of, at in ((result, mine), (alone, rows))
            )
            far = max(far, float(np.abs(one - two).max() / (2.0 * error + 1e-13)))
        apart.append(far)
    assert min(apart) <= 1.0


@pytest.mark.needs("compiled kernels")
def test_two_stops() -> None:
    """Motions of a chain between two stops are those that Newton's method finds alone."""
    case = Two.random(0)
    problem = replace(case.problem((FIRST, SECOND)), outputs=OUTPUTS)
    W = case.Omega
    result = followed(lambda value: problem.at(np.array([value])), W, 1.05 * W, step=0.2)
    assert result.solution_exists is not None
    assert result.solution_contacts is not None
    assert result.contact_phase is not None
    assert result.solution_exists.all()
    rows = np.flatnonzero(result.solution_contacts == 2)
    assert rows.size
    for row in rows[:: max(1, rows.size // 2)].tolist():
        mine = np.flatnonzero(result.contact_solution == row)
        order = tuple(
            driven.Impact(int(result.contact_constraint[k]), int(result.contact_side[k]))  # type: ignore[index]
            for k in mine
        )
        near = result.contact_phase[mine]
        near = near + 2.0 * np.pi * np.cumsum(np.diff(near, prepend=near[0]) < 0.0)
        value = np.array([float(result.solution_parameter[row])])
        alone = replace(problem.at(value), sequence=order, phases=near[np.newaxis])
        agrees(result, row, driven.solve(alone, driven.plan(alone)))
