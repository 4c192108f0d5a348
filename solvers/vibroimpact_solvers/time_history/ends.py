"""Ends that a motion never reaches, refused when it is planned."""

from __future__ import annotations

import math
from typing import Final

from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.time_history.problem import EXACT, Problem, State

LONG: Final = 3600.0
"""Planned time, seconds, below which every end is reached."""
MOST_IMPACTS: Final = 10**11
"""Motions that are known to have more of them, which take days, are refused."""
_YEAR: Final = 3.156e7
_MOST_YEARS: Final = 100.0
"""Planned time from which on a motion that goes on is refused: plans are seldom ten times wrong."""


def check(problem: Problem, seconds: float) -> None:
    """Refuse a motion whose end is never reached, planned to take so many seconds.

    Raises
    ------
    PlanError
        Where one mass, which loses nothing, strikes more than `MOST_IMPACTS` times until then, or
        a motion that goes on to its end is planned to take more than a century.
    """
    _require_few_impacts(problem)
    _require_time(problem, seconds)


def _require_few_impacts(problem: Problem) -> None:
    least = _least_impacts(problem)
    if least > MOST_IMPACTS:
        message = f"at least {least:.2g} impacts until t_end = {problem.t_end!r}"
        message = f"{message} are more than {MOST_IMPACTS:.0e}: ask for less time"
        raise PlanError(message, ("t_end",))


def _least_impacts(problem: Problem) -> float:
    """Return a lower bound of the number of impacts, where it is known before the motion is.

    One mass that loses nothing strikes in each of its natural periods, if it swings far enough,
    and crosses the gap at its speed for ever, if nothing holds it.
    """
    system, state = problem.system, problem.initial
    alone = system.n == 1 and system.C is None and not problem.load and problem.limiter is None
    alone &= not problem.stopped
    lossless = alone and all(c.restitution == 1.0 for c in system.constraints)
    if not lossless or not isinstance(state, State) or problem.method != EXACT:
        return 0.0
    mass, stiffness = float(system.M.main_diagonal[0]), float(system.K.main_diagonal[0])
    force = 0.0 if system.force is None else float(system.force[0])
    x, speed = float(state.x[0]), abs(float(state.v[0]))
    walls = [
        side * wall / weight
        for c in system.constraints
        for _, weight in c.coordinate
        for side, wall in ((-1.0, c.lower), (1.0, c.upper))
        if wall is not None
    ]
    below = max((wall for wall in walls if wall <= x), default=-math.inf)
    above = min((wall for wall in walls if wall >= x), default=math.inf)
    if stiffness == 0.0 == force and speed > 0.0:
        return problem.t_end * speed / (above - below) - 1.0 if above > below else 0.0
    if stiffness <= 0.0 or not below < force / stiffness < above:
        return 0.0
    rest, frequency = force / stiffness, math.sqrt(stiffness / mass)
    swing = math.hypot(x - rest, speed / frequency) * (1.0 - 1e-12)
    strikes = rest + swing > above or rest - swing < below
    return problem.t_end * frequency / (2.0 * math.pi) - 1.0 if strikes else 0.0


def _require_time(problem: Problem, seconds: float) -> None:
    # Motions without a load that lose energy may come to rest: what is left of their time then
    # takes next to nothing, which no plan foresees.
    years = seconds / _YEAR
    if years > _MOST_YEARS and _goes_on(problem):
        message = (
            f"the motion until t_end = {problem.t_end!r} takes about {years:.2g} years to compute: "
            "ask for less time"
        )
        raise PlanError(message, ("t_end",))


def _goes_on(problem: Problem) -> bool:
    """Whether a motion does not come to rest by itself: it is driven, or a part loses nothing.

    Impacts with losses bring one mass to rest within its gap, though not all modes of many.
    """
    system = problem.system
    if problem.load:
        return True
    if system.C is not None:
        return False
    return system.n > 1 or not any(c.law.lossy for c in system.constraints)
