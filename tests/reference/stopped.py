"""Motions with stops of finite stiffness to more than sixty digits, from switching to switching.

A stop pushes with ``max(0, k d + c d')`` while the coordinate is d > 0 beyond its wall. Between
switchings a motion is ``z' = A z``, with one A for each set of loaded stops; it is followed in
steps, through Taylor polynomials whose remainder is below all digits, and the first root of every
distance and of every force within a step is isolated by Bernstein coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import flint
import numpy as np
from flint import arb, arb_mat, arb_poly

from tests.reference.balls import Flow, Structure, UndecidedError, mobility_times
from tests.reference.rigid import PRECISION, first_root

_DEGREE = 75
_POINTS = 64
OPEN, LOADED, RELEASED = "open", "loaded", "released"


@dataclass(frozen=True, slots=True)
class Stop:
    """A coordinate, its walls (None: none), and the spring and dashpot behind them."""

    row: Any
    lower: float | None
    upper: float | None
    stiffness: float
    damping: float


@dataclass(slots=True)
class Phase:
    """A contact phase; the energy lost includes what the spring holds when its force is lost."""

    constraint: int
    side: int
    start: Any
    stop: Any = None
    impulse: Any = field(default_factory=arb)
    peak_force: Any = field(default_factory=arb)
    indentation: Any = field(default_factory=arb)
    energy_lost: Any = field(default_factory=arb)


@dataclass
class StoppedHistory:
    """What happened."""

    contacts: list[Phase] = field(default_factory=list)
    states: list[Any] = field(default_factory=list)  # at the output times
    rates: list[Any] = field(default_factory=list)  # of these states
    forces: list[list[Any]] = field(default_factory=list)


State = tuple[str, int]  # of a stop: open, or loaded or released at a side


class StoppedMotion:
    """The motion of a structure from an initial state."""

    def __init__(
        self, structure: Structure, stops: Sequence[Stop], x: Any, v: Any, patience: int = 6_000
    ) -> None:
        flint.ctx.prec = PRECISION
        self.structure, self.stops, self.patience = structure, stops, patience
        self.z, self.t = structure.state(x, v).mid(), arb(0)
        self.free = structure.generator().mid()
        self.mobility = mobility_times(structure.M, np.array([s.row for s in stops])).mid()
        self.states: list[State] = [self._initial(a) for a in range(len(stops))]
        self.leaving: set[tuple[str, int, int]] = set()
        self.motion = StoppedHistory()
        self._flows: dict[tuple[tuple[int, int], ...], Flow] = {}
        self._rows: dict[Any, Any] = {}
        self._last: dict[int, Phase] = {}
        for a, (state, side) in enumerate(self.states):
            if state == LOADED:
                self._begin(a, side)
                if (self._force(a, side) * self.z)[0, 0] == 0:
                    self.leaving.add(("force", a, side))
            for s in (1, -1) if state == OPEN else ():
                if self._wall(a, s) is not None and (self._beyond(a, s) * self.z)[0, 0] == 0:
                    self.leaving.add(("beyond", a, s))

    # Linear forms of the state

    def _wall(self, a: int, side: int) -> Any:
        wall = self.stops[a].upper if side > 0 else self.stops[a].lower
        return None if wall is None else arb(wall)

    def _beyond(self, a: int, side: int) -> Any:
        """Return the form of the indentation."""
        n = self.structure.n
        row = arb_mat(1, self.structure.size)
        for i, w in enumerate(self.stops[a].row):
            row[0, i] = arb(side * float(w))
        row[0, 2 * n] = -self._wall(a, side)
        return row

    def _rate(self, a: int, side: int) -> Any:
        n = self.structure.n
        row = arb_mat(1, self.structure.size)
        for i, w in enumerate(self.stops[a].row):
            row[0, n + i] = arb(side * float(w))
        return row

    def _force(self, a: int, side: int) -> Any:
        stop = self.stops[a]
        return self._beyond(a, side) * arb(stop.stiffness) + self._rate(a, side) * arb(stop.damping)

    def _initial(self, a: int) -> State:
        for side in (1, -1):
            if self._wall(a, side) is None:
                continue
            beyond = (self._beyond(a, side) * self.z)[0, 0]
            rate = (self._rate(a, side) * self.z)[0, 0]
            if beyond > 0 or (beyond == 0 and rate > 0):
                pushes = (self._force(a, side) * self.z)[0, 0] >= 0
                return (LOADED, side) if pushes else (RELEASED, side)
        return OPEN, 0

    # Linear motions

    @property
    def _loaded(self) -> tuple[tuple[int, int], ...]:
        return tuple((a, side) for a, (state, side) in enumerate(self.states) if state == LOADED)

    @property
    def _flow(self) -> Flow:
        loaded = self._loaded
        if loaded not in self._flows:
            A, n = arb_mat(self.free.tolist()), self.structure.n
            for a, side in loaded:
                force = self._force(a, side)
                for i in range(n):
                    for j in range(self.structure.size):
                        A[n + i, j] -= self.mobility[i, a] * side * force[0, j]
            self._flows[loaded] = Flow(A.mid(), degree=_DEGREE)
        return self._flows[loaded]

    def _at(self, s: Any) -> Any:
        """Return the state after a part s of a step."""
        flow, h = self._flow, s * arb(self._flow.H)
        Ah, term, total = flow.A * h, self.z, self.z
        for k in range(1, _DEGREE + 1):
            term = (Ah * term) * (arb(1) / k)
            total = total + term
        return total.mid()

    def _taylor(self, what: str, a: int, side: int) -> list[Any]:
        """Return the coefficients of a form over a step."""
        key = self._loaded, what, a, side
        if key not in self._rows:
            form = {"beyond": self._beyond, "force": self._force}[what](a, side)
            self._rows[key] = self._flow.taylor_rows(form)
        return [x.mid() for x in (self._rows[key] * self.z).entries()]

    def _watched(self) -> list[tuple[str, int, int, int]]:
        """Return the forms that are positive now: what, which stop, its side, and a sign."""
        forms = []
        for a, (state, side) in enumerate(self.states):
            if state == OPEN:
                forms += [("beyond", a, s, -1) for s in (1, -1) if self._wall(a, s) is not None]
            elif state == LOADED:
                forms.append(("force", a, side, 1))
            else:
                forms += [("beyond", a, side, 1), ("force", a, side, -1)]
        return forms

    def run(self, t_end: float, times: Sequence[float]) -> StoppedHistory:
        """Follow the motion to its end."""
        self.times = [arb(float(t)) for t in times]
        for until in [*(t for t in self.structure.breaks() if t < t_end), t_end]:
            self.end = arb(until)
            while self.t < self.end:
                self._step()
                self.patience -= 1
                if self.patience < 0:
                    raise UndecidedError("too many events")
            if until < t_end:
                self.structure.bend(self.z, self.end)
        for a, (state, side) in enumerate(self.states):
            if state == LOADED:
                self._last[a].stop = self.end
            if state == RELEASED:
                self._count_stored(a, side, -1)
        return self.motion

    def _step(self) -> None:
        H, first, part = arb(self._flow.H), None, 1.0
        polynomials = []
        for what, a, side, sign in self._watched():
            c = [sign * x for x in self._taylor(what, a, side)]
            c = c[1:] if (what, a, side) in self.leaving else c
            polynomials.append(((what, a, side), c))
            if float(c[0]) > 0.0 > float(c[1]):
                near = 3.0 * float(c[0]) / -float(c[1])
                part = min(part, near) if near < 1e-3 else part
        for key, c in polynomials:
            scaled = [x * arb(part) ** k for k, x in enumerate(c)]
            root = first_root(scaled)
            if root is not None and (first is None or root * part < first[0]):
                first = root * part, key
        until = arb(part) if first is None else first[0]
        ends = self.t + until * H >= self.end
        until = ((self.end - self.t) / H).mid() if ends else until
        self._sample(until * H)
        self._sum_up(until)
        self.z = self._at(until)
        self.t = self.end if ends else (self.t + until * H).mid()
        self.leaving = set()
        if first is not None and not ends:
            self._switch(*first[1])

    def _switch(self, what: str, a: int, side: int) -> None:
        state, _ = self.states[a]
        if state == RELEASED:
            self._count_stored(a, side, -1)
        if state == OPEN:
            new = LOADED, side
        elif state == LOADED:
            self._last[a].stop = self.t
            new = (RELEASED, side) if self.stops[a].damping > 0.0 else (OPEN, 0)
            if new[0] == RELEASED:
                self._count_stored(a, side, 1)
        else:
            new = (LOADED, side) if what == "force" else (OPEN, 0)
        self.states[a] = new
        if new[0] == LOADED:
            self._begin(a, side)
        self.leaving = {(what, a, side)}
        if self.stops[a].damping == 0.0 and new[0] in {OPEN, LOADED}:
            self.leaving = {("force" if new[0] == LOADED else "beyond", a, side)}
        elif state == OPEN:
            self.leaving = set()
            if not (self._force(a, side) * self.z)[0, 0] > 0:
                raise UndecidedError("a coordinate touches its wall")

    # Sums

    def _begin(self, a: int, side: int) -> None:
        self._last[a] = Phase(a, side, self.t)
        self.motion.contacts.append(self._last[a])

    def _count_stored(self, a: int, side: int, sign: int) -> None:
        beyond = (self._beyond(a, side) * self.z)[0, 0]
        if a in self._last:
            self._last[a].energy_lost += sign * beyond**2 * arb(self.stops[a].stiffness) / 2

    def _sample(self, duration: Any) -> None:
        states, H = self.motion.states, arb(self._flow.H)
        while len(states) < len(self.times) and self.times[len(states)] <= self.t + duration:
            z = self._at(((self.times[len(states)] - self.t) / H).mid())
            states.append(z)
            self.motion.rates.append(self._flow.A * z)
            forces = [arb(0)] * len(self.stops)
            for a, side in self._loaded:
                forces[a] = (self._force(a, side) * z)[0, 0].mid()
            self.motion.forces.append(forces)

    def _sum_up(self, s: Any) -> None:
        """Add what loaded stops do in a part s of a step."""
        H = arb(self._flow.H)
        for a, side in self._loaded:
            phase, c = self._last[a], arb(self.stops[a].damping)
            force, beyond = (
                arb_poly([x * s**k for k, x in enumerate(self._taylor(what, a, side))])
                for what in ("force", "beyond")
            )
            span, rate = s * H, beyond.derivative()
            phase.impulse += (force.integral()(arb(1)) * span).mid()
            phase.energy_lost += (c * (rate * rate).integral()(arb(1)) / span).mid()
            phase.peak_force = _larger(phase.peak_force, force)
            phase.indentation = _larger(phase.indentation, beyond)


def _larger(value: Any, p: Any) -> Any:
    """Return the larger one of a number and the largest value of a polynomial on [0, 1]."""
    c = np.array([float(x) for x in p.coeffs()])
    points = np.linspace(0.0, 1.0, _POINTS + 1)
    seen = np.polynomial.polynomial.polyval(points, c)
    s, slope = arb(float(points[int(np.argmax(seen))])), p.derivative()
    bend = slope.derivative()
    best = max(value, p(s).mid(), key=float)
    for _ in range(40):
        if not bend(s) < 0:
            break
        s = (s - slope(s) / bend(s)).mid()
        if not 0 <= s <= 1:
            break
    else:
        best = max(best, p(s).mid(), key=float)
    return best if float(best) > float(value) else value
