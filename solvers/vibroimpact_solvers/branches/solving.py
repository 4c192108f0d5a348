"""Solution of problems of branches by their plans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike
from scipy.optimize import brentq

from vibroimpact_solvers.arrays import EPS, Floats, along, nothing
from vibroimpact_solvers.branches.curve import Curve, Place
from vibroimpact_solvers.branches.problem import Problem
from vibroimpact_solvers.branches.special import Special, part_of_segment, special_points, tests
from vibroimpact_solvers.branches.switching import doubled, halves, outwards
from vibroimpact_solvers.errors import SolverError
from vibroimpact_solvers.meter import metered
from vibroimpact_solvers.periodic_motions import columns
from vibroimpact_solvers.periodic_motions.existence import verdicts
from vibroimpact_solvers.periodic_motions.solutions import Cells, without_impacts
from vibroimpact_solvers.plan import Plan, Tick
from vibroimpact_solvers.results.branches import Result, Type
from vibroimpact_solvers.results.impact_modes import Reason

_STATEMENT: Final = (
    "those of periodic motions at each point; special points: bracketed by signs of their test "
    "functions on both sides, at the errors of these"
)
_SEEDS = 9  # values of the parameter at which all solutions begin branches
_STARTS: Final = tuple(np.linspace(0.0, 1.0, _SEEDS).tolist())  # as parts of the range
_LINEAR = 101  # values at which the motion without impacts is listed
_SAME = 1e-6  # difference of phases and impulses of equal motions
_ASIDE = 1e-9  # of the range: how far beside a resonance the limits are checked


_COLUMNS: Final[Mapping[str, DTypeLike]] = {
    "branch": np.int64, "parameter": np.float64, "type": np.int64, "Omega": np.float64,
    "exists": np.bool_, "leads_to": np.int64, "solution": np.int64, "along": np.float64,
    "along_error": np.float64, "error": np.float64,
}  # fmt: skip
"""What is known of the special points, each a column."""
_Row = tuple[int, float, int, float, bool, int, int, float, float, float]


@dataclass(eq=False, slots=True)
class Branch:
    """A branch that was followed."""

    curve: Curve
    places: list[Place]
    points: list[Special] = field(default_factory=list)
    leads_to: dict[int, int] = field(default_factory=dict)


@metered
def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute what the plan lists.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        From `plan(problem)`.
    tick : callable, optional
        Called with (done, total) starts of branches; may raise `Cancelled`.
    """
    tick = tick or _no_tick
    branches: list[Branch] = []
    curve = Curve(problem, problem.at)
    seeds, total = [], 2 * _SEEDS + problem.switch
    for k, x in enumerate(_STARTS):
        tick(k, total)
        seeds.append(_seeds(curve, x))
    for k, some in enumerate(curve.scaled(seeds), start=_SEEDS):
        tick(k, total)
        for seed in some:
            turned = curve.turned(seed)
            if not any(_contains(branch, each) for branch in branches for each in turned):
                branch = _followed(curve, seed)
                if branch.places:
                    branches.append(branch)
    _switch(problem, branches, tick)
    return _result(problem, branches)


def join(problem: Problem, plan: Plan, results: Sequence[Result]) -> Result:
    """Return the result of the only piece."""
    return results[0]


def split(problem: Problem, plan: Plan, seconds: float) -> list[Problem]:
    """Return the problem itself: a branch begins where others were."""
    return [problem]


def _no_tick(done: int, total: int) -> None:
    """Report to nobody."""


def _seeds(curve: Curve, x: float) -> list[Floats]:
    try:
        return curve.start(x)
    except SolverError:
        return []


def _contains(branch: Branch, seed: Floats) -> bool:
    """Whether a motion is one of a branch."""
    m = branch.curve.m
    for place, after in zip(branch.places[:-1], branch.places[1:], strict=True):
        low, high = place.x[-1], after.x[-1]
        if not min(low, high) - 1e-9 <= seed[-1] <= max(low, high) + 1e-9:
            continue
        part = (seed[-1] - low) / (high - low) if high != low else 0.0
        near = (1.0 - part) * place.x + part * after.x
        apart = np.abs(near[m:-1] - seed[m:-1]).max()
        if apart > 10.0 * np.linalg.norm(after.x - place.x) + _SAME:
            continue
        point = branch.curve.at_value(near, float(seed[-1]))
        if point is None:
            continue
        late = branch.curve.late(point, seed)
        if max(np.abs(late).max(), np.abs(point[m:-1] - seed[m:-1]).max()) < _SAME:
            return True
    return False


def _followed(
    curve: Curve, seed: Floats, direction: Floats | None = None, one_way: bool = False
) -> Branch:
    """Return the branch through a point, in both directions, with its special points."""
    ahead = np.eye(1, seed.size, seed.size - 1)[0] if direction is None else direction
    finished = halves(curve) if one_way else _never
    places = curve.trace(seed, ahead, finished)
    begin = 0
    if places and not one_way and not (len(places) > 2 and curve.is_closed(places)):
        back = curve.trace(seed, -places[0].tangent, finished)
        begin = len(back) - 1
        places = [replace(p, tangent=-p.tangent) for p in reversed(back[1:])] + places
    branch = Branch(curve, places)
    if len(places) > 1:
        at = tests(curve, [p.x for p in places], [p.tangent for p in places])
        branch.points = special_points(curve, places, at)
        _stop(branch, begin)
    return branch


def _never(x: Floats) -> bool:
    return False


def _stop(branch: Branch, begin: int) -> None:
    """Cut a branch at the special points beside its beginning at which it shall end."""
    last = [p for p in branch.points if p.kind.name.lower() in branch.curve.problem.stop_at]
    before = [p for p in last if p.segment < begin]
    after = [p for p in last if p.segment >= begin]
    if after:
        end = after[0]
        branch.places = [*branch.places[: end.segment + 1], branch.curve.place(end.x, end.tangent)]
        branch.points = branch.points[: branch.points.index(end) + 1]
    if before:
        end = before[-1]
        branch.places = [branch.curve.place(end.x, end.tangent), *branch.places[end.segment + 1 :]]
        branch.points = [
            replace(p, segment=p.segment - end.segment)
            for p in branch.points[branch.points.index(end) :]
        ]


def _switch(problem: Problem, branches: list[Branch], tick: Tick) -> None:
    """Follow branches that begin at flips and losses of symmetry, in their order."""
    left, place = problem.switch, 0
    while left > 0 and place < len(branches):
        branch = branches[place]
        for number, point in enumerate(branch.points):
            if point.kind not in (Type.FLIP, Type.SYMMETRY) or not point.exists or left == 0:
                continue
            motions = doubled(branch.curve, point.kind)
            if motions is None:
                continue
            curve = Curve(problem, motions)
            begin = outwards(branch.curve, curve, point)
            if begin is None or any(
                _contains(other, begin[0]) for other in branches if other.curve.m == curve.m
            ):
                continue
            left -= 1
            tick(2 * _SEEDS + problem.switch - left, 2 * _SEEDS + problem.switch)
            followed = _followed(curve, *begin, one_way=True)
            if followed.places:
                branch.leads_to[number] = len(branches)
                branches.append(followed)
        place += 1


def _result(problem: Problem, branches: list[Branch]) -> Result:
    """Return the tables of all branches; the last is the motion without impacts."""
    parts, of, values, periods = [], [], [], []
    table: list[_Row] = []
    for number, branch in enumerate(branches):
        points = [place.x for place in branch.places]
        groups = [points] if problem.frequency else [[x] for x in points]
        curve = branch.curve
        parts += [
            columns.of(*curve.solutions(group), curve.largest(group)) for group in groups if group
        ]
        of += [number] * len(points)
        values += [branch.curve.value(x) for x in points]
        periods += [branch.curve.base.periods] * len(points)
        for place, point in enumerate(branch.points):
            value = branch.curve.value(point.x)
            Omega = float(branch.curve.motions(value).Omega[0])
            leads = branch.leads_to.get(place, -1)
            row = len(of) - len(points) + point.segment
            on = row, *part_of_segment(branch.places, point)
            kind = int(point.kind)
            table.append((number, value, kind, Omega, point.exists, leads, *on, point.error))
    if problem.at(problem.start).load and not _falls(problem):
        linear, touches = _linear(problem, len(branches), len(of))
        parts += linear
        grid = np.linspace(problem.start, problem.stop, _LINEAR).tolist()
        of, values = of + [len(branches)] * _LINEAR, values + grid
        periods += [problem.at(problem.start).periods] * _LINEAR
        table += touches
    if not parts:
        parts.append(_nothing(problem))
    fields = nothing(Result) | _stacked(parts)
    base = problem.at(problem.start)
    fields["Omega"], fields["error_statement"] = fields["solution_Omega"], _STATEMENT
    fields["dof"] = base.output_dofs if {"extremes", "waveform"} & base.outputs else None
    fields["tau"] = base.tau if "waveform" in base.outputs else None
    fields["solution_branch"] = np.array(of, dtype=np.int64)
    fields["solution_parameter"] = np.array(values, dtype=np.float64)
    fields["solution_periods"] = np.array(periods, dtype=np.int64)
    for k, (name, dtype) in enumerate(_COLUMNS.items()):
        fields[f"point_{name}"] = np.array([row[k] for row in table], dtype=dtype)
    fields["error_point_along"] = fields.pop("point_along_error")
    fields["error_point_parameter"] = fields["point_error"]
    return Result(**fields)


def _falls(problem: Problem) -> bool:
    """Whether a constant load drives a rigid body, which has no motion without impacts."""
    curve = Curve(problem, problem.at)
    return curve.laws(curve.motions(problem.start)).driven.balance.loaded


def _nothing(problem: Problem) -> columns.Columns:
    """Return the columns of no motions.

    Raises
    ------
    SolverError
        Where there are no equations at any of the values that were tried.
    """
    curve, failure = Curve(problem, problem.at), SolverError("no value")
    for x in _STARTS:
        try:
            return columns.of(*curve.nothing(x))
        except SolverError as error:
            failure = error
    raise failure


def _stacked(parts: Sequence[columns.Columns]) -> dict[str, Any]:
    """Return the columns of all points one after the other."""
    rows, impacts = 0, []
    for part in parts:
        impacts.append(part["impact_solution"] + rows)
        rows += part["solution_impacts"].size
    whole: dict[str, Any] = {
        name: np.concatenate([part[name] for part in parts])
        for name in along(Result, "solution", "impact")
        if name in parts[0]
    }
    whole["impact_solution"] = np.concatenate(impacts)
    whole["solution_frequency_index"] = np.arange(rows)
    return whole


def _linear(problem: Problem, number: int, first: int) -> tuple[list[columns.Columns], list[_Row]]:
    """Return the columns of the motion without impacts, and where it begins to touch a wall.

    It is the branch of that number, whose motions stand in the table from the row `first` on.
    """
    curve = Curve(problem, problem.at)

    def solved(values: Sequence[float]) -> Any:
        joint = curve.joint(np.array(values)) if problem.frequency else curve.motions(values[0])
        driven = curve.laws(joint).driven
        cells = Cells.of(driven, joint)
        whole = cells if cells.sign > 0.0 else cells.doubled()
        return joint, driven, whole, without_impacts(whole)

    def kept(value: float) -> float:
        reason = verdicts(*solved([value])).reason[0]
        if reason == Reason.SINGULAR:  # a resonance, which is one point of the range
            other = problem.start if value != problem.start else problem.stop
            reason = verdicts(*solved([value + _ASIDE * (other - value)])).reason[0]
        return 1.0 if reason == Reason.OK else -1.0

    grid = np.linspace(problem.start, problem.stop, _LINEAR).tolist()
    groups = [grid] if problem.frequency else [[value] for value in grid]
    parts = [columns.of(*solved(group)) for group in groups]
    reasons = np.concatenate([verdicts(*solved(group)).reason for group in groups])
    keeps = np.where(reasons == Reason.OK, 1.0, -1.0)
    for k in np.flatnonzero(reasons == Reason.SINGULAR):
        keeps[k] = kept(grid[k])
    touches = []
    for k in np.flatnonzero(np.diff(keeps)):
        value = float(brentq(kept, grid[k], grid[k + 1], xtol=1e-13, rtol=4.0 * EPS))
        error = 1e-12 * abs(grid[k + 1] - grid[k]) + 1e-13 + 16.0 * EPS * abs(value)
        Omega = float(problem.at(value).Omega[0])
        step = grid[k + 1] - grid[k]
        rounding = 4.0 * EPS * (abs(grid[k]) + abs(grid[k + 1])) / abs(step)
        on = first + int(k), (value - grid[k]) / step, error / abs(step) + rounding
        touches.append((number, value, int(Type.GRAZING), Omega, True, -1, *on, error))
    return parts, touches
