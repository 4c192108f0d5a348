"""Decides how a motion is followed and what is left out; `solving` follows it."""

from __future__ import annotations

import math
import weakref
from collections.abc import Iterator
from dataclasses import replace
from enum import StrEnum
from typing import Final

import numpy as np

from vibroimpact_solvers import impact_modes, spectrum
from vibroimpact_solvers.cost import BYTES_PER_SECOND, FLOPS_PER_SECOND
from vibroimpact_solvers.matrices import Form
from vibroimpact_solvers.model import System
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step
from vibroimpact_solvers.time_history.problem import (
    EXACT,
    KIND,
    OUTPUTS,
    Member,
    Problem,
    State,
)
from vibroimpact_solvers.time_history.start import member_problem

_MOST = 2**20  # windows
_FEW = 500  # degrees of freedom up to which a full K is factorized for a plan


SECONDS: Final = 0.5
"""Planned work of a window of a long motion."""
BYTES: Final = 4.0e6
"""Planned size of what a window yields."""


class Flight(StrEnum):
    """Methods for the motion."""

    MODAL = "exact flights"
    SPLITTING = "splitting"
    INTEGRATED = "integrator of scipy"
    EXTENDED = "exact flights, in extended precision where needed"


def plan(problem: Problem) -> Plan:
    """Decide how the motion is followed and what is left out."""
    far = _far(problem)
    return Plan(KIND, tuple(_steps(problem, far)), tuple(_skips(problem, far)))


def windows(plan: Plan) -> int:
    """Return the number of windows of time in which a plan follows the motion."""
    step = plan.step(Stage.FLIGHT)
    return 1 if step is None or step.method != Flight.MODAL else step.count


def _in_windows(problem: Problem, flight: Step, history: Step | None) -> Step:
    """Return the step of an exact motion with its windows, by its work and its size.

    They are the same for all initial states, whichever walls these reach.
    """
    if flight.method != Flight.MODAL:
        return flight
    steps = [_flight(problem, len(problem.system.constraints)), *([history] if history else [])]
    flops, size = sum(step.flops for step in steps), sum(step.bytes for step in steps)
    seconds = flops / FLOPS_PER_SECOND + size / BYTES_PER_SECOND
    count = math.ceil(min(max(seconds / SECONDS, size / BYTES, 1.0), _MOST))
    if count == 1:
        return flight
    told = f"in {count} windows of time, each from the state at the end of the one before"
    return replace(flight, reason=f"{flight.reason}; {told}", count=count)


def _steps(problem: Problem, far: list[int]) -> Iterator[Step]:
    system = problem.system
    method = spectrum.choose(system)
    yield spectrum.step(system, method)
    history = None
    if isinstance(problem.initial, Member):
        start = impact_modes.plan(member_problem(system, problem.initial))
        yield from (step for step in start.steps if step.stage is not Stage.SPECTRUM)
    if problem.outputs & {"x", "v", "energy"}:
        times, dofs = problem.times.size, problem.wanted_dofs.size
        reason = f"{dofs} of {system.n} degrees of freedom at {times} times"
        flops = times * system.n * (40.0 + 4.0 * dofs)
        history = Step(Stage.HISTORY, "modal sum", reason, flops, 16.0 * times * dofs)
    yield _in_windows(problem, _flight(problem, len(system.constraints) - len(far)), history)
    if history is not None:
        yield history


def _flight(problem: Problem, count: int) -> Step:
    """Return the step of the motion, `count` constraints being within reach."""
    system = problem.system
    fastest = max([spectrum.largest_frequency(system), *(term.frequency for term in problem.load)])
    turns = problem.t_end * fastest
    if problem.method != EXACT:
        reason = "asked for, to compare with; it can miss impacts"
        flops = 3e5 * (20.0 + turns) * system.n
        return Step(Stage.FLIGHT, Flight.INTEGRATED, f"{problem.method}: {reason}", flops)
    if problem.limiter is not None:
        reason = (
            "soft limiters: exact linear flow and kicks in turns, of order six; steps are halved "
            "until the motion stays the same"
        )
        flops = 6e3 * (20.0 + turns) * system.n * (10.0 + 4.0 * count)
        return Step(Stage.FLIGHT, Flight.SPLITTING, reason, flops)
    if problem.digits is not None:
        reason = (
            "in double precision first; where its predictability ends before the motion does, the "
            f"whole motion again with {problem.digits} decimal digits"
        )
        each = 6e5 + 6e4 * system.n * (1.0 + problem.digits / 50.0)
        flops = (20.0 + turns) * each + 5e3 * float(system.n) ** 3
        return Step(Stage.FLIGHT, Flight.EXTENDED, reason, flops, 48.0 * turns)
    # An expansion lasts about the time of the fastest mode; an impact takes two at least.
    expansions = 10.0 + 2.0 * (turns + _crossings(problem))
    reason = (
        "exact between impacts, which are found by certified expansions of the constrained "
        "coordinates"
    )
    flops = 1e6 + expansions * (150.0 + system.n * (15.0 + 15.0 * count))
    return Step(Stage.FLIGHT, Flight.MODAL, reason, flops, 48.0 * expansions if count else 0.0)


def _crossings(problem: Problem) -> float:
    """Return how often a motion as fast as at its start could cross the narrowest gap."""
    state = problem.initial
    gaps = [
        c.lower + c.upper
        for c in problem.system.constraints
        if c.lower is not None and c.upper is not None
    ]
    if not isinstance(state, State) or not gaps:
        return 0.0
    speed = float(np.sqrt(np.mean(state.v**2)))
    return problem.t_end * speed / min(gaps)


def _far(problem: Problem) -> list[int]:
    """Return the constraints whose walls are out of reach for as long as energy is only lost.

    ``|y| <= (2 E w^T K^-1 w)^(1/2)`` for a positive definite K and no load.
    """
    system, state = problem.system, problem.initial
    loaded = problem.load or (system.force is not None and system.force.any())
    if not isinstance(state, State) or loaded or problem.limiter is not None:
        return []
    reaches = _REACHES.get(system)
    if reaches is None:
        reaches = _REACHES[system] = _reaches(system)
    if not reaches:
        return []
    energy = 0.5 * float(state.v @ (system.M @ state.v) + state.x @ (system.K @ state.x))
    return [i for i, least in enumerate(reaches) if energy < least]


_REACHES: weakref.WeakKeyDictionary[System, tuple[float, ...]] = weakref.WeakKeyDictionary()


def _reaches(system: System) -> tuple[float, ...]:
    """Return the energies below which the constraints do not reach their walls; none: unknown."""
    dense = Form.DENSE in {system.K.form, system.M.form}
    if (dense and system.n > _FEW) or not system.K.is_positive_definite():
        return ()
    W = system.directions(range(len(system.constraints)))
    if not len(W):
        return ()
    compliance = np.einsum("ij,ij->i", W, system.K.factorize()(np.ascontiguousarray(W.T)).T)
    walls = [
        min(np.inf if wall is None else wall for wall in (c.lower, c.upper))
        for c in system.constraints
    ]
    # Signs of walls beyond the equilibrium do not count: such walls are within reach.
    least = np.square(np.maximum(walls, 0.0)) / (2.0 * compliance) * (1.0 - 1e-12)
    return tuple(least.tolist())


def _skips(problem: Problem, far: list[int]) -> Iterator[Skip]:
    for index in far:
        yield Skip(f"constraint {index}", "the energy of the motion does not reach its walls")
    if problem.method == EXACT and problem.limiter is None:
        why = "in each flight, while the modes' amplitudes do not add up to them"
        yield Skip("walls that are out of reach", why)
        why = "one flight in closed form"
        yield Skip("the search after the last possible impact", why)
    if problem.limiter is not None and any(c.restitution < 1.0 for c in problem.system.constraints):
        yield Skip("restitution", "soft limiters give back what they take")
    if not problem.outputs & {"x", "v", "energy"}:
        yield Skip("history", "impacts and contacts need no state between them")
    for name in OUTPUTS:
        if name not in problem.outputs:
            yield Skip(name, "not asked")
