"""Integration of slow flows up to grazing, where their equations are singular.

At gamma = pi/2 the rate of gamma is infinite, as tan(gamma). In the time s with dt = cos(gamma) ds
the equations are regular and gamma passes pi/2 at a finite rate; t is one of the unknowns then.
Equations that are regular anyway take s = t.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # its parts load as they are used: they are slow to load

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError

Rates = Callable[[float, float, Floats], Sequence[float]]
"""Rates in s of (gamma, phi, ..., t) at tau, e and the state."""

_RELATIVE, _ABSOLUTE = 1e-11, 1e-14


@dataclass(frozen=True, eq=False, slots=True)
class Flow:
    """A solution as pieces, each smooth."""

    starts: Floats  # times at which they begin, (piece,)
    pieces: list[Any]  # the dense solution of each; t is the last component
    end: float  # time at which gamma = pi/2, or inf
    last: Floats  # state at that time, or the last one computed

    def at(self, t: Floats) -> Floats:
        """Return the states at times before the end, shape (time, unknown)."""
        states = np.empty((t.size, self.last.size))
        which = np.maximum(np.searchsorted(self.starts, t, side="right") - 1, 0)
        for index in np.unique(which):
            here = which == index
            states[here] = self._piece(index, t[here])
        return states

    def _piece(self, index: int, t: Floats) -> Floats:
        """Return the states at times in one piece: s by regula falsi, as t grows with s."""
        solution = self.pieces[index]
        nodes = solution.ts
        times = solution(nodes)[-1]
        step = np.clip(np.searchsorted(times, t), 1, nodes.size - 1)
        low, high = nodes[step - 1], nodes[step]
        below, above = times[step - 1] - t, times[step] - t
        side = np.zeros(t.size)
        for _ in range(60):
            s = low - below * (high - low) / np.where(above > below, above - below, 1.0)
            miss = solution(s)[-1] - t
            if (np.abs(miss) <= 2e-15 * np.maximum(1.0, t)).all():
                break
            early = np.where(miss < 0.0, -1.0, 1.0)
            # The Illinois rule: the value of an end that is kept twice is halved.
            stays = np.where(early == side, 0.5, 1.0)
            below, above = (
                np.where(early < 0.0, miss, stays * below),
                np.where(early < 0.0, stays * above, miss),
            )
            low, high = np.where(early < 0.0, s, low), np.where(early < 0.0, high, s)
            side = early
        state: Floats = solution(s)[:-1].T
        return state


def integrate(rates: Rates, state: Floats, until: float, *, jumps_at_impacts: bool) -> Flow:
    """Integrate from a state (gamma, phi, ...) at t = 0 to gamma = pi/2 or `until`.

    Where the rates jump at impacts each interval between them is a piece of its own.
    """
    y = np.append(np.asarray(state, dtype=np.float64), 0.0)
    starts, pieces = [], []
    grazed = False
    while not grazed and y[-1] < until:
        # The number of the interval that begins: at an impact, the one after it.
        interval = math.floor(0.5 * (y[1] + 1.0) + 1e-9)
        run = scipy.integrate.solve_ivp(
            _right(rates, interval if jumps_at_impacts else None),
            (0.0, 1e6 + 1e3 * until),
            y,
            "DOP853",
            rtol=_RELATIVE,
            atol=_ABSOLUTE,
            dense_output=True,
            events=_events(until, 2.0 * interval + 1.0 if jumps_at_impacts else math.inf),
        )
        if run.status != 1:
            raise ConvergenceError(f"the slow flow cannot be integrated: {run.message}")
        starts.append(float(y[-1]))
        pieces.append(run.sol)
        events = run.t_events or []
        grazed = events[0].size > 0
        y = run.y[:, -1]
        if jumps_at_impacts and events[2].size > 0:
            y[1] = 2.0 * interval + 1.0
    return Flow(np.array(starts), pieces, float(y[-1]) if grazed else math.inf, y[:-1])


def _right(rates: Rates, interval: int | None) -> Callable[[float, Floats], list[float]]:
    def right(s: float, y: Floats) -> list[float]:
        at = math.floor(0.5 * (y[1] + 1.0)) if interval is None else interval
        e = 1.0 - 2.0 * (at % 2)
        return list(rates(e * (float(y[1]) - 2.0 * at), e, y))

    return right


def _events(until: float, impact: float) -> list[Callable[[float, Floats], float]]:
    def grazing(s: float, y: Floats) -> float:
        return 0.5 * math.pi - float(y[0])

    def over(s: float, y: Floats) -> float:
        return float(y[-1]) - until

    def striking(s: float, y: Floats) -> float:
        return float(y[1]) - impact if math.isfinite(impact) else -1.0

    grazing.terminal = over.terminal = striking.terminal = True  # type: ignore[attr-defined]
    return [grazing, over, striking]
