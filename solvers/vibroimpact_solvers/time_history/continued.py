"""Motions that start where others ended, as the points of a continued sweep do.

What is carried on is the state at the end of a motion and how far its harmonic loads have turned:
a load ``amplitude cos(frequency t + phase)`` goes on without a jump of its phase, whatever becomes
of its amplitude and its frequency, as a shaker does whose setting is changed. Samples begin anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError, SolverError
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.results.time_history import Result
from vibroimpact_solvers.time_history.loads import Harmonic, Load
from vibroimpact_solvers.time_history.many import Outcome, solve_many
from vibroimpact_solvers.time_history.problem import Problem, State, walls, within

_STATE: Final = frozenset({"x", "v"})


@dataclass(frozen=True, eq=False, slots=True)
class End:
    """The end of a motion.

    Parameters
    ----------
    state : State
    turned : array, shape (load,)
        Angles by which the harmonic loads have turned since the first motion, -pi to pi; 0 of
        sampled ones.
    """

    state: State
    turned: Floats


def start(system: System, end: End) -> State:
    """Return the initial state of a motion of a structure that begins at an end."""
    return State(*(_massive(system, values) for values in (end.state.x, end.state.v)))


def _massive(system: System, values: Floats) -> Floats:
    """Return displacements or velocities with zeros for those that follow the others."""
    values = values.copy()
    values[..., system.massless] = 0.0
    return values


def going_on(problem: Problem, end: End) -> Problem:
    """Return a motion whose harmonic loads go on from an end.

    Raises
    ------
    ModelError
        If there are not as many loads as before.
    """
    if moving := [i for i, c in enumerate(problem.system.constraints) if c.wall]:
        message = "motions with walls that move do not go on from others"
        raise ModelError(("system", "constraints", moving[0], "wall"), message, code="not_possible")
    if len(problem.load) != end.turned.size:
        message = f"{len(problem.load)} loads do not go on from {end.turned.size}"
        raise ModelError(("load",), message, code="wrong_length")
    turned = zip(problem.load, end.turned.tolist(), strict=True)
    return replace(problem, load=tuple(_turned(term, by) for term, by in turned))


def _turned(term: Load, by: float) -> Load:
    return replace(term, phase=term.phase + by) if isinstance(term, Harmonic) else term


def motions(problem: Problem) -> int:
    """Return how many motions a point takes: two where its outputs do not contain its end."""
    return 1 if shows_end(problem) else 2


def solve_each(
    problems: Sequence[Problem],
    before: Sequence[End | None],
    report: Callable[[], None] | None = None,
) -> Iterator[tuple[Outcome, End | None]]:
    """Yield the motions of some problems, or why there are none, and their ends.

    Parameters
    ----------
    problems : sequence of Problem
    before : sequence of End or None
        The ends from which they go on; None: their loads have not turned.
    report : callable, optional
        As of `solve_many`.
    """
    outcomes = list(solve_many(problems, report))
    bare = [
        place
        for place, (problem, outcome) in enumerate(zip(problems, outcomes, strict=True))
        if isinstance(outcome, Result) and not shows_end(problem)
    ]
    ends: list[Any] = list(outcomes)
    short = [to_end(problems[place]) for place in bare]
    for place, outcome in zip(bare, solve_many(short, report), strict=True):
        ends[place] = outcome
    for problem, last, outcome, end in zip(problems, before, outcomes, ends, strict=True):
        yield outcome, None if isinstance(end, SolverError) else _end(problem, last, end)


def shows_end(problem: Problem) -> bool:
    """Whether the outputs of a motion contain its whole state at the end."""
    dofs, times = problem.output_dofs, problem.times
    whole = dofs.size == problem.system.n and bool((dofs == np.arange(dofs.size)).all())
    return problem.outputs >= _STATE and whole and float(times[-1]) == problem.t_end


def to_end(problem: Problem) -> Problem:
    """Return the same motion, of which only the state at the end is asked for."""
    return replace(problem, t=np.array([problem.t_end]), dofs=None, outputs=_STATE)


def _end(problem: Problem, before: End | None, result: Result) -> End:
    assert result.x is not None
    assert result.v is not None
    rigid = problem.limiter is None and not problem.stopped
    x = on_stops(problem.system.constraints if rigid else (), result.x[-1])
    turned = np.zeros(len(problem.load)) if before is None else before.turned.copy()
    for place, term in enumerate(problem.load):
        if isinstance(term, Harmonic):
            angle = turned[place] + term.frequency * problem.t_end
            turned[place] = math.remainder(angle, 2.0 * math.pi)
    return End(State(x, result.v[-1].copy()), turned)


def on_stops(constraints: Sequence[Constraint], x: Floats) -> Floats:
    """Return displacements, shape (…, dof), that rounding has left beyond rigid stops, on them."""
    x = x.copy()
    for constraint in constraints:
        if np.all(within(constraint, np.moveaxis(x, -1, 0))):
            continue
        y = sum(weight * x[..., dof] for dof, weight in constraint.coordinate)
        off = np.clip(y, *walls(constraint)) - y
        size = sum(weight * weight for _, weight in constraint.coordinate)
        for dof, weight in constraint.coordinate:
            x[..., dof] += off * (weight / size)
    return x
