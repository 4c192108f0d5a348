"""Solution of problems of branches by their plans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike

from vibroimpact_solvers.arrays import along, nothing
from vibroimpact_solvers.branches import contacts, linear_response, seeds
from vibroimpact_solvers.branches.following import Branch, followed
from vibroimpact_solvers.branches.impacts import Impacts
from vibroimpact_solvers.branches.problem import Problem
from vibroimpact_solvers.branches.special import part_of_segment
from vibroimpact_solvers.branches.structures import Structures
from vibroimpact_solvers.branches.switching import outwards
from vibroimpact_solvers.errors import SolverError
from vibroimpact_solvers.meter import metered
from vibroimpact_solvers.periodic_motions import columns
from vibroimpact_solvers.plan import Plan, Tick
from vibroimpact_solvers.results.branches import Result, Type

_STATEMENT: Final = (
    "those of periodic motions at each point; special points: bracketed by signs of their test "
    "functions on both sides, at the errors of these"
)
_SEEDS = 9  # values of the parameter at which all solutions begin branches
_STARTS: Final = tuple(np.linspace(0.0, 1.0, _SEEDS).tolist())  # as parts of the range


_COLUMNS: Final[Mapping[str, DTypeLike]] = {
    "branch": np.int64, "parameter": np.float64, "type": np.int64, "Omega": np.float64,
    "exists": np.bool_, "leads_to": np.int64, "solution": np.int64, "along": np.float64,
    "along_error": np.float64, "error": np.float64,
}  # fmt: skip
"""What is known of the special points, each a column."""
_Row = tuple[int, float, int, float, bool, int, int, float, float, float]


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
    total = 2 * _SEEDS + problem.switch
    if problem.stopped:
        begun = seeds.with_contacts(problem, _STARTS, tick, total, Structures(problem))
    else:
        begun = seeds.with_impacts(problem, _STARTS, tick, total)
    for k, (curve, seed) in enumerate(begun):
        tick(_SEEDS + k * _SEEDS // len(begun), total)
        if not any(branch.contains(curve, seed) for branch in branches):
            branch = followed(curve, seed)
            if branch.arcs:
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


def _switch(problem: Problem, branches: list[Branch], tick: Tick) -> None:
    """Follow branches that begin at flips and losses of symmetry, in their order."""
    left, place = problem.switch, 0
    while left > 0 and place < len(branches):
        branch = branches[place]
        for number, (arc, point) in enumerate(branch.points()):
            if point.kind not in (Type.FLIP, Type.SYMMETRY) or not point.exists or left == 0:
                continue
            repeated = arc.curve.repeated(point.kind, point.x, point.tangent)
            begin = None if repeated is None else outwards(*repeated)
            if repeated is None or begin is None:
                continue
            curve = repeated[0]
            if any(other.contains(curve, begin[0]) for other in branches):
                continue
            left -= 1
            tick(2 * _SEEDS + problem.switch - left, 2 * _SEEDS + problem.switch)
            branched = followed(curve, *begin, one_way=True)
            if branched.arcs:
                branch.leads_to[number] = len(branches)
                branches.append(branched)
        place += 1


def _result(problem: Problem, branches: list[Branch]) -> Result:
    """Return the tables of all branches; with impacts the last is the motion without them."""
    parts: list[columns.Columns] = []
    of, values, periods = list[int](), list[float](), list[int]()
    table: list[_Row] = []
    for number, branch in enumerate(branches):
        count, last = 0, None
        for arc in branch.arcs:
            curve, points = arc.curve, [place.x for place in arc.places]
            begin = len(of)
            if last is not None and arc.goes_on(last):  # the motion is listed already
                begin, points = begin - 1, points[1:]
            last = arc
            for point in arc.points:
                value, kind = curve.value(point.x), int(point.kind)
                Omega = float(curve.motions(value).Omega[0])
                on = begin + point.segment, *part_of_segment(arc.places, point)
                leads = branch.leads_to.get(count, -1)
                table.append((number, value, kind, Omega, point.exists, leads, *on, point.error))
                count += 1
            parts += curve.columns(points) if points else []
            of += [number] * len(points)
            values += [curve.value(x) for x in points]
            periods += [curve.base.periods] * len(points)
    if not problem.stopped and linear_response.exists(problem):
        own, linear, touches = linear_response.listed(problem)
        for touch in touches:
            Omega = float(problem.at(touch.value).Omega[0])
            on = len(of) + touch.row, touch.along, touch.along_error
            kind = int(Type.GRAZING)
            table.append((len(branches), touch.value, kind, Omega, True, -1, *on, touch.error))
        parts += linear
        of, values = of + [len(branches)] * own.size, values + own.tolist()
        periods += [problem.at(problem.start).periods] * own.size
    return _tables(problem, parts or [_nothing(problem)], of, values, periods, table)


def _tables(
    problem: Problem, parts: list[columns.Columns], of: list[int], values: list[float],
    periods: list[int], table: list[_Row],
) -> Result:  # fmt: skip
    """Return the result of all parts one after the other."""
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


def _nothing(problem: Problem) -> columns.Columns:
    """Return the columns of no motions.

    Raises
    ------
    SolverError
        Where there are no equations at any of the values that were tried.
    """
    curve, failure = Impacts(problem, problem.at), SolverError("no value")
    for x in _STARTS:
        try:
            if problem.stopped:
                return contacts.nothing(problem, Structures(problem), x)
            return columns.of(*curve.nothing(x))
        except SolverError as error:
            failure = error
    raise failure


def _stacked(parts: Sequence[columns.Columns]) -> dict[str, Any]:
    """Return the columns of all points one after the other."""
    rows, owners = 0, dict[str, list[Any]]()
    for part in parts:
        for table in ("impact", "contact"):
            if f"{table}_solution" in part:
                owners.setdefault(f"{table}_solution", []).append(part[f"{table}_solution"] + rows)
        rows += part["solution_impacts"].size
    whole: dict[str, Any] = {
        name: np.concatenate([part[name] for part in parts])
        for name in along(Result, "solution", "impact", "contact")
        if name in parts[0]
    }
    whole |= {name: np.concatenate(each) for name, each in owners.items()}
    whole["solution_frequency_index"] = np.arange(rows)
    return whole
