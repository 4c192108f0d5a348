"""Where motions with stops of finite stiffness go over into those with other switchings.

Motions change without a jump there, as the force of such a stop begins at zero, or its work does:

- a form reaches zero between two switchings (`touches`): a contact begins to be, or a force is lost
  and comes back, and two switchings more. That is located on the curve without them, which is
  regular there; of the other curve both are the same time, and its equations are not.
- the way between two switchings of one stop ends: the same, from the other side;
- switchings of different stops change their order;
- a released stop is regained at its wall: from there on it leaves it before.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import brentq

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.branches.bordered import better_bordered
from vibroimpact_solvers.branches.contacts import Contacts
from vibroimpact_solvers.branches.curve import Change, Place
from vibroimpact_solvers.branches.special import half_bracket
from vibroimpact_solvers.branches.touches import Peak, Touch, peak, touch_of, with_error
from vibroimpact_solvers.errors import ConvergenceError, SolverError
from vibroimpact_solvers.periodic_motions.stops.orbit_existence import Verdict, verdict
from vibroimpact_solvers.periodic_motions.stops.orbits import (
    Kind,
    Orbit,
    Switching,
    as_they_say,
    scenes_of,
)
from vibroimpact_solvers.results.branches import Type
from vibroimpact_solvers.results.impact_modes import Reason

_CLOSE: Final = 1e-13  # of a segment: how near a sign change is located
_HALVINGS: Final = 8  # of a segment, before the form is looked at
_LAST: Final = 34  # of one where the form tells nothing
_BORN: Final = 1e-3  # of the period, between two switchings that begin to be
_BRIEF: Final = 0.1  # of the contact of a free mass, the same
_LENGTHS: Final = 1.0, 0.3, 3.0, 0.1, 0.03, 10.0  # what is tried, relative to these
_SMALL: Final = 5.0  # of these, between two switchings that cease to be
_SHARE: Final = 0.6  # of what is left between them, that a step takes
_REACH: Final = 0.3  # how far a point may be where the form is zero
_FIRST: Final = 1e-5  # first step to there
_WORSE: Final = 30.0  # how much nearer to singular equations are that a branch leaves for others


class Changing(Contacts):
    """The curve of motions with one sequence of switchings, which knows where it ends."""

    # -- before a step --

    def before_step(self, place: Place, length: float) -> tuple[float, Change | None]:
        """Return how long the step from a point may be, and what happens within it if known."""
        if not self.m:
            return length, None
        better = better_bordered(self.motion(place.x), self.switchings[0].constraint)
        if better > _WORSE if self.plain else better < 1.0 / _WORSE:
            return length, Change(None, 0.0, None, self.twin(place.x, place.tangent))
        gaps = self.gaps(place.x)[: self.m]
        rates = np.array([self.gradient(k) @ place.tangent for k in range(self.m)])
        with np.errstate(divide="ignore"):
            ends = np.where(rates < 0.0, gaps / np.maximum(-rates, 1e-300), np.inf)
        k = int(np.argmin(ends))
        if not ends[k] < 1.5 * length:
            return length, None
        one, other = self.switchings[k], self.switchings[(k + 1) % len(self.switchings)]
        change = None
        if one.stop != other.stop:
            change = self._swapped(place, k, float(ends[k]))
        elif gaps[k] < _SMALL * self._brief(place.x, one):
            change = self._without(place, k)
        return (length, change) if change is not None else (_SHARE * float(ends[k]), None)

    def _brief(self, x: Floats, switching: Switching) -> float:
        """Return how far two switchings of a stop that begin to be are apart, phase."""
        cell = self.cell(self.value(x))
        stopped, a = cell.scenes.stopped, switching.constraint
        fast = math.sqrt(float(stopped.stiffness[a] * stopped.mobility[a])) / cell.scenes.scale
        free = math.pi * cell.Omega / fast if fast > 0.0 else math.inf
        return min(_BORN * self.period, _BRIEF * free)

    def _swapped(self, place: Place, k: int, step: float) -> Change | None:
        """Return the change of the order of two switchings of different stops."""
        row = self.gradient(k)
        guess = place.x + step * place.tangent
        guess -= row * (row @ guess + self._turn(k)) / (row @ row)
        x = self.onto(guess, row)
        if x is None or np.linalg.norm(x - place.x) > 4.0 * step + 1e-9:
            return None
        last = (k + 1) % len(self.switchings)
        switchings, phases = list(self.switchings), self.whole(x)
        tangent = self.tangent(self.slopes(x), place.tangent)
        along = np.tile(tangent[: self.m], 2 if self.symmetric else 1)
        before = self.before
        for one, other in self._both(k, last):
            if other == 0:  # the period begins between both
                before = scenes_of(before, self.switchings)[one - 1]
                before = scenes_of(before, self.switchings[:1])[-1]
            switchings[one], switchings[other] = switchings[other], switchings[one]
            along[[one, other]] = along[[other, one]]
        curve, start = self.like(before, tuple(switchings), phases, x)
        # Where both are one, the velocity at the first is what it was, or that after the other.
        ahead = np.zeros(start.size)
        ahead[: curve.m], ahead[-1] = along[: curve.m], tangent[-1]
        return Change(None, 0.0, None, (curve, start, ahead))

    def _turn(self, k: int) -> float:
        """Return what the way to the next switching is more than the difference of numbers."""
        half = 0.5 * self.period if self.symmetric else self.period
        return half if k % self.m == self.m - 1 else 0.0

    def _both(self, k: int, last: int) -> list[tuple[int, int]]:
        """Return two neighbouring switchings, and those that mirror them."""
        count = len(self.switchings)
        pairs = [(k, last)]
        if self.symmetric:
            pairs.append(((k + self.m) % count, (last + self.m) % count))
        return pairs

    def _without(self, place: Place, k: int) -> Change | None:
        """Return the change where two switchings of one stop cease to be."""
        count, last = len(self.switchings), (k + 1) % len(self.switchings)
        scenes, phases = scenes_of(self.before, self.switchings), self.whole(place.x)
        gone = {index for pair in self._both(k, last) for index in pair}
        kept = [(last + 1 + j) % count for j in range(count)]
        kept = [j for j in kept if j not in gone]
        if kept:
            late = np.array([phases[j] + (self.period if j < kept[0] else 0.0) for j in kept])
            before = scenes[kept[0] - 1]
        else:
            late, before = np.zeros(0), scenes[k - 1]
        names = tuple(self.switchings[j] for j in kept)
        curve, guess = self.like(before, names, late, place.x)
        x = curve.at_value(guess, float(guess[-1]))
        if x is None or np.abs(x - guess).max() > _SMALL * _BORN * self.period:
            return None
        middle = phases[k] + 0.5 * self.gaps(place.x)[k]
        try:
            return curve.left(x, self.switchings[k], middle, count)
        except (SolverError, ValueError, np.linalg.LinAlgError):
            return None

    def left(self, x: Floats, first: Switching, middle: float, count: int) -> Change | None:
        """Return where motions with two switchings more, of which the first is given, go over.

        Parameters
        ----------
        x : array
            A point of this curve near there.
        middle : float
            Phase between both.
        count : int
            Switchings of the other motions.
        """
        one = self.motion(x)
        starts = one.starts * one.cell.Omega if self.m else np.zeros(1)
        since = np.mod(middle - starts, self.period)
        part = int(np.argmin(since))
        late = float(since[part]) / one.cell.Omega
        stop = first.stop
        loaded = stop in one.scenes[part]
        wall = first.kind is Kind.WALL
        touch = Touch(part, *stop, wall=wall, sign=-1 if loaded else 1)
        tangent = self.tangent(self.slopes(x))
        begin = peak(one, touch, late)

        def point(s: float) -> Floats:
            there = self.onto(x + s * tangent, tangent)
            if there is None:
                raise ConvergenceError("no point")
            return there

        def at(s: float) -> float:
            there = self.motion(point(s))
            return peak(there, touch, begin.time).height

        slope = (at(_FIRST) - begin.height) / _FIRST
        reach = 2.0 * abs(begin.height / slope) + 1e-9
        while reach < _REACH and at(-reach) * at(reach) > 0.0:
            reach *= 3.0
        s = float(brentq(at, -reach, reach, xtol=_CLOSE * reach, rtol=4.0 * EPS))
        graze = point(s)
        if not -1e-12 <= graze[-1] <= 1.0 + 1e-12:
            return None
        error = self._error(
            lambda t: point((2.0 * t - 1.0) * reach), touch, begin.time, 0.5 * (s / reach + 1.0)
        )
        direction = -math.copysign(1.0, slope) * tangent
        return Change(None, error, Type.GRAZING, (self, graze, direction))

    # -- after a step --

    def after_step(self, before: Place, after: Place) -> Change | None:
        """Return what happens between two points; raise `SolverError` where that is too far."""
        one = self.motion(after.x)
        if self.m and float(one.lengths.min()) <= 0.0:
            raise ConvergenceError("switchings are not in their order")
        if as_they_say(one) is None:
            change = self._renamed(before, after)
            if change is None:
                raise ConvergenceError("stops do not switch as they should")
            return change
        decided = self.decided(after.x)
        if decided.reason == Reason.OK:
            return None
        return self._touched(_Segment(self, before, after))

    def decided(self, x: Floats) -> Verdict:
        """Return whether the motion at a point exists."""
        return verdict(*self.checked(x))

    def _touched(self, segment: _Segment) -> Change | None:
        """Return the change where a form reaches zero between two points."""
        low, high = 0.0, 1.0
        decided = segment.verdict(1.0)
        for _ in range(_HALVINGS):
            low, high, decided = segment.halved(low, high, decided)
        try:
            return self._located(segment, low, high, decided)
        except (SolverError, ValueError, np.linalg.LinAlgError):
            pass
        for _ in range(_LAST):
            low, high, decided = segment.halved(low, high, decided)
        x = segment.point(low)
        if not 0.0 <= x[-1] <= 1.0:
            return None
        error = abs(self.value(segment.point(high)) - self.value(x)) + self._rounding(x)
        return Change(self.place(x, segment.before.tangent), error, Type.END, None)

    def _located(
        self, segment: _Segment, low: float, high: float, decided: Verdict
    ) -> Change | None:
        one = self.motion(segment.point(high))
        touch, near = touch_of(one, decided)
        begin = peak(one, touch, near)

        def at(s: float) -> float:
            return peak(self.motion(segment.point(s)), touch, begin.time).height

        s = float(brentq(at, low, high, xtol=_CLOSE, rtol=4.0 * EPS))
        x = segment.point(s)
        if not 0.0 <= x[-1] <= 1.0:
            return None
        error = self._error(segment.point, touch, begin.time, s)
        place = self.place(x, segment.before.tangent)
        onward = self._onward(x, touch, peak(self.motion(x), touch, begin.time))
        return Change(place, error, Type.GRAZING if onward else Type.END, onward)

    def _error(
        self, point: Callable[[float], Floats], touch: Touch, near: float, s: float
    ) -> float:
        """Return the error of the parameter where an extremum is zero."""

        def sure(t: float, margin: float) -> float:
            x = point(t)
            each = with_error(self.checked(x), touch, peak(self.motion(x), touch, near))
            return 0.0 if abs(each.height) <= margin * each.error else each.height

        width = half_bracket(sure, s)
        here = self.value(point(s))
        ends = [self.value(point(min(max(t, 0.0), 1.0))) for t in (s - width, s + width)]
        return max(abs(each - here) for each in ends) + self._rounding(point(s))

    def _rounding(self, x: Floats) -> float:
        return 16.0 * EPS * (abs(self.value(x)) + abs(self.span))

    def _onward(self, x: Floats, touch: Touch, at: Peak) -> tuple[Changing, Floats, Floats] | None:
        """Return the curve with two switchings more, a point of it, and the direction to go."""
        one = self.motion(x)
        damped = one.cell.scenes.stop(touch.constraint, touch.side).damping > 0.0
        pair = touch.switchings(damped=damped)
        middle = (float(one.starts[touch.part]) + at.time) * one.cell.Omega
        room = 0.2 * min(at.time, float(one.lengths[touch.part]) - at.time) * one.cell.Omega
        for factor in _LENGTHS:
            apart = min(factor * self._brief(x, pair[0]), room)
            curve, guess = self._with(x, touch.part, pair, middle, apart)
            across = np.asarray(curve.gradient(0) / np.linalg.norm(curve.gradient(0)))
            point = curve.onto(guess, across)
            if point is None or np.linalg.norm(point - guess) > 20.0 * apart:
                continue
            try:
                whole = curve.motion(point)
                if as_they_say(whole) is None or float(whole.lengths.min()) <= 0.0:
                    continue
                if curve.decided(point).reason == Reason.OK:
                    return curve, point, across
            except SolverError:
                continue
        return None

    def _with(
        self, x: Floats, part: int, pair: tuple[Switching, Switching], middle: float, apart: float
    ) -> tuple[Changing, Floats]:
        """Return the curve with two switchings more, which come first, and a point near it."""
        marks = [(middle - 0.5 * apart, pair[0]), (middle + 0.5 * apart, pair[1])]
        if self.symmetric:
            marks += [
                (phase + 0.5 * self.period, Switching(each.kind, each.constraint, -each.side))
                for phase, each in marks
            ]
        phases = self.whole(x)
        for phase, each in zip(phases.tolist(), self.switchings, strict=True):
            late = phase - self.period * math.floor((phase - marks[0][0]) / self.period)
            marks.append((late, each))
        marks.sort(key=lambda mark: mark[0])
        before = scenes_of(self.before, self.switchings)[part] if self.m else self.before
        names = tuple(each for _, each in marks)
        return self.like(before, names, np.array([phase for phase, _ in marks]), x)

    # -- stops that are loaded again --

    def _renamed(self, before: Place, after: Place) -> Change | None:
        """Return the change where a stop is loaded again at its wall instead of beyond it."""
        segment = _Segment(self, before, after)
        for k, switching in enumerate(self.switchings[: self.m]):

            def seen(s: float, k: int = k) -> float:
                return _told(self.motion(segment.point(s)), k)

            try:
                if switching.kind is Kind.LOST or seen(1.0) > 0.0:
                    continue
                s = float(brentq(seen, 0.0, 1.0, xtol=_CLOSE, rtol=4.0 * EPS))
                return self._told_otherwise(segment.point(s), k, before)
            except (SolverError, ValueError, np.linalg.LinAlgError):
                return None
        return None

    def _told_otherwise(self, x: Floats, k: int, before: Place) -> Change | None:
        """Return the curve on which a switching has its other name, from a point on."""
        was = self.switchings[k]
        kind = Kind.REGAINED if was.kind is Kind.WALL else Kind.WALL
        switchings = list(self.switchings)
        for index in {k, *([k + self.m] if self.symmetric else [])}:
            switchings[index] = Switching(kind, *switchings[index].stop)
        curve, point = self.like(self.before, tuple(switchings), self.whole(x), x)
        row = np.eye(1, point.size, k)[0]
        for factor in _LENGTHS:
            late = factor * self._brief(x, was) * (1.0 if kind is Kind.WALL else -1.0)
            there = curve.onto(point + late * row, row)
            if there is None:
                continue
            one = curve.motion(there)
            if as_they_say(one) is None or float(one.lengths.min()) <= 0.0:
                continue
            if curve.decided(there).reason == Reason.OK:
                place = self.place(x, before.tangent)
                return Change(place, 0.0, None, (curve, there, math.copysign(1.0, late) * row))
        return None


def _told(one: Orbit, k: int) -> float:
    """Return what is positive where a switching is what its kind says."""
    switching, scenes = one.switchings[k], one.cell.scenes
    if switching.kind is Kind.WALL:
        return float(one.rates[k])
    side, stop = scenes.side(one.before[k]), scenes.stop(*switching.stop)
    z = one.ends[k - 1] + one.cell.at(one.before[k], float(one.times[k]))[0]
    y = float(z @ side.position[switching.constraint]) + float(side.level[switching.constraint])
    return switching.side * y - stop.wall


class _Segment(NamedTuple):
    """The way between two neighbouring points of a curve, by a number from 0 to 1."""

    curve: Changing
    before: Place
    after: Place

    def point(self, s: float) -> Floats:
        """Return a point; raise `ConvergenceError` where there is none."""
        first, last = self.before.x, self.after.x
        across = (last - first) / np.linalg.norm(last - first)
        x = self.curve.onto((1.0 - s) * first + s * last, across)
        if x is None:
            raise ConvergenceError("there is no point between two points of the curve")
        return x

    def verdict(self, s: float) -> Verdict:
        """Return whether the motion of a point exists."""
        return self.curve.decided(self.point(s))

    def halved(self, low: float, high: float, decided: Verdict) -> tuple[float, float, Verdict]:
        """Return the half in which motions cease to exist, and why they do at its end."""
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return low, high, decided
        here = self.verdict(middle)
        if here.reason == Reason.OK:
            return middle, high, decided
        return low, middle, here
