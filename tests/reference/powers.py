"""Motions with stops whose force is a power of the indentation, by an integrator with events.

``M x'' + C x' + K x = f + sum amplitude cos(frequency t + phase) - sum side w k d^n`` with
``d = side w x - wall``. scipy's DOP853 goes from one contact to the next; impulses are integrated
with the motion, and largest indentations are those at turns of the coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

_RTOL, _ATOL = 3e-14, 1e-15
_IN_A_RADIAN = 3.0  # steps in the time of the fastest mode, so that events are seen


@dataclass(frozen=True, slots=True)
class Wall:
    """A wall at ``side w x = place``."""

    row: Any
    side: int
    place: float
    stiffness: float
    exponent: float


@dataclass(slots=True)
class Phase:
    """A contact phase."""

    wall: int
    start: float
    velocity: float
    impulse: float
    indentation: float
    stop: float = math.nan


@dataclass(slots=True)
class PowerHistory:
    """States at the output times, and contacts in the order of their starts."""

    x: Any
    v: Any
    phases: list[Phase] = field(default_factory=list)


class PowerMotion:
    """The motion of a structure from an initial state."""

    def __init__(
        self, matrices: tuple[Any, Any, Any], force: Any, loads: Sequence[Any], walls: Any
    ) -> None:
        M, self.C, self.K = matrices
        self.inverse, self.force, self.loads = np.linalg.inv(M), force, loads
        self.rows = np.array([wall.side * np.asarray(wall.row, float) for wall in walls])
        self.places = np.array([wall.place for wall in walls])
        self.walls, self.n = walls, len(M)
        fastest = float(np.linalg.eigvals(self.inverse @ self.K).real.max())
        self.longest = 1.0 / (_IN_A_RADIAN * math.sqrt(max(fastest, 1e-2)))

    def run(self, x: Any, v: Any, times: Any) -> PowerHistory:
        """Follow the motion to the last of the output times."""
        n, end = self.n, float(times[-1])
        history = PowerHistory(np.empty((len(times), n)), np.empty((len(times), n)))
        z, t = np.concatenate([x, v, np.zeros(len(self.walls))]), 0.0
        deep, speed = self.rows @ x - self.places, self.rows @ v
        touched = (deep > 0.0) | ((deep == 0.0) & (speed > 0.0))
        lasting = {
            i: Phase(i, 0.0, float(speed[i]), 0.0, float(deep[i]))
            for i in np.flatnonzero(touched).tolist()
        }
        size = float(np.abs(z).max())
        while True:
            run: Any = solve_ivp(
                self._rate(touched.copy()), (t, end), z, "DOP853", rtol=_RTOL, atol=_ATOL * size,
                events=self._events(touched), dense_output=True, max_step=self.longest,
            )  # fmt: skip
            assert run.status >= 0, run.message
            inside = (times >= t) & (times <= run.t[-1])
            if inside.any():
                states = run.sol(times[inside])
                history.x[inside], history.v[inside] = states[:n].T, states[n : 2 * n].T
            t, z = float(run.t[-1]), run.y[:, -1].copy()
            for i, phase in lasting.items():
                turns = [*run.y_events[len(self.walls) + i], z]
                most = max(float(self.rows[i] @ y[:n] - self.places[i]) for y in turns)
                phase.indentation = max(phase.indentation, most)
            crossed = [i for i in range(len(self.walls)) if run.status and run.t_events[i].size]
            for i in crossed if run.status else list(lasting):
                if i in lasting:
                    phase = lasting.pop(i)
                    phase.stop, phase.impulse = t, float(z[2 * n + i]) - phase.impulse
                    history.phases.append(phase)
                else:
                    speed = float(self.rows[i] @ z[n : 2 * n])
                    lasting[i] = Phase(i, t, speed, float(z[2 * n + i]), 0.0)
                touched[i] = not touched[i]
                row = self.rows[i]
                z[:n] -= row * (row @ z[:n] - self.places[i]) / (row @ row)
            if run.status == 0:
                history.phases.sort(key=lambda phase: phase.start)
                return history

    def _rate(self, touched: Any) -> Any:
        n = self.n

        def rate(t: float, z: Any) -> Any:
            x, v = z[:n], z[n : 2 * n]
            push = self.force - self.K @ x - self.C @ v
            for dof, amplitude, frequency, phase in self.loads:
                push[dof] += amplitude * math.cos(frequency * t + phase)
            forces = np.zeros(len(self.walls))
            for i in np.flatnonzero(touched):
                deep = max(float(self.rows[i] @ x - self.places[i]), 0.0)
                forces[i] = self.walls[i].stiffness * deep ** self.walls[i].exponent
                push = push - self.rows[i] * forces[i]
            return np.concatenate([v, self.inverse @ push, forces])

        return rate

    def _events(self, touched: Any) -> list[Any]:
        """Return passages of walls, which end a run, and then turns of the coordinates."""
        events: list[Any] = []
        for i, (row, place) in enumerate(zip(self.rows, self.places, strict=True)):

            def passes(_t: float, z: Any, row: Any = row, place: float = place) -> float:
                return float(row @ z[: self.n] - place)

            passes.terminal = True  # type: ignore[attr-defined]
            passes.direction = -1.0 if touched[i] else 1.0  # type: ignore[attr-defined]
            events.append(passes)
        for row in self.rows:

            def turns(_t: float, z: Any, row: Any = row) -> float:
                return float(row @ z[self.n : 2 * self.n])

            turns.direction = -1.0  # type: ignore[attr-defined]
            events.append(turns)
        return events
