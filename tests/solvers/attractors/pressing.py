"""Driven structures with stops that have a stiffness and a damping, by scipy's integrator.

A reference that shares nothing with the solver: ``M x'' + C x' + K x = f cos(Omega t + phase)`` and
at each stop ``max(0, k d + c d')`` while the coordinate is d > 0 beyond its wall. It is integrated
from switching to switching, which are events.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

OPEN, LOADED, RELEASED = range(3)
_LATE = 1e-9  # of a period: after an event, what was zero is not looked at for so long


@dataclass(frozen=True)
class Stop:
    """A coordinate, its wall at ``side y = wall``, and what is behind it."""

    row: Any
    wall: float
    stiffness: float
    damping: float = 0.0
    side: int = 1


@dataclass
class Pressing:
    """The structure; its load is a sum of ``f cos(q Omega t + phase)``, terms (f, q, phase)."""

    M: Any
    C: Any
    K: Any
    stops: tuple[Stop, ...]
    load: tuple[tuple[Any, int, float], ...]
    omega: float
    contacts: list[tuple[float, float, int]] = field(default_factory=list)
    """Begins, ends and stops of the contacts of the last motion."""

    @property
    def period(self) -> float:
        """Period of the drive."""
        return 2.0 * math.pi / self.omega

    def _dent(self, a: int, z: Any) -> float:
        n = len(self.M)
        stop = self.stops[a]
        return float(stop.side * (stop.row @ z[:n]) - stop.wall)

    def _force(self, a: int, z: Any) -> float:
        n = len(self.M)
        stop = self.stops[a]
        rate = float(stop.side * (stop.row @ z[n:]))
        return stop.stiffness * self._dent(a, z) + stop.damping * rate

    def _rate(self, t: float, z: Any, states: list[int]) -> Any:
        n = len(self.M)
        push = -self.K @ z[:n] - self.C @ z[n:]
        for f, q, phase in self.load:
            push = push + f * math.cos(q * self.omega * t + phase)
        for a, state in enumerate(states):
            if state == LOADED:
                push = push - self.stops[a].side * self._force(a, z) * self.stops[a].row
        return np.concatenate([z[n:], np.linalg.solve(self.M, push)])

    def _watched(self, states: list[int]) -> list[tuple[int, str, float]]:
        """Return what is positive now: the stop, what of it, and a sign."""
        found = []
        for a, state in enumerate(states):
            if state == OPEN:
                found.append((a, "dent", -1.0))
            elif state == LOADED:
                found.append((a, "force", 1.0))
            else:
                found += [(a, "dent", 1.0), (a, "force", -1.0)]
        return found

    def _initial(self, a: int, z: Any) -> int:
        if self._dent(a, z) <= 0.0:
            return OPEN
        return LOADED if self._force(a, z) >= 0.0 else RELEASED

    def _event(self, a: int, what: str, sign: float, since: float | None) -> Any:
        """Return what is zero at an event, which is not looked at before a time."""

        def event(t: float, z: Any) -> float:
            if since is not None and t < since:
                return 1.0
            return sign * (self._dent(a, z) if what == "dent" else self._force(a, z))

        event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
        return event

    def after(self, x: Any, v: Any, periods: int, start: int = 0) -> tuple[Any, Any]:
        """Return the state after periods of the drive from its phase 0."""
        z, n = np.concatenate([x, v]), len(self.M)
        t, end = start * self.period, (start + periods) * self.period
        states = [self._initial(a, z) for a in range(len(self.stops))]
        begun = {a: t for a, state in enumerate(states) if state == LOADED}
        self.contacts, left = [], (-1, "")
        since = -1.0
        while t < end:
            events = [
                self._event(*each, None if each[:2] != left else since + _LATE * self.period)
                for each in self._watched(states)
            ]
            now = list(states)
            motion = solve_ivp(
                lambda s, y, now=now: self._rate(s, y, now), (t, end), z, "DOP853", rtol=1e-12,
                atol=1e-13, events=events, max_step=self.period / 100.0,
            )  # fmt: skip
            t, z = float(motion.t[-1]), motion.y[:, -1]
            if motion.status != 1:
                break
            hit = next(k for k, times in enumerate(motion.t_events) if times.size)
            a, what, _ = self._watched(states)[hit]
            left, since = (a, what), t
            if states[a] == OPEN:
                states[a], begun[a] = LOADED, t
                left = (a, "force") if self.stops[a].damping == 0.0 else left
            elif states[a] == LOADED:
                self.contacts.append((begun[a], t, a))
                states[a] = RELEASED if self.stops[a].damping > 0.0 else OPEN
                left = (a, "dent") if self.stops[a].damping == 0.0 else left
            else:
                states[a] = LOADED if what == "force" else OPEN
                begun[a] = t
        return z[:n], z[n:]
