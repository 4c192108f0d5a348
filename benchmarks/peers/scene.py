"""What an integrator is given and what it gives back."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import System
from vibroimpact_solvers.time_history import Harmonic, Power

_DENSE: Final = 200
"""Masses up to which a product with a full matrix is quicker than with a sparse one."""


@dataclass(frozen=True, slots=True)
class Wall:
    """One side of a limiter: ``side x[dof] <= gap``."""

    dof: int
    side: float
    gap: float
    restitution: float

    def room(self, y: Floats) -> float:
        """Return how far the state is beyond it."""
        return float(self.side * y[self.dof] - self.gap)


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """A motion of unit masses, each limiter on one of them.

    Parameters
    ----------
    system : System
    state : array, shape (2 dof,)
        Displacements and velocities at t = 0.
    t_end : float
    load : tuple of Harmonic
    limiter : Power, optional
        The law of soft limiters; None for rigid ones.
    step : float
        Integrators take no longer ones.
    most : int
        Impacts after which an integrator is stopped.
    """

    system: System
    state: Floats
    t_end: float
    load: tuple[Harmonic, ...] = ()
    limiter: Power | None = None
    step: float = math.inf
    most: int = 100_000

    @property
    def n(self) -> int:
        """Degrees of freedom."""
        return self.system.n

    @property
    def walls(self) -> tuple[Wall, ...]:
        """The sides of its limiters."""
        walls = []
        for limiter in self.system.constraints:
            ((dof, _),) = limiter.coordinate
            for side, gap in ((1.0, limiter.upper), (-1.0, limiter.lower)):
                if gap is not None:
                    walls.append(Wall(dof, side, gap, limiter.restitution))
        return tuple(walls)

    @property
    def stiffness(self) -> Floats:
        """K, in full."""
        return self.system.K.to_dense()

    @property
    def damping(self) -> Floats | None:
        """C, in full, or None."""
        return None if self.system.C is None else self.system.C.to_dense()


@dataclass(frozen=True, slots=True)
class Outcome:
    """Times of impacts and final state of an integrator, and how it ended."""

    times: tuple[float, ...]
    state: Floats
    end: str = ""


def acceleration(scene: Scene) -> Callable[[float, Floats], Floats]:
    """Return what numpy needs to compute ``x''`` from the time and the state."""
    n, force = scene.n, scene.system.force
    rows = -scene.stiffness
    width = n
    if scene.damping is not None:
        rows, width = np.hstack([rows, -scene.damping]), 2 * n
    matrix: Any = rows if n <= _DENSE else scipy.sparse.csr_array(rows)
    loads = [(one.dof, one.amplitude, one.frequency, one.phase) for one in scene.load]
    push = soft(scene)
    if force is None and not loads and push is None:
        return lambda t, y: matrix @ y[:width]

    def rate(t: float, y: Floats) -> Floats:
        rates: Floats = matrix @ y[:width]
        if force is not None:
            rates += force
        for dof, amplitude, frequency, phase in loads:
            rates[dof] += amplitude * math.cos(frequency * t + phase)
        if push is not None:
            push(y, rates)
        return rates

    return rate


def soft(scene: Scene) -> Callable[[Floats, Floats], None] | None:
    """Return what adds the forces of soft limiters, None where they are rigid."""
    law = scene.limiter
    if law is None:
        return None
    walls = [(wall.dof, wall.side, law.scale * wall.gap) for wall in scene.walls]

    def push(y: Floats, force: Floats) -> None:
        for dof, side, size in walls:
            depth = side * float(y[dof]) / size
            if depth > 0.0:
                # Steps that are tried and refused go far beyond.
                force[dof] -= side * law.stiffness * min(depth, 1e15) ** law.exponent

    return push
