"""A branch from one of its points on, both ways, through all curves that it goes over into."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.branches.curve import Change, Curve, Place
from vibroimpact_solvers.branches.special import Special, part_of_segment, special_points
from vibroimpact_solvers.branches.switching import halves

_ARCS: Final = 400  # of a branch, at most
_LEAST: Final = 5  # points before a branch comes back
_SLANTED: Final = 1e-3  # least part of a tangent along the parameter that tells where a point is


@dataclass(eq=False, slots=True)
class Arc:
    """A part of a branch on one curve."""

    curve: Curve
    places: list[Place]
    points: list[Special] = field(default_factory=list)

    def goes_on(self, other: Arc) -> bool:
        """Whether this arc begins with the last motion of another one."""
        one, last = self.places[0].x, other.places[-1].x
        m = self.curve.m
        return m == other.curve.m and np.array_equal(
            np.append(one[:m], one[-1:]), np.append(last[:m], last[-1:])
        )

    def reversed(self) -> Arc:
        """Return the same from its end to its beginning."""
        places = [replace(p, tangent=-p.tangent) for p in reversed(self.places)]
        last = max(len(places) - 2, 0)
        points = [replace(p, segment=last - p.segment) for p in reversed(self.points)]
        return Arc(self.curve, places, points)

    def mark(self, change: Change, place: int) -> None:
        """Enter where motions go over, which is one of the points of the curve."""
        if change.kind is None:
            return
        at = self.places[place]
        steep = max(abs(float(at.tangent[-1])), _SLANTED)
        segment = 0 if place == 0 else max(len(self.places) - 2, 0)
        off = change.error / abs(self.curve.span) / steep
        special = Special(change.kind, at.x, at.tangent, segment, True, change.error, off)
        self.points.append(special)


@dataclass(eq=False, slots=True)
class Branch:
    """A branch that was followed; special points count from its first arc on."""

    arcs: list[Arc]
    leads_to: dict[int, int] = field(default_factory=dict)

    def points(self) -> list[tuple[Arc, Special]]:
        """Return the special points, with the arcs that they are on."""
        return [(arc, point) for arc in self.arcs for point in arc.points]

    def contains(self, curve: Curve, x: Floats) -> bool:
        """Whether a motion, a point of a curve, is one of the branch."""
        return any(arc.curve.passing(arc.places, curve, x) is not None for arc in self.arcs)


def followed(
    curve: Curve, seed: Floats, direction: Floats | None = None, *, one_way: bool = False
) -> Branch:
    """Return the branch through a point, in both directions, with its special points."""
    ahead = np.eye(1, seed.size, seed.size - 1)[0] if direction is None else direction
    arcs, closed = _onwards(curve, seed, ahead, halves if one_way else _endless)
    begin = 0, 0
    if arcs and not one_way and not closed:
        back, _ = _onwards(curve, seed, -arcs[0].places[0].tangent, _endless)
        if back:
            first, *others = back
            turned = [arc.reversed() for arc in reversed(others)]
            before = first.reversed()
            segments = len(before.places) - 1
            places = before.places[:-1] + arcs[0].places
            moved = [replace(p, segment=p.segment + segments) for p in arcs[0].points]
            arcs = [*turned, Arc(curve, places, before.points + moved), *arcs[1:]]
            begin = len(turned), segments
    for arc in arcs:
        if len(arc.places) > 1:
            arc.points = _in_order(arc, arc.points + special_points(arc.curve, arc.places))
    return Branch(_cut(arcs, *begin))


def _endless(curve: Curve) -> Callable[[Floats], bool]:
    return lambda x: False


def _in_order(arc: Arc, points: list[Special]) -> list[Special]:
    return sorted(points, key=lambda p: p.segment + part_of_segment(arc.places, p)[0])


def _onwards(
    curve: Curve, x: Floats, direction: Floats, until: Callable[[Curve], Callable[[Floats], bool]]
) -> tuple[list[Arc], bool]:
    """Return the arcs of a branch from a point on, and whether it has come back to that."""
    arcs, most, begun = list[Arc](), curve.problem.points, x
    first, pending, passed = curve, None, 0
    while most > 0 and len(arcs) < _ARCS:
        finished = until(curve)
        places, change = curve.trace(x, direction, finished, most)
        if not places:
            break
        arc = Arc(curve, places)
        most -= len(places)
        if pending is not None:
            arc.mark(pending, 0)
        arcs.append(arc)
        if len(arcs) == 1 and len(places) > 2 and curve.is_closed(places):
            return arcs, True
        back = curve.passing(places, first, begun) if passed > _LEAST else None
        passed += len(places)
        if back is not None:
            arc.places = places[: back + 2]
            return arcs, True
        if change is None:
            break
        if change.place is not None:
            arc.mark(change, -1)
        pending = change if change.place is None else None
        if change.onward is None:
            break
        curve, x, direction = change.onward
    return arcs, False


def _cut(arcs: list[Arc], begin: int, segment: int) -> list[Arc]:
    """Cut a branch at the special points beside its beginning at which it shall end."""
    if not arcs:
        return arcs
    stop_at = arcs[0].curve.problem.stop_at
    last = [
        (k, p) for k, arc in enumerate(arcs) for p in arc.points if p.kind.name.lower() in stop_at
    ]
    before = [each for each in last if (each[0], each[1].segment) < (begin, segment)]
    after = [each for each in last if (each[0], each[1].segment) >= (begin, segment)]
    if after:
        k, end = after[0]
        arc = arcs[k]
        places = [*arc.places[: end.segment + 1], arc.curve.place(end.x, end.tangent)]
        arcs = [*arcs[:k], Arc(arc.curve, places, arc.points[: arc.points.index(end) + 1])]
    if before:
        k, end = before[-1]
        arc = arcs[k]
        places = [arc.curve.place(end.x, end.tangent), *arc.places[end.segment + 1 :]]
        points = [
            replace(p, segment=p.segment - end.segment) for p in arc.points[arc.points.index(end) :]
        ]
        arcs = [Arc(arc.curve, places, points), *arcs[k + 1 :]]
    return arcs
