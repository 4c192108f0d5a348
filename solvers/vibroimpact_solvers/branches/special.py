"""Special points of a curve: where a test function changes sign between two of its points.

- fold: the parameter along the tangent;
- flip: ``det(1 + Z)`` of the linearised motion Z over the period; in the half period of a symmetric
  motion, whose mirror image is the next one, the same determinant tells the loss of symmetry;
- symmetry of other motions: ``det(1 - Z)`` where there is no fold, without load that of
  `Impacts.crossing`;
- torus: the largest modulus less 1 and less its error, where the multiplier is complex;
- grazing: the impulses; end: the verdict about the limits in between.

Stops of finite stiffness are touched, and left, where a curve goes over into another (`Change`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.branches.curve import Curve, Place, Tests
from vibroimpact_solvers.results.branches import Type

_CLOSE = 1e-13  # of a segment: how near a sign change is located
_BRACKET = 1e-9  # and half of the bracket that gives its error
_UPRIGHT = 1e-9  # part of a tangent along the parameter that is rounding


@dataclass(frozen=True, eq=False, slots=True)
class Special:
    """A special point: its type, what it lies on, and the segment's number.

    exists tells whether motions on one side of it are admissible; error is the absolute one of the
    parameter, and x_error that of x along the segment.
    """

    kind: Type
    x: Floats
    tangent: Floats
    segment: int
    exists: bool
    error: float
    x_error: float


def special_points(curve: Curve, places: list[Place]) -> list[Special]:
    """Return the special points between the points of a curve, in their order."""
    at = curve.tests([p.x for p in places], [p.tangent for p in places])
    turning = np.array([p.tangent[-1] for p in places])
    turning[np.abs(turning) < _UPRIGHT] = 0.0
    points = []
    for k in range(len(places) - 1):
        for kind, which in _changes(curve, turning, at, k):
            exists = bool(at.admissible()[k : k + 2].any())
            point = _located(curve, places, k, kind, which)
            if point is not None:
                points.append(replace(point, exists=exists))
    order = np.argsort([p.segment + part_of_segment(places, p)[0] for p in points], kind="stable")
    return [points[k] for k in order]


def part_of_segment(places: list[Place], point: Special) -> tuple[float, float]:
    """Return how far along its segment a point is, 0 to 1, and the error of that."""
    first, last = places[point.segment].x, places[min(point.segment + 1, len(places) - 1)].x
    way = last - first
    length = float(np.linalg.norm(way))
    if length == 0.0:
        return 0.0, 1.0
    part = float(way @ (point.x - first)) / length**2
    rounding = 8.0 * EPS * float(np.abs(first).max() + np.abs(last).max())
    return min(max(part, 0.0), 1.0), min((point.x_error + rounding) / length, 1.0)


def _changes(curve: Curve, turning: Floats, at: Tests, k: int) -> list[tuple[Type, int]]:
    """Return the types of special points on a segment; for impulses, which one."""

    def changes(values: Floats) -> bool:
        return bool(values[k] * values[k + 1] < 0.0)

    kinds = []
    turns = changes(turning)
    if turns:
        kinds.append((Type.FOLD, 0))
    zeros = [j for j in range(at.impulses.shape[1]) if changes(at.impulses[:, j])]
    kinds += [(Type.GRAZING, j) for j in zeros]
    if zeros:  # where multipliers are infinite
        return kinds
    if changes(at.plus):
        kinds.append((Type.SYMMETRY if curve.base.symmetric else Type.FLIP, 0))
    if changes(at.minus) and not turns:
        kinds.append((Type.SYMMETRY, 0))
    before, after = at.leaves[k : k + 2]
    if before != after and at.turned[k + int(after)] > 0.0:
        kinds.append((Type.TORUS, 0))
    pushes = bool((at.impulses[k : k + 2] > 0.0).all())
    if changes(at.kept) and pushes:
        kinds.append((Type.END, 0))
    return kinds


def _located(curve: Curve, places: list[Place], k: int, kind: Type, which: int) -> Special | None:
    """Return the point of a segment at which a test function changes sign."""
    own = curve
    curve, first, last = own.regular(places[k].x, places[k + 1].x)
    length = float(np.linalg.norm(last - first))
    across = (last - first) / length

    def point(s: float) -> Floats:
        x = curve.onto((1.0 - s) * first + s * last, across)
        if x is None:
            raise ValueError(s)
        return x

    def value(s: float, margin: float = 1.0) -> float:
        x = point(s)
        if kind is Type.FOLD:
            return float(curve.tangent(curve.slopes(x), across)[-1])
        return curve.value_of(kind, which, x, across, margin)

    try:
        s = float(brentq(value, 0.0, 1.0, xtol=_CLOSE, rtol=4.0 * EPS))
        x = point(s)
        width = half_bracket(value, s)
        near = [curve.value(point(min(max(t, 0.0), 1.0))) for t in (s - width, s + width)]
        tangent = curve.tangent(curve.slopes(x), across)
    except (ValueError, np.linalg.LinAlgError):
        return None
    here = curve.value(x)
    error = max(abs(each - here) for each in near) + 16.0 * EPS * (abs(here) + abs(curve.span))
    tangent = own.of_regular(tangent)
    tangent = tangent / np.linalg.norm(tangent)
    return Special(kind, own.of_regular(x), tangent, k, True, error, width * length)


def half_bracket(value: Callable[[float, float], float], s: float) -> float:
    """Return how far to both sides a test function has its two signs, with twice its errors.

    A multiplier that leaves the circle like a straight line, or a root, has left it within that.
    """
    width = _BRACKET
    while width < 1e-3:
        low, high = value(max(s - width, 0.0), 2.0), value(min(s + width, 1.0), 2.0)
        if low * high < 0.0:
            break
        width *= 10.0
    return width
