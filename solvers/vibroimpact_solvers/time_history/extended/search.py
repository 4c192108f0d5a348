"""The certified search for the first event of a step.

Doubles with a bound of their rounding tell the cells of the step in which a quantity certainly
stays below its wall. The others are halved in ball arithmetic until in each part either that is
certain, or the quantity rises all along and is above its wall in the end, which it then passes
exactly once, or its one maximum cannot be told from the wall: a touch.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import flint
import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.time_history.extended.free_motion import CELLS, Approach, Event
from vibroimpact_solvers.time_history.extended.precision import Real, undecided
from vibroimpact_solvers.time_history.extended.structure import Contact

WHOLE = 7.0 / 8.0
"""Part of a step that is searched; events may be close after it."""


def first_events(
    approaches: list[Approach], stop: Real, leaving: Mapping[Contact, int], now: Real
) -> tuple[list[Event], dict[Contact, int]]:
    """Return the first event and those that may be before it, and who has not left its wall yet.

    Parameters
    ----------
    approaches : list of Approach
    stop : arb
        End of the search, in steps.
    leaving : mapping
        Quantities that are at their walls at the beginning: the order of the first derivative
        that is not zero there, which is negative.
    now : arb
        The time, for the reason of a refusal.
    """
    nodes, slopes = _powers(max((a.coefficients.size for a in approaches), default=0))
    events: list[Event] = []
    left: dict[Contact, tuple[int, Approach]] = {}
    for approach in approaches:
        search = _Search(approach, stop, now)
        start: Real | None = flint.arb(0)
        order = leaving.get(approach.watch.contact)
        if order is not None and not approach.watch.force:
            start = search.away(order)
            if start is None:
                left[approach.watch.contact] = order, approach
                continue
        event = search.event(start, approach.clear_cells(nodes, slopes))
        if event is not None:
            events.append(event)
    latest = min((e.sigma + e.wide for e in events), key=float, default=stop)
    events = [e for e in events if not e.sigma - e.wide > latest]
    end = min((e.sigma - e.wide for e in events), key=float, default=stop)
    still = {c: order for c, (order, approach) in left.items() if not approach.room(end) > 0}
    return events, still


@lru_cache(maxsize=16)
def _powers(count: int) -> tuple[Floats, Floats]:
    """Return the powers of the centres of all cells, and their derivatives, (term, cell)."""
    centres = (np.arange(CELLS) + 0.5) / CELLS
    k = np.arange(count)[:, np.newaxis]
    return centres**k, k * centres ** np.maximum(k - 1, 0)


class _Search:
    """The search for the first event of one quantity."""

    def __init__(self, approach: Approach, stop: Real, now: Real) -> None:
        self.approach, self.stop, self.now = approach, stop, now
        self.tiny = flint.arb(2) ** (-flint.ctx.prec)
        what = "contact force vanishes" if approach.watch.force else "coordinate meets its wall"
        self.what = f"whether and when the {what} of constraint {approach.watch.contact[0]}"

    def event(self, start: Real, clear: list[bool]) -> Event | None:
        """Return the first event after the start of the search."""
        last = float(self.stop.mid())
        for cell in range(CELLS):
            if cell >= last * CELLS:
                break
            if clear[cell]:
                continue
            a, b = flint.arb(cell) / CELLS, flint.arb(min((cell + 1) / CELLS, 1.0))
            if last * CELLS < cell + 1:
                b = self.stop.mid()
            if start >= b:
                continue
            event = self._within(start if start > a else a, b)
            if event is not None:
                # One that comes after the end of the step is met in the next, or never.
                return event if event.sigma < self.stop or self.stop > WHOLE else None
        return None

    def away(self, order: int) -> Real | None:
        """Return a time until which a quantity has left its wall; None: that is after the step."""
        approach = self.approach
        derivative = (approach.slope, approach.bend, approach.jerk)[order - 1]
        bound = (approach.bend_bound, approach.jerk_bound, approach.snap_bound)[order - 1]
        time = flint.arb(1) / CELLS
        while time > self.tiny:
            short = not time < self.stop
            until = self.stop if short else time
            if derivative(until / 2) + bound * until / 2 < 0:
                if short:
                    return None
                if approach.room(time) > 0:
                    return time
            time = time / 2
        index = approach.watch.contact[0]
        raise undecided(f"whether the coordinate of constraint {index} leaves its wall", self.now)

    def _within(self, start: Real, end: Real) -> Event | None:
        approach, cells = self.approach, [(start, end)]
        while cells:
            look()
            a, b = cells.pop()
            half, m = (b - a) / 2, ((a + b) / 2).mid()
            room, slope = approach.room(m), approach.slope(m)
            reach = approach.bend_bound * half
            if room > abs(slope) * half + reach * half / 2:
                continue
            if slope > reach:
                at_end = approach.room(b)
                if at_end > 0:
                    continue
                if at_end < 0:
                    return self._impact(m, half)
                # The end of the cell may be just the time of the impact: a little longer.
                longer = half + 4 * abs(at_end).upper() / (slope - reach).lower()
                if slope > approach.bend_bound * longer and approach.room(m + longer) < 0:
                    return self._impact(m, longer)
            elif slope < -reach:
                if approach.room(a) > 0:
                    continue
            elif approach.bend(m) < -approach.jerk_bound * half:
                event, decided = self._maximum(m, half)
                if decided:
                    if event is None:
                        continue
                    return event
            if half < self.tiny:
                raise undecided(self.what, self.now)
            cut = (a + 0.46875 * (b - a)).mid()
            cells += [(cut, b), (a, cut)]
        return None

    def _impact(self, m: Real, half: Real) -> Event:
        """Return the impact of a quantity that passes its wall, rising all along."""
        approach, sigma = self.approach, m
        low, high = (m - half).mid(), (m + half).mid()
        for _ in range(100):
            room = approach.room(sigma).mid()
            if room > 0:
                low = sigma
            else:
                high = sigma
            after = (sigma + room / approach.slope(sigma).mid()).mid()
            if not low <= after <= high:
                after = ((low + high) / 2).mid()
            step = abs(after - sigma)
            sigma = after
            if step <= self.tiny:
                break
        least = (approach.slope(m) - approach.bend_bound * half).lower()
        tight = abs(approach.watch.wall - approach.poly(sigma)) + approach.tight
        wide = abs(approach.room(sigma)) / least
        return Event(approach.watch, sigma, (tight / least).upper(), wide.upper(), least)

    def _maximum(self, m: Real, half: Real) -> tuple[Event | None, bool]:
        """Return the touch at the maximum of a concave quantity, and whether that is decided."""
        approach, sigma = self.approach, m
        for _ in range(100):
            step = (approach.slope(sigma).mid() / approach.bend(sigma).mid()).mid()
            sigma = (sigma - step).mid()
            if not abs(sigma - m) < 2 * half or sigma < 0 or sigma > 1:
                return None, False
            if abs(step) <= self.tiny:
                break
        curve = (-approach.bend(m) - 2 * approach.jerk_bound * half).lower()
        if not curve > 0:
            return None, False
        slope = abs(approach.slope(sigma)).upper()
        least = approach.room(sigma) - slope * slope / (2 * curve)
        if least > 0:
            return None, True
        if approach.room(sigma) < 0:
            return None, False
        excess = -least.lower()
        # So long that even one that has struck is certainly away from its wall.
        wide = (16 * slope / curve + 4096 * (excess / curve).sqrt()).upper()
        if not abs(sigma - m) + wide < 2 * half or sigma - wide < 0:
            return None, False
        if not (approach.room(sigma - wide) > 0 and approach.room(sigma + wide) > 0):
            return None, False
        steep = abs(approach.bend(sigma)) + approach.jerk_bound * wide
        speed = (2 * steep * excess).sqrt().upper()
        return Event(approach.watch, sigma, wide, wide, flint.arb(0), speed), True
