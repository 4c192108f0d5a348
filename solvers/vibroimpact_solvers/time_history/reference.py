"""Numerical integration by scipy with event functions, for comparison with the exact method.

It is written as most people would write it; it can miss impacts, and stalls where they accumulate.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import scipy  # its parts load as they are used: they are slow to load

from vibroimpact_solvers import condensation
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.time_history.limiters import Power
from vibroimpact_solvers.time_history.run import Tick
from vibroimpact_solvers.time_history.structure import Structure

_MOST: Final = 100_000
"""Impacts after which the integration is stopped: at an accumulation point they never end."""


@dataclass
class Reference:
    """States at the output times and a table of impacts, as integrated."""

    x: Floats
    v: Floats
    times: list[float] = field(default_factory=list)
    struck: list[tuple[int, int]] = field(default_factory=list)
    velocities_and_impulses: list[tuple[float, float]] = field(default_factory=list)
    evaluations: int = 0


def follow(
    structure: Structure,
    law: Power | None,
    x: Floats,
    v: Floats,
    output_times: Floats,
    t_end: float,
    tolerance: float,
    method: str,
    tick: Tick | None = None,
) -> Reference:
    """Integrate a motion from impact to impact, or with soft limiters.

    Raises
    ------
    ConvergenceError
        Where the integrator fails or impacts do not end.
    """
    system, n = structure.system, structure.system.n
    solve, W, harmonic_loads = (
        condensation.solve_mass(system),
        structure.W,
        structure.harmonic_loads,
    )
    sizes, ramps = None if law is None else law.sizes(system), structure.ramps

    def rate(t: float, z: Floats) -> Floats:
        force = structure.force - system.K @ z[:n]
        if system.C is not None:
            force = force - system.C @ z[n:]
        phase = harmonic_loads.frequencies * t
        force = force + harmonic_loads.cosine @ np.cos(phase) - harmonic_loads.sine @ np.sin(phase)
        if ramps.count:
            force = force + ramps.directions @ ramps.state(ramps.segment(t), t)[0]
        if law is not None and sizes is not None:
            force = force + law.forces(W @ z[:n], sizes) @ W
        return np.concatenate([z[n:], solve(force)])

    walls = [] if law is not None else _walls(structure)
    reference = Reference(np.empty((output_times.size, n)), np.empty((output_times.size, n)))
    # Its many overloads know no events that are functions with attributes.
    solve_ivp: Any = scipy.integrate.solve_ivp
    now, z, inverse = 0.0, np.concatenate([x, v]), solve(np.ascontiguousarray(W.T))
    while True:
        later = np.flatnonzero(output_times >= now)
        run = solve_ivp(
            rate, (now, t_end), z, method, rtol=max(tolerance, 3e-14), atol=tolerance,
            events=[event for event, _, _ in walls], dense_output=True,
        )  # fmt: skip
        if run.status < 0:
            raise ConvergenceError(f"{method}: {run.message}")
        reference.evaluations += int(run.nfev)
        inside = later[output_times[later] <= run.t[-1]]
        if inside.size:
            states = run.sol(output_times[inside]).T
            reference.x[inside], reference.v[inside] = states[:, :n], states[:, n:]
        if run.status == 0:
            return reference
        which = next(i for i, times in enumerate(run.t_events) if times.size)
        now, z = float(run.t[-1]), run.y[:, -1].copy()
        _, index, side = walls[which]
        speed, mobility = float(W[index] @ z[n:]), float(W[index] @ inverse[:, index])
        impulse = -(1.0 + system.constraints[index].restitution) * speed / mobility
        z[n:] += impulse * inverse[:, index]
        reference.times.append(now)
        reference.struck.append((index, side))
        reference.velocities_and_impulses.append((speed, abs(impulse)))
        if tick is not None:
            tick(int(1e3 * now / t_end), 1000)
        if len(reference.times) >= _MOST:
            raise ConvergenceError(f"{method}: more than {_MOST} impacts until t = {now!r}")


def _walls(structure: Structure) -> list[tuple[Any, int, int]]:
    """Return event functions with their constraints and sides."""
    events, n = [], structure.system.n
    for index, constraint in enumerate(structure.system.constraints):
        for side, wall in ((1, constraint.upper), (-1, constraint.lower)):
            if wall is None:
                continue
            row = side * structure.W[index]

            def event(t: float, z: Floats, row: Floats = row, wall: float = wall) -> float:
                return float(row @ z[:n] - wall)

            event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]  # scipy's way
            events.append((event, index, side))
    return events
