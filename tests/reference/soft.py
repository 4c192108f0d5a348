"""Motions between soft limiters of integer powers, by Taylor series of high order in many digits.

``M x'' + C x' + K x = f + sum amplitude cos(frequency t + phase) - sum w stiffness sign(y)
(|y|/size)^exponent``. The series of a step solves the differential equation order by order
(Picard's iteration); the step is halved until the equation holds at its end too. Where the law
differs on both sides of a coordinate, steps end where it changes sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import flint
import numpy as np
from flint import arb, arb_mat, arb_series

from tests.reference.balls import Structure, UndecidedError, mobility_times

PRECISION = 192
_ORDER = 44
_SMALL = 1e-32


@dataclass(frozen=True, slots=True)
class Spring:
    """A limiter of the coordinate ``row x``; sizes are scale times the gaps, None: no wall."""

    row: Any
    lower: Any | None
    upper: Any | None
    stiffness: float
    exponent: int

    @property
    def analytic(self) -> bool:
        """Whether both sides have one law."""
        return self.lower is not None and self.lower == self.upper and self.exponent % 2 == 1

    def factor(self, side: int) -> Any:
        """Return c of the force ``-c y^exponent`` on a side."""
        size = self.upper if side > 0 else self.lower
        if size is None:
            return arb(0)
        c = arb(self.stiffness) / arb(size) ** self.exponent
        return c if side > 0 or self.exponent % 2 == 1 else -c


class SoftMotion:
    """The motion of a structure with soft limiters."""

    def __init__(self, structure: Structure, springs: Sequence[Spring], x: Any, v: Any) -> None:
        flint.ctx.prec = PRECISION
        self.structure, self.springs = structure, springs
        self.A = structure.generator().mid()
        rows = np.array([s.row for s in springs], dtype=np.float64)
        self.rows, self.mobility = rows, mobility_times(structure.M, rows).mid()
        self.z, self.t = structure.state(x, v).mid(), arb(0)
        self.sides = [0 for _ in springs]

    def run(self, times: Sequence[float], patience: int = 20_000) -> list[Any]:
        """Return the states at ascending times."""
        states: list[Any] = []
        while len(states) < len(times):
            self._choose_sides()
            series = self._series()
            h = self._length(series)
            crossing = self._crossing(series, h)
            until = h if crossing is None else crossing
            while len(states) < len(times) and self.t + until >= arb(times[len(states)]):
                states.append(_at(series, arb(times[len(states)]) - self.t))
            self.z, self.t = _at(series, until), (self.t + until).mid()
            patience -= 1
            if patience < 0:
                raise UndecidedError("too many steps")
        return states

    def _coordinate(self, z: Sequence[Any], k: int) -> Any:
        terms = [arb(float(w)) * z[i] for i, w in enumerate(self.rows[k]) if w]
        return sum(terms[1:], terms[0])

    def _choose_sides(self) -> None:
        n, z = self.structure.n, self.z.entries()
        for k, spring in enumerate(self.springs):
            if spring.analytic:
                self.sides[k] = 1
                continue
            y, rate = self._coordinate(z, k), self._coordinate(z[n : 2 * n], k)
            near = abs(y) <= arb(1e-40)
            value = rate if near else y
            self.sides[k] = 1 if value > 0 else -1

    def _series(self) -> list[Any]:
        """Return the Taylor series of the entries of the state."""
        n, z0 = self.structure.n, self.z.entries()
        flint.ctx.cap = _ORDER + 1
        coefficients = [[x] for x in z0]
        for order in range(_ORDER):
            flint.ctx.cap = order + 1
            column = arb_mat([[c[order]] for c in coefficients])
            rate = (self.A * column).entries()
            for k, spring in enumerate(self.springs):
                y = arb_series(_combined(self.rows[k], coefficients), order + 1)
                c = spring.factor(self.sides[k])
                force = -c * _coefficient(y**spring.exponent, order)
                for i in range(n):
                    rate[n + i] = rate[n + i] + self.mobility[i, k] * force
            for i, c in enumerate(coefficients):
                c.append((rate[i] / (order + 1)).mid())
        return coefficients

    def _length(self, series: list[Any]) -> Any:
        """Return a length of the step at whose end the equation still holds."""
        size = max(abs(float(c[0])) for c in series) or 1.0
        # Single coefficients can vanish: a power has every eighth one, say.
        late = range(_ORDER // 2, _ORDER + 1)
        last = max((abs(float(c[k])) / size) ** (1.0 / k) for c in series for k in late)
        h = min(_SMALL ** (1.0 / _ORDER) / max(last, 1e-9), 10.0)
        n = self.structure.n
        for _ in range(60):
            z = _at(series, arb(h))
            rate = (self.A * z).entries()
            for k, spring in enumerate(self.springs):
                y = self._coordinate(z.entries(), k)
                force = -spring.factor(self.sides[k]) * y**spring.exponent
                for i in range(n):
                    rate[n + i] = rate[n + i] + self.mobility[i, k] * force
            slopes = [sum((j * c[j] * arb(h) ** (j - 1) for j in range(2, _ORDER + 1)), c[1])
                      for c in series]  # fmt: skip
            fast = max(abs(float(r)) for r in rate) or 1.0
            off = max(abs(float(a - b)) for a, b in zip(rate, slopes, strict=True))
            if off <= 1e4 * _SMALL * max(fast, size):
                return arb(h)
            h *= 0.7
        raise UndecidedError("no step is short enough")

    def _crossing(self, series: list[Any], h: Any) -> Any | None:
        """Return the first time at which a coordinate leaves the side of its law."""
        first = None
        for k, spring in enumerate(self.springs):
            if spring.analytic:
                continue
            c = _combined(self.rows[k], series)
            values = [float(_value(c, h * j / 16)) * self.sides[k] for j in range(17)]
            below = next((j for j in range(1, 17) if values[j] < 0.0), None)
            if below is None:
                continue
            low, high = h * (below - 1) / 16, h * below / 16
            for _ in range(160):
                middle = ((low + high) / 2).mid()
                if _value(c, middle) * self.sides[k] > 0:
                    low = middle
                else:
                    high = middle
            first = high if first is None or high < first else first
        return first


def _combined(row: Any, coefficients: list[Any]) -> list[Any]:
    length = len(coefficients[0])
    terms = [(arb(float(w)), coefficients[i]) for i, w in enumerate(row) if w]
    return [sum((w * c[j] for w, c in terms), arb(0)) for j in range(length)]


def _coefficient(series: Any, order: int) -> Any:
    return series[order]


def _value(c: list[Any], h: Any) -> Any:
    total = arb(0)
    for x in reversed(c):
        total = total * h + x
    return total


def _at(series: list[Any], h: Any) -> Any:
    return arb_mat([[_value(c, h)] for c in series]).mid()
