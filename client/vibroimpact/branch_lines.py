"""The lines of branches in plots: they change at special points, not at the motions computed."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from vibroimpact.result_file import ResultFile
from vibroimpact.tables import Array

_OF_STABILITY: Final = ("fold", "flip", "torus", "symmetry")
_OF_EXISTENCE: Final = ("grazing", "end")
"""Special points at which motions change their stability, and where phantoms begin or end."""


@dataclass(slots=True)
class Line:
    """Motions of one state that follow one another on a branch.

    Parameters
    ----------
    state : str
        stable, neutral, unstable or phantom.
    count : int
        Impacts per period, or contacts with stops that yield.
    x, y : list of float
        Parameter, and height in the plot.
    """

    state: str
    count: int
    x: list[float] = field(default_factory=list)
    y: list[float] = field(default_factory=list)

    def add(self, x: float, y: float) -> None:
        """Add a point at the end."""
        self.x.append(float(x))
        self.y.append(float(y))


@dataclass(frozen=True, slots=True)
class Point:
    """A special point: its kind, its place in the plot, and the row of the motion before it."""

    kind: str
    x: float
    y: float
    row: int
    exists: bool


def struck(rows: Any) -> tuple[Array, str]:
    """Return how often stops are struck in a period, shape (solution,), and what that is called.

    Parameters
    ----------
    rows : Table
        Solutions of a result.
    """
    return (rows.contacts, "contact") if "contacts" in rows else (rows.impacts, "impact")


def counted(count: int, noun: str) -> str:
    """Return a number of impacts or contacts in words."""
    return f"no {noun}" if count == 0 else f"{count} {noun}{'s' if count > 1 else ''}"


def stability_of(rows: Any) -> Array:
    """Return whether each row of a table of periodic motions is stable, shape (solution,).

    Stable or unstable are those whose largest multiplier differs from 1 by more than its error;
    others are neutral. Where stability was not computed, all count as stable.

    Parameters
    ----------
    rows : Table
        Solutions of a result.
    """
    states = np.full(rows.impacts.size, "stable", dtype="<U8")
    if "stability" in rows:
        states[~(rows.stability < 1.0)] = "unstable"  # and where there is no number: grazing
        if "neutral" in rows:  # results of 0.2.0 do not tell
            states[rows.neutral == "yes"] = "neutral"
    return states


def special_points(result: ResultFile, height: Array) -> list[Point]:
    """Return the special points of all branches, as the result lists them.

    Parameters
    ----------
    result : ResultFile
        Of branches.
    height : array, shape (solution,)
        Heights of the motions in the plot.
    """
    points, placed = result.points, []
    for k, kind in enumerate(points.type):
        row, along = _place(result, k)
        after = min(row + 1, height.size - 1)
        y = height[row] + along * (height[after] - height[row]) if along else height[row]
        exists = bool(points.exists[k])
        placed.append(Point(str(kind), float(points.parameter[k]), float(y), row, exists))
    return placed


def _place(result: ResultFile, k: int) -> tuple[int, float]:
    """Return the row of the motion before a special point, and how far behind it the point lies."""
    points, rows = result.points, result.solution
    if "solution" in points:
        return int(points.solution[k]), float(points.along[k])
    # Results of 0.2.0 do not tell: the first segment that passes the parameter, or the nearest.
    mine = np.flatnonzero(rows.branch == points.branch[k])
    value, x = float(points.parameter[k]), rows.parameter[mine]
    passes = np.flatnonzero((x[:-1] - value) * (x[1:] - value) <= 0.0)
    if not passes.size:
        return int(mine[np.argmin(np.abs(x - value))]), 0.0
    first, step = int(passes[0]), float(x[passes[0] + 1] - x[passes[0]])
    return int(mine[first]), (value - float(x[first])) / step if step else 0.0


def branch_lines(
    result: ResultFile, stability: Array, exists: Array, height: Array
) -> Iterator[Line]:
    """Yield the lines of all branches; neighbours share the point at which the state changes.

    Parameters
    ----------
    result : ResultFile
        Of branches.
    stability : array of str, shape (solution,)
        From `stability_of`.
    exists : array of bool, shape (solution,)
    height : array, shape (solution,)
    """
    rows, on = result.solution, dict[int, list[Point]]()
    counts, _ = struck(rows)
    for point in special_points(result, height):
        on.setdefault(point.row, []).append(point)
    for branch in np.unique(rows.branch):
        mine = np.flatnonzero(rows.branch == branch)
        count, how, there = int(counts[mine[0]]), stability[mine[0]], exists[mine[0]]
        line = Line(_state(how, there), count)
        for row, after in itertools.pairwise(mine):
            line.add(rows.parameter[row], height[row])
            # Where nothing was located, the middle is as likely as any other place.
            x, y = (0.5 * (each[row] + each[after]) for each in (rows.parameter, height))
            points = on.get(int(row), [])
            changing = bool(
                how != stability[after] or there != exists[after] or count != counts[after]
            )
            here = points or [Point("", float(x), float(y), int(row), True)] * changing
            turning = _change(here, _OF_STABILITY, first=how != "unstable")
            passing = _change(here, _OF_EXISTENCE, first=there)
            touching = _change(here, ("grazing",), first=True)
            for point in here:
                line.add(point.x, point.y)
                how = stability[after] if point is turning else how
                there = exists[after] if point is passing else there
                count = int(counts[after]) if point is touching else count
                if (line.state, line.count) != (_state(how, there), count):
                    yield line
                    line = Line(_state(how, there), count, [point.x], [point.y])
        line.add(rows.parameter[mine[-1]], height[mine[-1]])
        yield line


def _state(stability: str, exists: bool) -> str:
    return str(stability) if exists else "phantom"


def _change(points: list[Point], kinds: tuple[str, ...], *, first: bool) -> Point | None:
    """Return the point of a segment at which what the kinds tell changes, if it does.

    Motions lose their stability at the first such point, and regain it at the last; so they do
    their existence. Where there is none, it is lost or regained at any other, as at a grazing.
    """
    some = [point for point in points if point.kind in kinds] or points
    return some[0 if first else -1] if some else None
