"""Motions with impacts, contacts and rest to more than sixty digits, from event to event.

Between events a motion is ``z' = A z``; it is followed in steps, through Taylor polynomials whose
remainder is below all digits, and the first root of every distance to a wall and of every contact
force within a step is isolated by Bernstein coefficients: none can be missed. Impacts obey
Newton's law, simultaneous ones Poisson's (with k = 1 throughout, Moreau's), contacts the
complementarity of forces and accelerations. A chatter is followed until what is left of it cannot
be told from its geometric sum.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import flint
import numpy as np
from flint import arb, arb_mat, arb_poly

from tests.reference.balls import (
    Flow,
    Structure,
    UndecidedError,
    bernstein,
    doubles,
    halves,
    matrix,
    mobility_times,
    power_to_bernstein,
)
from tests.reference.impact_modes import Limiter

PRECISION = 256
_DEGREE = 75
_FEW = 40
_SAME = 2.0**-120  # what is nearer to a wall than this, relative, is at it
_REST = 2.0**-160  # what is slower than this, relative, rests
_CHATTER = 1e-18  # duration of the rest of a chatter, over the shortest time


@dataclass(frozen=True, slots=True)
class Impact:
    """One impact; the velocity is that of the coordinate before it."""

    time: Any
    constraint: int
    side: int
    velocity: Any
    impulse: Any


@dataclass(slots=True)
class Contact:
    """Times during which a coordinate rests at its wall, and what the wall gives in them."""

    constraint: int
    side: int
    rest: Any
    stop: Any = None
    impulse: Any = field(default_factory=arb)


@dataclass
class History:
    """What happened."""

    impacts: list[Impact] = field(default_factory=list)
    contacts: list[Contact] = field(default_factory=list)
    states: list[Any] = field(default_factory=list)  # at the output times
    rates: list[Any] = field(default_factory=list)  # of these states


@dataclass(frozen=True)
class _Watched:
    """A distance to a wall, or a contact force, as ``constant + row z``."""

    constraint: int
    side: int
    contact: bool
    constant: Any
    rows: Any  # Taylor rows

    @cached_property
    def seen(self) -> tuple[Any, Any]:
        """The rows that doubles see, and a bound of all rows."""
        rows = doubles(self.rows)
        return rows[: _FEW + 1], np.abs(rows).sum(axis=0)

    def stays_away(self, z: Any) -> bool:
        """Tell whether doubles are enough to see that there is no root in this step.

        Rounding, and the terms that are left out, are far below the margin, one millionth.
        """
        rows, sizes = self.seen
        c = rows @ z
        c[0] += float(self.constant)
        least = 1e-6 * (sizes @ np.abs(z) + abs(float(self.constant)))
        return bool((power_to_bernstein(_FEW) @ c).min() > least)


class _Configuration:
    """The structure with some coordinates held at their walls."""

    def __init__(self, motion: RigidMotion, held: tuple[tuple[int, int], ...]) -> None:
        s, n = motion.structure, motion.structure.n
        A = motion.A
        forces = arb_mat(0, 0)
        if held:
            W = matrix(motion.rows[[a for a, _ in held]])
            m = arb_mat([[r[a] for a, _ in held] for r in motion.mobility.tolist()])
            pull = W * arb_mat(A.tolist()[n : 2 * n])
            forces = (W * m).solve(pull)
            less = m * forces
            A = arb_mat(A.tolist())
            for i in range(n):
                for j in range(s.size):
                    A[n + i, j] -= less[i, j]
        self.A = A.mid()
        self.flow = Flow(self.A, degree=_DEGREE)
        self.watched = []
        lasting = {a for a, _ in held}
        for a, limiter in enumerate(motion.limiters):
            if a in lasting:
                continue
            for side, wall in ((1, limiter.upper), (-1, limiter.lower)):
                if wall is not None:
                    row = arb_mat(
                        [[arb(-side * float(w)) for w in limiter.row] + [0] * (s.size - n)]
                    )
                    rows = self.flow.taylor_rows(row)
                    self.watched.append(_Watched(a, side, False, arb(wall), rows))
        for k, (a, side) in enumerate(held):
            row = arb_mat([[x * side for x in forces.tolist()[k]]])
            rows = self.flow.taylor_rows(row)
            self.watched.append(_Watched(a, side, True, arb(0), rows))

    @cached_property
    def E(self) -> Any:
        return self.flow.E.mid()

    def at(self, z: Any, s: Any) -> Any:
        """Return the state after a part s of a step."""
        h = s * arb(self.flow.H)
        grown = abs(float(h)) * self.flow.weights[1]
        terms, size = 1, grown
        while size > 1e-70 and terms < _DEGREE:
            terms += 1
            size *= grown / terms
        # Of what no spring holds and a load pushes, all terms are small, and the last ones zero.
        terms = max(terms, min(self.A.nrows(), _DEGREE))
        Ah, term, total = self.A * h, z, z
        for k in range(1, terms + 1):
            term = (Ah * term) * (arb(1) / k)
            total = total + term
        return total.mid()


class RigidMotion:
    """The motion of a structure from an initial state."""

    def __init__(
        self,
        structure: Structure,
        limiters: Sequence[Limiter],
        restitution: Sequence[float],
        x: Any,
        v: Any,
        patience: int = 10_000,
        chatter: float = _CHATTER,
    ) -> None:
        flint.ctx.prec = PRECISION
        self.structure, self.limiters, self.k = structure, limiters, [arb(k) for k in restitution]
        self.rows = np.array([li.row for li in limiters], dtype=np.float64).reshape(-1, structure.n)
        self.A = structure.generator().mid()
        self.mobility = mobility_times(structure.M, self.rows).mid() if len(limiters) else None
        if len(limiters):
            self.G = (matrix(self.rows) * self.mobility).mid()
        self.z, self.t = structure.state(x, v).mid(), arb(0)
        self.held: tuple[tuple[int, int], ...] = ()
        self.still: set[tuple[int, int]] = set()  # at their walls without a force
        self.leaving: dict[tuple[int, int], int] = {}
        self.motion, self.patience, self.chatter = History(), patience, chatter
        self._configurations: dict[tuple[tuple[int, int], ...], _Configuration] = {}
        self._open: dict[tuple[int, int], Contact] = {}

    @property
    def configuration(self) -> _Configuration:
        """The structure as it is held now."""
        if self.held not in self._configurations:
            self._configurations[self.held] = _Configuration(self, self.held)
        return self._configurations[self.held]

    def run(self, t_end: float, times: Sequence[float]) -> History:
        """Follow the motion to its end."""
        self.times = [arb(float(t)) for t in times]
        self._start()
        for until in [*(t for t in self.structure.breaks() if t < t_end), t_end]:
            self.end = arb(until)
            while self.t < self.end:
                self._step()
                self.patience -= 1
                if self.patience < 0:
                    raise UndecidedError("too many events")
            if self.still and until < t_end:
                raise UndecidedError("forces begin at a wall")
            if until < t_end:
                self.structure.bend(self.z, self.end)
        for contact in self._open.values():
            contact.stop = self.end
        return self.motion

    # One step

    def _step(self) -> None:
        configuration = self.configuration
        polynomials, part, near_z = [], 1.0, doubles(self.z)[:, 0]
        for watched in configuration.watched:
            if (watched.constraint, watched.side) in self.still:
                continue
            deflated = self.leaving.get((watched.constraint, watched.side), 0)
            if deflated == 0 and watched.stays_away(near_z):
                continue
            c = (watched.rows * self.z).entries()
            c[0] = c[0] + watched.constant
            c = [x.mid() for x in c[deflated:]]
            polynomials.append((watched, c))
            if float(c[0]) > 0.0 > float(c[1]):
                near = 3.0 * float(c[0]) / -float(c[1])
                if near < 1e-3:
                    part = min(part, near)
        first: tuple[Any, _Watched] | None = None
        for watched, c in polynomials:
            if part < 1.0:
                power, scaled = arb(1), []
                for x in c:
                    scaled.append(x * power)
                    power = power * part
                c = scaled
            root = first_root(c)
            if root is not None and (first is None or root * part < first[0]):
                first = (root * part, watched)
        until = arb(part) if first is None else first[0]
        H = arb(configuration.flow.H)
        if self.t + until * H >= self.end:
            self._sample(self.end - self.t)
            self._press(((self.end - self.t) / H).mid())
            self.z = configuration.at(self.z, ((self.end - self.t) / H).mid())
            self.t, self.leaving = self.end, {}
            return
        self._sample(until * H)
        self._press(until)
        if first is None and part == 1.0:
            self.z = (configuration.E * self.z).mid()
        else:
            self.z = configuration.at(self.z, until)
        self.t = (self.t + until * H).mid()
        self.leaving = {}
        if first is not None:
            self._event(first[1])

    def _sample(self, duration: Any) -> None:
        """Note the states at the output times until the end of a duration."""
        states, H = self.motion.states, arb(self.configuration.flow.H)
        while len(states) < len(self.times) and self.times[len(states)] <= self.t + duration:
            s = (self.times[len(states)] - self.t) / H
            states.append(self.configuration.at(self.z, s.mid()))
            self.motion.rates.append(self.configuration.A * states[-1])

    def _press(self, s: Any) -> None:
        """Add what the walls give to the coordinates at rest in a part s of a step."""
        for watched in self.configuration.watched:
            if watched.contact:
                given, power = arb(0), arb(self.configuration.flow.H)
                for k, c in enumerate((watched.rows * self.z).entries(), start=1):
                    power = power * s
                    given += c.mid() * power / k
                self._open[watched.constraint, watched.side].impulse += given.mid()

    # Events

    def _event(self, watched: _Watched) -> None:
        if watched.contact:
            self._release((watched.constraint, watched.side))
        else:
            self._impact()

    def _value(self, a: int, order: int, A: Any = None) -> Any:
        """Return a derivative of a coordinate, in a configuration or as it is now."""
        n, z = self.structure.n, self.z
        if order >= 2:
            B = self.configuration.A if A is None else A
            for _ in range(order - 1):
                z = B * z
            order = 1
        part = z.tolist()[order * n : (order + 1) * n]
        return (matrix(self.rows[a]) * arb_mat(part))[0, 0].mid()

    def _at_walls(self) -> list[tuple[int, int]]:
        size = arb(_SAME) * self._length
        found = []
        for a, limiter in enumerate(self.limiters):
            y = self._value(a, 0)
            for side, wall in ((1, limiter.upper), (-1, limiter.lower)):
                if wall is not None and abs(arb(wall) - side * y) <= size:
                    found.append((a, side))
        return found

    @cached_property
    def _length(self) -> Any:
        walls = [w for li in self.limiters for w in (li.upper, li.lower) if w]
        walls += [float(x) for x in self.z.entries()[: self.structure.n]]
        return arb(max(map(abs, walls), default=1.0) or 1.0)

    @property
    def _speed(self) -> Any:
        """A velocity to compare with: that of the fastest coordinate, or of the slowest change."""
        n = self.structure.n
        fastest = max(abs(x) for x in self.z.entries()[n : 2 * n])
        return fastest + self._length * arb(1e-6 * self.configuration.flow.weights[1])

    def _start(self) -> None:
        if self._at_walls():
            self._impact()

    def _impact(self) -> None:
        """Apply the law of impact to all coordinates at walls, and find what rests then."""
        struck, n = self._at_walls(), self.structure.n
        tiny = arb(_REST) * self._speed
        u = {key: key[1] * self._value(key[0], 1) for key in struck}
        u = {key: arb(0) if abs(value) <= tiny else value for key, value in u.items()}
        if any(value > 0 for value in u.values()):
            P = {key: p for group in self._coupled(struck)
                 for key, p in self._impulses(group, u, tiny).items()}  # fmt: skip
            for key in struck:
                if P[key] > 0:
                    a, side = key
                    before = side * u[key]
                    self.motion.impacts.append(Impact(self.t, a, side, before, P[key]))
                    if key in self._open:  # it answers another impact
                        self._open[key].impulse += P[key]
                    for i in range(n):
                        self.z[n + i, 0] -= self.mobility[i, a] * side * P[key]
            self.z = self.z.mid()
            u = {key: key[1] * self._value(key[0], 1) for key in struck}
            u = {key: arb(0) if abs(value) <= tiny * 16 else value for key, value in u.items()}
        self._settle(struck, u)
        self._sum_chatter(u)

    def _coupled(self, keys: list[tuple[int, int]]) -> list[list[tuple[int, int]]]:
        """Return the groups of coordinates that impulses reach from one another."""
        groups: list[list[tuple[int, int]]] = []
        for key in keys:
            joined = [g for g in groups if any(self._reaches(key, other) for other in g)]
            groups = [g for g in groups if g not in joined]
            groups.append([*itertools.chain.from_iterable(joined), key])
        return groups

    def _reaches(self, p: tuple[int, int], q: tuple[int, int]) -> bool:
        a, b = p[0], q[0]
        return bool(self.G[a, b] ** 2 > arb(2.0**-200) * self.G[a, a] * self.G[b, b])

    def _impulses(
        self, keys: list[tuple[int, int]], u: dict[tuple[int, int], Any], tiny: Any
    ) -> dict[tuple[int, int], Any]:
        """Return the impulses of one group; contacts give nothing of theirs back.

        A perfectly inelastic blow leaves the least energy that impulses can leave. Poisson: then
        each wall gives k times as much again, and more where another one would be passed without.
        Moreau, k = 1: what the inelastic blow took is reflected, again while anything approaches.
        """
        k = {key: arb(0) if key in self.held else self.k[key[0]] for key in keys}
        given = {key: arb(0) for key in keys}

        def speeds() -> dict[tuple[int, int], Any]:
            return {
                p: (u[p] - sum((self.G[p[0], q[0]] * (p[1] * q[1] * given[q]) for q in keys),
                               arb(0))).mid()
                for p in keys
            }  # fmt: skip

        def press(shares: dict[tuple[int, int], Any]) -> None:
            inelastic = self._complementary(keys, speeds(), tiny)
            for key in keys:
                given[key] = given[key] + shares[key] * inelastic[key]

        if all(k[key] == 1 for key in keys if key not in self.held):
            for _ in range(10_000):
                press({key: arb(2) for key in keys})
                if all(speed <= tiny for speed in speeds().values()):
                    return given
            raise UndecidedError("reflections do not end")
        press({key: 1 + k[key] for key in keys})
        press({key: arb(1) for key in keys})
        return given

    def _settle(self, struck: list[tuple[int, int]], u: dict[tuple[int, int], Any]) -> None:
        """Hold what is pressed to its wall; let go what recedes."""
        resting = [key for key in struck if u[key] == 0]
        press = {key: key[1] * self._value(key[0], 2, self.A) for key in resting}
        tiny = arb(2.0**-120) * self._speed * arb(self.configuration.flow.weights[1])
        still = self._balanced(resting, tiny)
        if still:
            resting = [key for key in resting if key not in still]
            press = {key: press[key] for key in resting}
            if any(p > 0 for p in press.values()):
                raise UndecidedError("forces balance at one wall and not at another")
        self.still = still
        if any(abs(p) <= tiny for p in press.values()):
            if len(resting) > 1:
                raise UndecidedError("forces balance at a wall")
            jerk = resting[0][1] * self._value(resting[0][0], 3, self.A)
            if abs(jerk) <= tiny * arb(self.configuration.flow.weights[1]):
                raise UndecidedError("forces balance at a wall")
            forces = {resting[0]: arb(1) if jerk > 0 else arb(0)}
            order = 3
        else:
            forces, order = self._complementary(resting, press, tiny), 2
        held = tuple(sorted(key for key in resting if forces[key] > 0))
        self.leaving = {key: 1 for key in struck if u[key] < 0}
        self.leaving.update({key: order for key in resting if forces[key] == 0})
        self._hold(held)

    def _balanced(self, resting: list[tuple[int, int]], tiny: Any) -> set[tuple[int, int]]:
        """Return the coordinates that stay at their walls without a force, now and later."""
        fast, found = arb(self.configuration.flow.weights[1]), set()
        for key in resting:
            orders = range(2, self.structure.size + 2)
            derivatives = (abs(self._value(key[0], k, self.A)) / fast ** (k - 2) for k in orders)
            if all(d <= tiny for d in derivatives):
                found.add(key)
        return found

    def _hold(self, held: tuple[tuple[int, int], ...]) -> None:
        for key in [k for k in self._open if k not in held]:
            self._open.pop(key).stop = self.t
        for key in held:
            if key not in self._open:
                self._open[key] = Contact(*key, self.t)
                self.motion.contacts.append(self._open[key])
        self.held = held

    def _release(self, key: tuple[int, int]) -> None:
        held = tuple(k for k in self.held if k != key)
        self._hold(held)
        self.leaving = {key: 3}
        if not key[1] * self._value(key[0], 3) < 0:
            raise UndecidedError("a contact ends and does not")

    def _complementary(
        self, keys: list[tuple[int, int]], give: dict[tuple[int, int], Any], tiny: Any
    ) -> dict[tuple[int, int], Any]:
        """Return ``P >= 0`` with ``G P - give >= 0`` and one of both zero for each key."""

        def coupling(p: tuple[int, int], q: tuple[int, int]) -> Any:
            return self.G[p[0], q[0]] * (p[1] * q[1])

        for count in range(len(keys) + 1):
            for chosen in itertools.combinations(keys, count):
                P = {key: arb(0) for key in keys}
                if chosen:
                    G = arb_mat([[coupling(p, q) for q in chosen] for p in chosen])
                    try:
                        solution = G.solve(arb_mat([[give[p]] for p in chosen]))
                    except ZeroDivisionError:
                        continue
                    P.update({p: solution[i, 0].mid() for i, p in enumerate(chosen)})
                if any(P[p] < 0 for p in chosen):
                    continue
                rests = [
                    sum((coupling(p, q) * P[q] for q in chosen), arb(0)) - give[p]
                    for p in keys if p not in chosen
                ]  # fmt: skip
                if all(rest >= -tiny for rest in rests):
                    return P
        raise UndecidedError("no impulses are complementary")

    def _sum_chatter(self, u: dict[tuple[int, int], Any]) -> None:
        """Bring to rest what would bounce for the shortest time only, all of it or nothing."""
        leaving = [key for key, velocity in u.items() if velocity < 0]
        lasts = [self._lasts(key, u[key]) for key in leaving]
        if not leaving or any(left is None for left in lasts):
            return
        n, held = self.structure.n, tuple(sorted({*self.held, *leaving}))
        G = arb_mat([[self.G[p[0], q[0]] for q in held] for p in held])
        P = G.solve(arb_mat([[self._value(p[0], 1)] for p in held]))
        for j, p in enumerate(held):
            for i in range(n):
                self.z[n + i, 0] -= self.mobility[i, p[0]] * P[j, 0]
        self.z, self.leaving = self.z.mid(), {}
        before, self.held = self.held, held
        left = max(lasts)
        self._sample(left)
        self.z = self.configuration.at(self.z, (left / arb(self.configuration.flow.H)).mid())
        self.t = (self.t + left).mid()
        self.held = before
        self._hold(held)

    def _lasts(self, key: tuple[int, int], velocity: Any) -> Any | None:
        """Return how long a coordinate will bounce; None: long, or it does not come back."""
        a, side = key
        press = side * self._value(a, 2)
        if self.k[a] >= 1 or not press > 0:
            return None
        left = -2 * velocity / (press * (1 - self.k[a]))
        return left if left * arb(self.configuration.flow.weights[1]) < self.chatter else None


def first_root(c: list[Any]) -> Any | None:
    """Return the first root in [0, 1] of a polynomial that is positive at the start."""
    d = np.array([float(x) for x in c[: _FEW + 1]])
    size = float(np.abs(d).sum())
    if size == 0.0:
        return None
    rest = sum(abs(float(x)) for x in c[_FEW + 1 :])
    bracket = _bracket(d, rest + 2.0**-46 * size)
    if bracket == ():
        return None
    if bracket is None:
        bracket = _exact_bracket(c)
        if bracket is None:
            return None
    return _refined(c, d, *bracket)


def _bracket(d: Any, pad: float) -> Any:
    """Return an interval with one root, () if there is none, None if doubles cannot tell."""
    low, high = _halving(len(d) - 1)
    stack = [(power_to_bernstein(len(d) - 1) @ d, 0.0, 1.0)]
    while stack:
        b, left, right = stack.pop()
        if b.min() > pad:
            continue
        if b[0] > pad and b[-1] < -pad and np.diff(b).max() < -2.0 * pad / len(d):
            return left, right
        if right - left < 1e-6 or b[0] <= pad:
            return None
        middle = 0.5 * (left + right)
        stack.append((high @ b, middle, right))
        stack.append((low @ b, left, middle))
    return ()


_halvings: dict[int, tuple[Any, Any]] = {}


def _halving(degree: int) -> tuple[Any, Any]:
    """Return the matrices of de Casteljau's algorithm at 1/2."""
    if degree not in _halvings:
        low = np.zeros((degree + 1, degree + 1))
        for i in range(degree + 1):
            for j in range(i + 1):
                low[i, j] = math.comb(i, j) * 0.5**i
        _halvings[degree] = (low, low[::-1, ::-1].copy())
    return _halvings[degree]


def _exact_bracket(c: list[Any]) -> tuple[float, float] | None:
    """Return an interval with one root in all digits, None if there is none."""
    size = sum((abs(x) for x in c), arb(0))
    beyond = size * arb(2.0**-180)
    b = bernstein(c)
    if abs(c[0]) <= beyond and c[1] < 0:
        return 0.0, 0.0
    stack, patience = [(b, 0.0, 1.0)], 600
    while stack:
        b, left, right = stack.pop()
        patience -= 1
        if all(x > beyond for x in b):
            continue
        differences = [q - p for p, q in itertools.pairwise(b)]
        if b[0] > beyond and b[-1] < -beyond and all(x < 0 for x in differences):
            return left, right
        if right - left < 2.0**-100 or patience < 0 or b[0] < -beyond:
            raise UndecidedError("a coordinate touches its wall and no digit tells how")
        middle = 0.5 * (left + right)
        first, second = halves(b)
        stack.append((second, middle, right))
        stack.append((first, left, middle))
    return None


def _refined(c: list[Any], d: Any, left: float, right: float) -> Any:
    """Return the root in an interval on which the polynomial falls; d: what doubles see of it."""
    p, low, high = arb_poly(c), arb(left), arb(right)
    slope, s = p.derivative(), arb(_nearly(d[::-1].tolist(), left, right))
    for _ in range(200):
        value = p(s).mid()
        if value > 0:
            low = s
        else:
            high = s
        following = (s - value / slope(s)).mid()
        if not low <= following <= high:
            following = ((low + high) / 2).mid()
        if abs(following - s) <= abs(s) * arb(2.0**-230) + arb(2.0**-245):
            return following
        s = following
    return s


def _nearly(highest_first: list[float], left: float, right: float) -> float:
    """Return about where a falling polynomial has its root, in doubles."""
    s = 0.5 * (left + right)
    for _ in range(12):
        value = slope = 0.0
        for x in highest_first:
            slope = slope * s + value
            value = value * s + x
        left, right = (s, right) if value > 0.0 else (left, s)
        following = s - value / slope if slope else s
        if not left <= following <= right:
            following = 0.5 * (left + right)
        if abs(following - s) <= 1e-14 * abs(s):
            break
        s = following
    return s
