"""Time histories that start on periodic motions, and beside them.

Verdicts on existence and stability are about what a structure does, and it is asked what it does.
A motion that exists has its own impacts and no others; one that does not exist has others, or
starts beyond a limit. A history that starts a little beside a stable motion comes back to it, one
beside an unstable motion leaves it. Motions close to grazing, to a limit or to a loss of stability
are counted, not judged.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from flint import arb, arb_mat

from tests.reference.periodic import Motion
from tests.truth import periodic_motions as driven
from tests.truth import structures
from tests.truth.structures import Document
from tests.truth.verdicts import Case, Report
from vibroimpact_solvers import time_history
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.periodic_motions import Result, plan, solve

_AFTER = 0.31  # of a cell after its impact, at which histories start
_CLEAR = 1e-3  # of a gap, and of the mean speed, by which a motion keeps away from a change
_BESIDE = 1e-7  # of a motion's size: how far beside it histories start
_APART = 0.03  # of the largest multiplier from 1
_CONTRACTED, _GROWN = 1e-5, 1e5  # by the multipliers, when a history is over
_CAME_BACK, _LEFT = 1e-2, 1e2  # times the distance at the start
_POINTS = 2001


def case(rng: np.random.Generator) -> Case:
    """Return a random driven structure of at most 6 degrees of freedom, and a direction."""
    n = int(rng.integers(2, 7))
    kind = str(rng.choice(["dense", "diagonal", "chain", "mirror"]))
    made = driven.random_case(rng, kind, n)
    made.document["seed"] = int(rng.integers(2**31))
    return made


@dataclass(frozen=True)
class _Start:
    """A state on a periodic motion, its drive's phase there, and the time to its next impact."""

    x: np.ndarray
    v: np.ndarray
    phase: float
    cell: float
    next_impact: float


def check(case: Case, report: Report) -> None:
    """Compare the verdicts on the motions of a case with what histories do."""
    document = case.document
    problem = driven.problem(document)
    steps = plan(problem)
    report.work(steps)
    result = solve(problem, steps)
    report.phase("reference")
    for row in np.flatnonzero(result.solution_impacts > 0).tolist():
        Omega = document["Omega"][int(result.solution_frequency_index[row])]
        _check_row(document, driven.motion(document, Omega), result, row, report)


def _check_row(document: Document, exact: Motion, result: Result, row: int, report: Report) -> None:
    assert result.solution_exists is not None
    assert result.solution_stability is not None
    at = int(np.flatnonzero(result.impact_solution == row)[0])
    phase, p, velocity, state = exact.refined(float(result.impact_phase[at]))
    path = exact.path(phase, state, _POINTS)
    speed = float(np.abs(np.diff(path @ exact.impact.w)).sum()) / float(exact.cell.mid())
    pushes = -document["side"] * float(p.mid())
    margin = _margin(document, path)
    if abs(margin) < _CLEAR or abs(float(velocity.mid())) < _CLEAR * speed or pushes < 0.0:
        report.count("pulled by the wall" if pushes < 0.0 else "close to grazing or a limit")
        if pushes < 0.0 and result.solution_exists[row]:
            report.fail("exists", "although the wall pulls")
        return
    start = _start(exact, phase, state)
    exists = _keeps_its_impacts(document, exact, start)
    report.count("existence judged")
    if exists != bool(result.solution_exists[row]):
        report.fail("exists", f"{bool(result.solution_exists[row])}, the history says {exists}")
    if exists:
        largest = float(result.solution_stability[row])
        _check_stability(document, exact, start, largest, np.abs(path).max(), report)


def _margin(document: Document, path: np.ndarray) -> float:
    """Return by what part of a gap a motion keeps its limits, apart from its own impacts."""
    both = (1, -1) if document["symmetric"] else (1,)
    margin = math.inf
    for index, limiter in enumerate(document["constraints"]):
        y = path @ structures.row(document, limiter)
        for side, wall in ((1, limiter["upper"]), (-1, limiter["lower"])):
            if wall is None:
                continue
            for mirror in both:
                left = wall - mirror * side * y
                if index == 0 and mirror * side == document["side"]:
                    left = _away_from_ends(left, wall, start=True, end=not document["symmetric"])
                if index == 0 and document["symmetric"] and mirror * side != document["side"]:
                    left = _away_from_ends(left, wall, start=False, end=True)
                margin = min(margin, float(left.min(initial=math.inf)) / wall)
    return margin


def _away_from_ends(left: np.ndarray, wall: float, *, start: bool, end: bool) -> np.ndarray:
    """Return distances from a wall without those on the way from an impact and to one."""
    clear = np.flatnonzero(np.abs(left) > 2.0 * _CLEAR * wall)
    if clear.size == 0:
        return left[:0]
    first, last = int(clear[0]) if start else 0, int(clear[-1]) + 1 if end else left.size
    return left[first:last]


def _start(exact: Motion, phase: arb, state: arb_mat) -> _Start:
    """Return the state some time after the impact."""
    s, n = exact.s, exact.s.n
    time = exact.cell * arb(_AFTER)
    rows = [[state[i, 0]] for i in range(2 * n)] + [[v] for v in s.load_state(phase)]
    moved = s.flow(time) * arb_mat(rows)
    values = np.array([float(moved[i, 0].mid()) for i in range(2 * n)])
    later, cell = float((phase + time * arb(s.Omega)).mid()), float(exact.cell.mid())
    return _Start(values[:n], values[n:], later, cell, (1.0 - _AFTER) * cell)


def _history(
    document: Document, exact: Motion, start: _Start, end: float, times: list[float]
) -> time_history.Result:
    """Return the history from a state for some time."""
    load = tuple(
        time_history.Harmonic(dof, amplitude, order * exact.s.Omega, phase + order * start.phase)
        for dof, amplitude, order, phase in document["loads"]
    )
    state = time_history.State(start.x, start.v)
    problem = time_history.Problem(
        structures.system(document), state, end, t=np.array(times),
        outputs=frozenset({"x", "v", "impacts"}), load=load, estimate=False,
    )  # fmt: skip
    return time_history.solve(problem, time_history.plan(problem))


def _keeps_its_impacts(document: Document, exact: Motion, start: _Start) -> bool:
    """Return whether the history of one cell has the motion's own impact, and no other."""
    try:
        history = _history(document, exact, start, start.cell, [start.cell])
    except ModelError as error:
        if error.code != "outside_limits":
            raise
        return False  # it would start beyond a limit
    assert history.impact_time is not None
    assert history.impact_constraint is not None
    assert history.impact_side is not None
    side = document["side"] * (-1 if document["symmetric"] else 1)
    if history.impact_time.size != 1:
        return False
    own = history.impact_constraint[0] == 0 and history.impact_side[0] == side
    return bool(own and abs(history.impact_time[0] - start.next_impact) < 1e-6 * start.cell)


def _check_stability(
    document: Document, exact: Motion, start: _Start, largest: float, size: float, report: Report
) -> None:
    """Start beside a motion, and see whether the history comes back."""
    if not math.isfinite(largest) or abs(largest - 1.0) < _APART:
        report.count("close to a loss of stability")
        return
    cells = math.ceil(math.log(_CONTRACTED if largest < 1.0 else _GROWN) / math.log(largest))
    # Multipliers are those of the period, which has two cells where the motion is symmetric.
    period = start.cell * (2.0 if document["symmetric"] else 1.0)
    cells = max(cells, 5)  # little of the direction may be along what grows
    times = [period * k for k in range(cells + 1)]
    direction = np.random.default_rng(document["seed"]).standard_normal(2 * exact.s.n)
    direction /= np.linalg.norm(direction)
    moved = _BESIDE * size * direction
    n = exact.s.n
    fastest = exact.s.Omega
    beside = _Start(
        start.x + moved[:n], start.v + fastest * moved[n:], start.phase, start.cell, math.nan
    )
    history = _history(document, exact, beside, times[-1], times)
    assert history.x is not None
    assert history.v is not None
    apart = np.hypot(
        np.linalg.norm(history.x - start.x, axis=1),
        np.linalg.norm(history.v - start.v, axis=1) / fastest,
    ) / (_BESIDE * size)
    report.count("stability judged: " + ("stable" if largest < 1.0 else "unstable"))
    if largest < 1.0 and not apart[-1] < _CAME_BACK:
        report.fail("stable", f"multiplier {largest:.4g}, {apart[-1]:.3g} times as far at the end")
    if largest > 1.0 and not apart.max() > _LEFT:
        report.fail("unstable", f"multiplier {largest:.4g}, only {apart.max():.3g} times as far")
