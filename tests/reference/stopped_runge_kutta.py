"""Motions between linear stops by a Runge-Kutta method that stops at each switching.

Independent of the solvers: the equations of motion as they are, a contact force for each stop, set
by set of the loaded ones, and events where one of them changes. Stops are in series with a residual
flexibility and their walls move, where they do.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from vibroimpact_solvers.model import System

Loaded = frozenset[tuple[int, int]]
OPEN: Loaded = frozenset()


def at_rest(t: float) -> tuple[float, float]:
    return 0.0, 0.0


@dataclass
class StoppedMotion:
    """Motions of a system with linear stops.

    Parameters
    ----------
    system : System
    force : callable
        Time -> the load, shape (dof,).
    delta : array, shape (constraint, constraint)
        Residual flexibility, of stops without damping.
    walls : sequence of callable
        Time -> displacement and velocity of each constraint's walls.
    """

    system: System
    force: Callable[[float], Any]
    delta: Any
    walls: Sequence[Callable[[float], tuple[float, float]]]
    contacts: list[tuple[float, int, int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        system = self.system
        self.n, self.W = system.n, system.directions(range(len(system.constraints)))
        self.M, self.K = system.M.to_dense(), system.K.to_dense()
        self.C = np.zeros_like(self.K) if system.C is None else system.C.to_dense()
        self.sides = [
            (a, side)
            for a, c in enumerate(system.constraints)
            for side, wall in ((-1, c.lower), (1, c.upper))
            if wall is not None
        ]

    def forces(self, loaded: Loaded, t: float, z: Any) -> tuple[dict[Any, float], Any]:
        """Return the forces of loaded stops, and the coordinates relative to walls, displaced."""
        x, v = z[: self.n], z[self.n :]
        moved = np.array([wall(t) for wall in self.walls])
        y, rate = self.W @ x - moved[:, 0], self.W @ v - moved[:, 1]
        some, cs = sorted(loaded), self.system.constraints
        if some:
            # F = k (d - s delta s F) + c d', all stops at once
            laws: list[Any] = [cs[a].law for a, _ in some]
            signs, which = np.array([s for _, s in some]), [a for a, _ in some]
            k = np.array([law.stiffness for law in laws])
            c = np.array([law.damping or 0.0 for law in laws])
            among = self.delta[np.ix_(which, which)] * np.outer(signs, signs)
            free = np.array([s * y[a] - self.wall(a, s) for a, s in some])
            push = k * free + c * signs * rate[which]
            F = np.linalg.solve(np.eye(len(some)) + k[:, None] * among, push)
            y = y - self.delta[:, which] @ (signs * F)
            return dict(zip(some, F, strict=True)), y
        return {}, y

    def wall(self, a: int, side: int) -> float:
        c = self.system.constraints[a]
        wall = c.upper if side > 0 else c.lower
        assert wall is not None
        return float(wall)

    def rhs(self, loaded: Loaded) -> Callable[[float, Any], Any]:
        def rates(t: float, z: Any) -> Any:
            total = self.force(t) - self.K @ z[: self.n] - self.C @ z[self.n :]
            for (a, side), F in self.forces(loaded, t, z)[0].items():
                total = total - side * F * self.W[a]
            return np.concatenate([z[self.n :], np.linalg.solve(self.M, total)])

        return rates

    def consistent(self, t: float, z: Any) -> Loaded:
        """Return the only set of loaded stops whose forces push, and beyond whose walls none is."""
        for count in range(len(self.sides) + 1):
            for some in itertools.combinations(self.sides, count):
                loaded = frozenset(some)
                F, y = self.forces(loaded, t, z)
                others = [stop for stop in self.sides if stop not in loaded]
                beyond = [side * y[a] > self.wall(a, side) for a, side in others]
                if all(value > 0.0 for value in F.values()) and not any(beyond):
                    return loaded
        raise AssertionError

    def follow(self, x: Any, v: Any, times: Any, breaks: Sequence[float] = ()) -> Any:
        """Return the states at times, shape (time, 2 dof); the law may break at some times."""
        z, t, states = np.concatenate([x, v]), 0.0, []
        loaded, t_end = self.consistent(0.0, z), float(times[-1])
        stages = [*(b for b in breaks if 0.0 < b < t_end), t_end]
        self.contacts = [(0.0, *each) for each in sorted(loaded)]
        for until in stages:
            while t < until:
                events = []
                for stop in self.sides:

                    def event(s: float, y: Any, stop: Any = stop, loaded: Any = loaded) -> float:
                        F, place = self.forces(loaded, s, y)
                        if stop in loaded:
                            return float(-F[stop])
                        return float(stop[1] * place[stop[0]] - self.wall(*stop))

                    event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
                    events.append(event)
                part = solve_ivp(
                    self.rhs(loaded), (t, until), z, method="DOP853", rtol=1e-13, atol=1e-15,
                    events=events, dense_output=True, max_step=0.1,
                )  # fmt: skip
                inside = times[(times >= t) & (times < part.t[-1])]
                states += [part.sol(s) for s in inside]
                t, z = float(part.t[-1]), part.y[:, -1]
                for stop, when in zip(self.sides, part.t_events, strict=True):
                    if len(when):
                        loaded = loaded ^ {stop}
                        if stop in loaded:
                            self.contacts.append((t, *stop))
        return np.array([*states, z])
