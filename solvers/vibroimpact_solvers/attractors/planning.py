"""The plan of attractors: time histories, their linearised motion, and Newton's method."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from vibroimpact_solvers import spectrum, time_history
from vibroimpact_solvers.attractors.contact_verification import MOST_CONTACTS
from vibroimpact_solvers.attractors.problem import KIND, OUTPUTS, Problem
from vibroimpact_solvers.attractors.verification import MOST_IMPACTS
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step

_MEMORY = 2**27  # bytes of the states and impacts of the motions that are observed at a time
_LARGEST = 2**29  # and of those of one motion
_EXPECTED = 4.0  # attractors
_IMPACTS = 2.0  # per period of the drive
_MOTION, _ATTRACTOR, _IMPACT = 48.0, 168.0, 88.0  # bytes of the rows of tables
_ROW = 150.0  # bytes of an impact until it is looked at
_NEWTON = 5e7  # operations of the search for an attractor with impacts, of any structure
_MOST_SOLVED = 150  # degrees of freedom
_MANY = (
    "motions in parallel, without errors of their own; one in windows that rests and returns to "
    "its states but for their rounding ends with its window"
)
_SWITCH = 1e3  # operations of one motion in a loop over arrays of many, with stops that yield
_LOOP = 1e5  # operations of one event of that loop, however many motions there are
_PROOF = 5e7  # operations of a proof with contacts, of any structure
_EVENT = 3e3  # operations of one motion in a loop over arrays of many


@dataclass(frozen=True, slots=True)
class Batches:
    """How the motions are observed: the plan of each, and how many at a time."""

    history: Plan
    motions: int


def plan(problem: Problem) -> Plan:
    """Decide how the motions are computed and compared, and what is left out.

    Raises
    ------
    PlanError
        Where the states of one motion take more memory than there is, or its periods too long.
    """
    if _each(problem) > _LARGEST:
        periods = f"{problem.settle} + {problem.observe} periods"
        message = (
            f"states and impacts of one motion in {periods} take {_each(problem) / 1e9:.1f} GB"
        )
        more = "settle" if problem.settle > problem.observe else "observe"
        raise PlanError(f"{message}: settle and observe for less time", (more,))
    of_one = _history(problem)
    skips = (Skip(name, "not requested") for name in OUTPUTS if name not in problem.outputs)
    return Plan(KIND, tuple(_steps(problem, of_one)), tuple(skips))


def _history(problem: Problem) -> Plan:
    """Return the plan of one motion; an end that it never reaches is that of its periods."""
    try:
        return time_history.plan(time_history.of_mean_speed(problem.pattern, problem.v))
    except PlanError as error:
        if error.pointer != ("t_end",):
            raise
        periods = f"{problem.settle} + {problem.observe} periods of the drive are too long"
        raise PlanError(f"{periods}: {error.message}", ("frequency",)) from None


def _batch(problem: Problem) -> int:
    """Return how many motions are observed at a time."""
    return max(1, min(problem.size, int(_MEMORY / _each(problem))))


def _each(problem: Problem) -> float:
    """Return the bytes of the states and impacts of one motion, about."""
    periods = float(problem.settle + problem.observe)
    return 32.0 * (problem.observe + 1.0) * problem.system.n + _ROW * _IMPACTS * periods


def _steps(problem: Problem, of_one: Plan) -> Iterator[Step]:
    count, periods = float(problem.size), float(problem.observe)
    modes = float(problem.system.n)
    for step in of_one.steps:
        if step.stage is Stage.SPECTRUM:
            size = spectrum.nbytes(problem.system, spectrum.Method(step.method))
            if size > spectrum.MEMORY:
                message = f"the natural modes of the structure take more than {size / 1e9:.0f} GB"
                raise PlanError(message, ("system",))
            yield replace(step, reason=f"{step.reason}; one for all motions")
        elif step.stage is Stage.FREE_MOTION:
            yield replace(
                step, reason=f"{step.reason}; {_MANY}",
                flops=step.flops * count, bytes=0.0, count=problem.size, bounded=False,
                settings=Batches(of_one, _batch(problem)),
            )  # fmt: skip
        elif step.stage is Stage.HISTORY:
            reason = f"states once per period of the drive, of {_batch(problem)} motions at a time"
            yield replace(step, reason=reason, flops=step.flops * count, bytes=0.0)
    switchings = 2.0 * _IMPACTS if problem.stopped else _IMPACTS
    events = count * periods * (1.0 + switchings)
    reason = (
        "one deviation carried along by the linearised motion: its growth decides about chaos, "
        "against its own error"
    )
    flops = events * (60.0 * modes + _EVENT)
    if problem.stopped:
        flops = events * (60.0 * modes + _SWITCH) + count * periods * switchings * 8.0 * modes**2
        flops += _LOOP * periods * (1.0 + switchings)
    yield Step(Stage.STABILITY, "saltation", reason, flops, _MOTION * count, bounded=False)
    yield _comparison(problem)
    strikes = _strikes(problem)
    if "stability" in problem.outputs and problem.stopped:
        reason = (
            f"periodic attractors of up to {MOST_CONTACTS} contacts, begun at the switchings that "
            "time histories end with"
        )
        flops = _EXPECTED * (_PROOF + 1e4 * modes**3)
        yield Step(Stage.IMPULSE, "newton", reason, flops, 0.0, bounded=False)
    elif "stability" in problem.outputs:
        reason = (
            f"periodic attractors of up to {MOST_IMPACTS} impacts, begun at the impacts that time "
            "histories end with"
        )
        flops = _EXPECTED * (_NEWTON * strikes + 2e5 * modes * 16.0 * (0.01 + 0.99 * strikes))
        yield Step(Stage.IMPULSE, "newton", reason, flops, 0.0, bounded=False)


def _strikes(problem: Problem) -> float:
    """Return 1 where the load alone would move a limited coordinate beyond a wall, about, else 0.

    Where it does not, motions mostly settle on one without impacts, with nothing to search for.
    Structures of many degrees of freedom are not solved for that.
    """
    system = problem.system
    if system.n > _MOST_SOLVED or system.massless.size:
        return 1.0
    rows = system.directions(range(len(system.constraints)))
    still = np.zeros(system.n) if system.force is None else system.force
    M, K = system.M.to_dense(), system.K.to_dense()
    C = np.zeros_like(M) if system.C is None else system.C.to_dense()
    reach = np.zeros(len(rows))
    with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):
        for force in problem.load:
            turning = force.harmonic * float(problem.Omega[0])
            stiffness = K - turning**2 * M + 1j * turning * C
            direction = np.zeros(system.n)
            np.add.at(direction, list(force.dofs), force.weights)
            reach += np.abs(rows @ np.linalg.solve(stiffness, force.amplitude * direction))
        level = rows @ np.linalg.solve(K, still) if still.any() else np.zeros(len(rows))
        upper = np.array([np.inf if c.upper is None else c.upper for c in system.constraints])
        lower = np.array([np.inf if c.lower is None else c.lower for c in system.constraints])
        inside = (level + reach <= upper) & (reach - level <= lower)
        return float(not inside.all())
    return 1.0


def _comparison(problem: Problem) -> Step:
    """Return the step that compares motions and makes the tables."""
    dofs = float(problem.output_dofs.size)
    flops = problem.size * problem.longest**2 * 8.0 * problem.system.n
    size = _EXPECTED * (_ATTRACTOR + 16.0 * dofs + _IMPACTS * problem.longest * _IMPACT)
    if "section" in problem.outputs:
        points = min(float(problem.points), problem.observe + 1.0)
        size += _EXPECTED * points * (8.0 + 32.0 * dofs if problem.section == "phase" else 56.0)
    reason = (
        f"states that return after up to {problem.longest} periods, equal up to a shift by whole "
        "periods; sets of states that cover each other"
    )
    return Step(Stage.RESPONSE, "recurrence", reason, flops, size, bounded=False)
