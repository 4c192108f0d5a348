"""Free motion between two impacts in extended precision, and a certified search for its end.

Between impacts a watched coordinate is a sum of exponentials, so that its third derivative has a
bound B for the rest of the free motion, and

    y(s + h) <= y + y' h + y'' h^2/2 + B h^3/6 .

A step to the first root of that bound passes no wall. Far from the walls doubles with a bound of
their rounding prove it; close to one, all digits do, and the steps converge like those of Newton.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import flint
import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.time_history.extended.configuration import Configuration, Form
from vibroimpact_solvers.time_history.extended.precision import Complex, Real, Row, middle

MEANT: Final = 8
"""Guard digits to which the time of an impact is located."""
_STEPS: Final = 200_000
"""Steps after which a search is given up."""
_NEAR: Final = 64.0  # roundings of doubles within which the distance to a wall takes all digits
_EPS: Final = 2.0**-52


@dataclass(frozen=True, eq=False, slots=True)
class Watch:
    """A coordinate that must not pass a wall: ``sign form <= wall``.

    Parameters
    ----------
    form : Form
    sign : int
    wall : arb
    constraint : int
        Its index; of a contact force: -1 minus the index of the contact.
    """

    form: Form
    sign: int
    wall: Real
    constraint: int


class FreeMotion:
    """The free motion from a state.

    Parameters
    ----------
    configuration : Configuration
    q, rate : list of arb
        Modal coordinates and their rates.
    start : arb
        The time.
    """

    def __init__(self, configuration: Configuration, q: Row, rate: Row, start: Real) -> None:
        self.configuration, self.start = configuration, start
        body = configuration.body
        self.loads = [flint.acb(0, omega * start).exp() for omega in body.loads]
        self.poly: list[tuple[Real, Real, Real]] = []
        self.sigma: list[Complex] = []
        self.owner: list[int] = []
        self.weight: list[Complex] = []
        omegas = [flint.acb(0, omega) for omega in body.loads]
        for j, (value, delta) in enumerate(
            zip(configuration.eigenvalues, configuration.delta, strict=True)
        ):
            a, b = q[j], rate[j]
            for turn, omega, response in zip(
                self.loads, omegas, configuration.response, strict=True
            ):
                steady = response[j] * turn
                a, b = a - steady.real, b - (omega * steady).real
            one, two = configuration.sigma[j]
            if value == 0 and delta == 0:
                self.poly.append((a, b, configuration.push[j] / 2))
                continue
            creep = flint.arb(0) if value != 0 else configuration.push[j] / (2 * delta)
            self.poly.append((configuration.still[j], creep, flint.arb(0)))
            a, b = a - configuration.still[j], b - creep
            apart = one - two
            first, second = (b - two * a) / apart, (one * a - b) / apart
            if one.imag == 0:
                self._add(j, one, first)
                self._add(j, two, second)
            else:
                self._add(j, one, 2 * first)  # the other is its conjugate

    def _add(self, mode: int, sigma: Complex, weight: Complex) -> None:
        self.owner.append(mode)
        self.sigma.append(sigma)
        self.weight.append(weight)

    def state(self, s: Real) -> tuple[Row, Row]:
        """Return modal coordinates and rates after a time s."""
        q = [a + b * s + c * s * s for a, b, c in self.poly]
        rate = [b + 2 * c * s for _, b, c in self.poly]
        for j, sigma, weight in zip(self.owner, self.sigma, self.weight, strict=True):
            term = weight * (sigma * s).exp()
            q[j] += term.real
            rate[j] += (sigma * term).real
        for omega, turn, response in zip(
            self.configuration.body.loads, self.loads, self.configuration.response, strict=True
        ):
            spin = flint.acb(0, omega)
            now = turn * (spin * s).exp()
            for j, each in enumerate(response):
                steady = each * now
                q[j] += steady.real
                rate[j] += (spin * steady).real
        return [middle(value) for value in q], [middle(value) for value in rate]


class Search:
    """The search for the end of a free motion.

    Parameters
    ----------
    free_motion : FreeMotion
    watches : sequence of Watch
    digits : int
    """

    def __init__(self, free_motion: FreeMotion, watches: Sequence[Watch], digits: int) -> None:
        self._motion, self.watches = free_motion, watches
        omegas = [flint.acb(0, omega) for omega in free_motion.configuration.body.loads]
        self._sigma = free_motion.sigma + omegas
        # Coefficients of all exponentials, (watch, exponential), and of the polynomials.
        self._terms = [self._exponentials(watch, omegas) for watch in watches]
        self._poly = [self._polynomial(watch) for watch in watches]
        self.sigma = np.array([complex(s) for s in self._sigma]).reshape(-1)
        self.terms = np.array([[complex(c) for c in row] for row in self._terms])
        self.terms = self.terms.reshape(len(watches), self.sigma.size)
        self.poly = np.array(
            [[float(middle(c)) for c in row] for row in self._poly], dtype=np.float64
        ).reshape(len(watches), 3)
        self.walls = np.array([float(middle(w.wall)) for w in watches], dtype=np.float64)
        self._grow = np.maximum(self.sigma.real, 0.0)
        fastest = float(self._grow.max(initial=0.0))
        self._longest = 1.0 / fastest if fastest > 0.0 else math.inf
        sizes = np.abs(self.terms).sum(axis=1) + np.abs(self.poly[:, 0]) + np.abs(self.walls)
        self.sizes: Floats = np.maximum(sizes, 1e-300)
        self.tiny = [
            flint.arb(float(size)) * flint.arb(10) ** (-digits - MEANT) for size in self.sizes
        ]
        self._powers = np.abs(self.sigma)[:, np.newaxis] ** np.arange(4)
        self.expansions = 0

    def _exponentials(self, watch: Watch, omegas: list[Complex]) -> list[Complex]:
        free_motion, form = self._motion, watch.form
        coefficients = [
            watch.sign * (form.by_q[j] + form.by_v[j] * sigma) * weight
            for j, sigma, weight in zip(
                free_motion.owner, free_motion.sigma, free_motion.weight, strict=True
            )
        ]
        for turn, omega, response, driven in zip(
            free_motion.loads, omegas, free_motion.configuration.response, form.driven, strict=True
        ):
            total = driven
            for j, each in enumerate(response):
                total += (form.by_q[j] + form.by_v[j] * omega) * each
            coefficients.append(watch.sign * total * turn)
        return coefficients

    def _polynomial(self, watch: Watch) -> tuple[Real, Real, Real]:
        form = watch.form
        c0, c1, c2 = form.level, flint.arb(0), flint.arb(0)
        for j, (a, b, c) in enumerate(self._motion.poly):
            c0 += form.by_q[j] * a + form.by_v[j] * b
            c1 += form.by_q[j] * b + 2 * form.by_v[j] * c
            c2 += form.by_q[j] * c
        return tuple(watch.sign * value for value in (c0, c1, c2))  # type: ignore[return-value]

    def first(self, end: Real, leaving: frozenset[int]) -> tuple[Real, int | None]:
        """Return the end of the free motion, and the watch that ends it; None: the time is over.

        Parameters
        ----------
        end : arb
            The remaining time.
        leaving : frozenset of int
            Watches that are at their walls at the beginning, and leave them.
        """
        s, last = flint.arb(0), float(middle(end))
        for _ in range(_STEPS):
            self.expansions += 1
            now = float(s)
            ahead = min(max(last - now, 0.0), self._longest)
            step = None if (s == 0 and leaving) else self._quick(now, ahead)
            if step is None:
                step, met = self._close(s, ahead, leaving if s == 0 else frozenset())
                if met is not None:
                    return self._polished(s, met), met
            # The remaining time has all digits, so that the end is met.
            if step >= last - now:
                return end, None
            s = middle(s + step)
        raise ConvergenceError(f"the search for an impact takes more than {_STEPS} steps")

    def _quick(self, s: float, ahead: float) -> float | None:
        """Return a safe step proved in doubles, None where a wall is too close for that."""
        E = np.exp(self.sigma * s)
        now = self.terms * E
        sizes = np.abs(now)
        scaled = now * self.sigma
        # Roundings of phases and sums, for the coordinate and two derivatives.
        rounding = 8.0 * _EPS * (sizes * (4.0 + np.abs(self.sigma) * s)) @ self._powers[:, :3]
        p0, p1, p2 = self.poly.T
        rounding[:, 0] += 8.0 * _EPS * (np.abs(p0) + np.abs(p1) * s + np.abs(p2) * s * s)
        rounding[:, 0] += 8.0 * _EPS * np.abs(self.walls)
        rounding[:, 1] += 8.0 * _EPS * (np.abs(p1) + 2.0 * np.abs(p2) * s)
        rounding[:, 2] += 16.0 * _EPS * np.abs(p2)
        y = now.real.sum(axis=1) + p0 + p1 * s + p2 * s * s
        room = self.walls - y - rounding[:, 0]
        if (room <= _NEAR * rounding[:, 0]).any():
            return None
        slope = scaled.real.sum(axis=1) + p1 + 2.0 * p2 * s + rounding[:, 1]
        bend = (scaled * self.sigma).real.sum(axis=1) + 2.0 * p2 + rounding[:, 2]
        bounds = self._bounds(sizes, ahead)
        step = ahead
        for i in range(len(self.watches)):
            step = min(step, safe_step(room[i], slope[i], bend[i], bounds[i], step))
        return step

    def _bounds(self, sizes: Floats, ahead: float) -> Floats:
        """Return bounds of third derivatives for the time `ahead`."""
        grown = sizes * np.exp(self._grow * ahead)
        return np.asarray((1.0 + 1e-9) * (grown @ self._powers[:, 3]))

    def _close(self, s: Real, ahead: float, leaving: frozenset[int]) -> tuple[float, int | None]:
        """Return a safe step proved with all digits, or the watch that is at its wall."""
        turned = [(sigma * s).exp() for sigma in self._sigma]
        step = ahead
        sizes = np.abs(self.terms * np.array([complex(e) for e in turned]))
        bounds = self._bounds(sizes, ahead)
        for i, watch in enumerate(self.watches):
            y, slope, bend = self._derivatives(i, s, turned)
            room = middle(watch.wall - y)
            down, curve = float(middle(slope)), float(middle(bend))
            if i not in leaving and room <= self.tiny[i] and (down > 0.0 or curve > 0.0):
                if down > 0.0:
                    return 0.0, i
                room = self.tiny[i]  # touches and turns back
            if i in leaving or room <= 0:
                step = min(step, leaving_step(down, curve, bounds[i], step))
            else:
                step = min(step, safe_step(float(room), down, curve, bounds[i], step))
        return step, None

    def _polished(self, s: Real, i: int) -> Real:
        """Return the time of an impact after one more step of Newton, where that is safe."""
        turned = [(sigma * s).exp() for sigma in self._sigma]
        y, slope, bend = self._derivatives(i, s, turned)
        room = self.watches[i].wall - y
        if slope > 0 and 64 * abs(room * bend) < slope * slope:
            later = middle(s + room / slope)
            return later if later > 0 else s
        return s

    def _derivatives(self, i: int, s: Real, turned: list[Complex]) -> tuple[Real, Real, Real]:
        c0, c1, c2 = self._poly[i]
        y, slope, bend = c0 + c1 * s + c2 * s * s, c1 + 2 * c2 * s, 2 * c2
        for c, sigma, e in zip(self._terms[i], self._sigma, turned, strict=True):
            term = c * e
            y += term.real
            term *= sigma
            slope += term.real
            bend += (term * sigma).real
        return y, slope, bend

    def integral(self, i: int, start: Real, stop: Real) -> Real:
        """Return the integral of a watched coordinate from one time to another."""
        c0, c1, c2 = self._poly[i]
        total = flint.arb(0)
        for power, c in enumerate((c0, c1, c2), start=1):
            total += c * (stop**power - start**power) / power
        for c, sigma in zip(self._terms[i], self._sigma, strict=True):
            if sigma == 0:
                total += c.real * (stop - start)
            else:
                total += (c * ((sigma * stop).exp() - (sigma * start).exp()) / sigma).real
        return middle(total)

    def room(self, i: int, s: Real) -> Real:
        """Return the distance of a watched coordinate from its wall after a time s."""
        turned = [(sigma * s).exp() for sigma in self._sigma]
        return middle(self.watches[i].wall - self._derivatives(i, s, turned)[0])


def safe_step(room: float, slope: float, bend: float, bound: float, most: float) -> float:
    """Return the first root of ``room - slope h - bend h^2/2 - bound h^3/6``, from below.

    Parameters
    ----------
    room : float
        Positive.
    slope, bend : float
        First two derivatives towards the wall.
    bound : float
        Of the magnitude of the third.
    most : float
        Longest step of interest.
    """

    def left(h: float) -> float:
        return room - h * (slope + h * (0.5 * bend + h * bound / 6.0))

    parts = [most]
    for value, power in ((slope, 1), (0.5 * bend, 2), (bound / 6.0, 3)):
        if value > 0.0:
            parts.append((room / (3.0 * value)) ** (1.0 / power))
    low = min(parts)
    if low >= most:
        return most
    # Beyond a dip the bound may rise again before it falls for good.
    disc = bend * bend - 2.0 * bound * slope
    if slope > 0.0 and bend < 0.0 and disc > 0.0 and bound > 0.0:
        dip = 2.0 * slope / (-bend + math.sqrt(disc))
        if left(dip) > 0.0:
            low = max(low, dip)
        else:
            most = min(most, dip)
    high = low
    while high < most:
        high = min(2.0 * high, most)
        if left(high) <= 0.0:
            return _bisected(left, low, high)
        low = high
    return most


def _bisected(left: object, low: float, high: float) -> float:
    assert callable(left)
    for _ in range(60):
        mean = 0.5 * (low + high)
        if not low < mean < high:
            break
        if left(mean) > 0.0:
            low = mean
        else:
            high = mean
    return low


def leaving_step(slope: float, bend: float, bound: float, most: float) -> float:
    """Return a time for which a coordinate that leaves its wall stays away from it."""
    if slope < 0.0:
        root = math.sqrt(0.25 * bend * bend - 2.0 / 3.0 * slope * bound)
        down = 0.5 * bend + root
        return min(most, -2.0 * slope / down) if down > 0.0 else most
    if bend < 0.0:
        return min(most, -3.0 * bend / bound) if bound > 0.0 else most
    # Only rounding is left of both: a force that has just vanished.
    return most * 2.0**-40
