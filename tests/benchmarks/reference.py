"""Motions with impacts in extended precision, apart from the solvers: modes and a scan.

Between impacts every mode moves in closed form, in mpmath. Impacts are bracketed by a scan in
double precision, in steps far below the shortest period, and refined by Newton's method in
extended precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import mpmath as mp
import numpy as np

from benchmarks.peers.scene import Outcome, Scene
from vibroimpact_solvers.arrays import Floats

DIGITS: Final = 40
_FINE: Final = 400  # steps of the scan in the shortest period
_WINDOW: Final = 2000  # steps at a time
_OFF: Final = 1e-12  # a wall that was just struck is nearer than this


@dataclass(frozen=True, slots=True)
class _Mode:
    """A damped oscillator ``q'' + 2 d q' + (w^2 + d^2) q = sum F cos(Omega t + phase)``."""

    shape: Any
    d: Any
    w: Any
    steady: tuple[tuple[Any, Any, Any], ...]  # complex amplitude, Omega, phase

    def particular(self, t: Any) -> tuple[Any, Any]:
        q = v = mp.mpf(0)
        for amplitude, omega, phase in self.steady:
            turn = amplitude * mp.expj(omega * t + phase)
            q += mp.re(turn)
            v -= omega * mp.im(turn)
        return q, v

    def start(self, t: Any, q: Any, v: Any) -> tuple[Any, Any]:
        """Return the amplitudes a, b of exp(-d s) (a cos(w s) + b sin(w s))."""
        q0, v0 = self.particular(t)
        return q - q0, ((v - v0) + self.d * (q - q0)) / self.w

    def at(self, t: Any, a: Any, b: Any, s: Any) -> tuple[Any, Any]:
        q, v = self.particular(t + s)
        fade, c, z = mp.exp(-self.d * s), mp.cos(self.w * s), mp.sin(self.w * s)
        value = fade * (a * c + b * z)
        return q + value, v + fade * self.w * (b * c - a * z) - self.d * value


class Reference:
    """The structure of a scene by its modes, to `DIGITS` digits.

    Damping must not couple the modes.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.n = scene, scene.n
        squares, E = mp.eigsy(mp.matrix(scene.stiffness.tolist()))
        self.modes = []
        C = mp.zeros(self.n) if scene.damping is None else mp.matrix(scene.damping.tolist())
        damped = E.T * C * E
        for j in range(self.n):
            for i in range(self.n):
                assert i == j or abs(damped[i, j]) < mp.mpf(10) ** (5 - DIGITS)
            d = damped[j, j] / 2
            steady = []
            for one in scene.load:
                omega = mp.mpf(one.frequency)
                dynamic = mp.mpc(squares[j] - omega**2, 2 * d * omega)
                force = E[one.dof, j] * mp.mpf(one.amplitude)
                steady.append((force / dynamic, omega, mp.mpf(one.phase)))
            w = mp.sqrt(squares[j] - d**2)
            self.modes.append(_Mode(E[:, j], d, w, tuple(steady)))
        self.E = E

    def follow(self) -> Outcome:
        """Return the times of all impacts and the final state, rounded."""
        n, walls = self.n, self.scene.walls
        t, end = mp.mpf(0), mp.mpf(self.scene.t_end)
        x = mp.matrix(self.scene.state[:n].tolist())
        v = mp.matrix(self.scene.state[n:].tolist())
        times: list[float] = []
        while True:
            q, u = self.E.T * x, self.E.T * v
            amplitudes = [m.start(t, q[j], u[j]) for j, m in enumerate(self.modes)]
            first = self._first(t, amplitudes, end)
            s = end - t if first is None else first[0]
            there = [m.at(t, *amplitudes[j], s) for j, m in enumerate(self.modes)]
            x = self.E * mp.matrix([q for q, _ in there])
            v = self.E * mp.matrix([u for _, u in there])
            if first is None:
                return Outcome(tuple(times), np.array([float(a) for a in (*x, *v)]))
            t += s
            times.append(float(t))
            wall = walls[first[1]]
            v[wall.dof] *= -mp.mpf(wall.restitution)

    def _first(self, t: Any, amplitudes: Any, end: Any) -> tuple[Any, int] | None:
        """Return the time to the first wall, and which it is."""
        fastest = max(float(m.w) for m in self.modes)
        h = 2.0 * np.pi / fastest / _FINE
        start, length = 0.0, float(end - t)
        while start < length:
            s: Floats = start + h * np.arange(_WINDOW + 1, dtype=np.float64)
            hits = []
            for i, wall in enumerate(self.scene.walls):
                room = wall.side * self._scan(float(t), amplitudes, wall.dof, s) - wall.gap
                # A wall that was just left is not struck before there is room.
                free = np.maximum.accumulate(room < -_OFF)
                hit = np.flatnonzero((room[1:] > 0.0) & free[:-1])
                if hit.size:
                    near = mp.mpf(s[hit[0]] + 0.5 * h)
                    hits.append((self._refined(t, amplitudes, i, near), i))
            if hits:
                at, which = min(hits)
                return (at, which) if at <= end - t else None
            start = float(s[-1])
        return None

    def _scan(self, t: float, amplitudes: Any, dof: int, s: Floats) -> Floats:
        y = np.zeros(s.size)
        for (a, b), m in zip(amplitudes, self.modes, strict=True):
            d, w, weight = float(m.d), float(m.w), float(m.shape[dof])
            part = np.exp(-d * s) * (float(a) * np.cos(w * s) + float(b) * np.sin(w * s))
            for amplitude, omega, phase in m.steady:
                turn = np.exp(1j * (float(omega) * (t + s) + float(phase)))
                part += (complex(amplitude) * turn).real
            y += weight * part
        return y

    def _refined(self, t: Any, amplitudes: Any, which: int, s: Any) -> Any:
        wall = self.scene.walls[which]
        for _ in range(20):
            q = v = mp.mpf(0)
            for (a, b), m in zip(amplitudes, self.modes, strict=True):
                value, speed = m.at(t, a, b, s)
                q += m.shape[wall.dof] * value
                v += m.shape[wall.dof] * speed
            step = (wall.side * q - mp.mpf(wall.gap)) / (wall.side * v)
            s -= step
            if abs(step) < mp.mpf(10) ** (8 - DIGITS):
                return s
        raise ArithmeticError("an impact was not refined")


def followed(scene: Scene) -> Outcome:
    """Follow a motion between rigid walls in extended precision."""
    with mp.workdps(DIGITS):
        return Reference(scene).follow()
