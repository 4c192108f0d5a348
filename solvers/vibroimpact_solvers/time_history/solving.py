"""Does what a plan lists."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.time_history import reference, soft
from vibroimpact_solvers.time_history.planning import Flight
from vibroimpact_solvers.time_history.problem import Problem
from vibroimpact_solvers.time_history.result import Result, empty
from vibroimpact_solvers.time_history.run import Run, Tick
from vibroimpact_solvers.time_history.start import initial_state
from vibroimpact_solvers.time_history.structure import Scene, Structure

TOLERANCE: Final = 1e-6
"""Meant where none is asked for."""

_EPS = float(np.finfo(np.float64).eps)
_STATEMENT = (
    "estimate: roundings of the initial state and of every flight, carried along by the "
    "linearised motion and its impacts, relative to the state; between impacts the motion is "
    "exact, and no impact can be missed but for grazings within rounding"
)


_HALVED = (
    "estimate: difference to the same motion with steps of twice the length, relative to the "
    "largest state; penetration is the largest coordinate over scale times its gap"
)
_NONE = "none: the integrator's own control of its steps; it can miss impacts"


def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute what the plan lists.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        The one that `plan(problem)` returned.
    tick : callable, optional
        Called with (done, total) thousandths of the motion; may raise `Cancelled`.
    """
    step = plan.step(Stage.SPECTRUM)
    assert step is not None
    structure = Structure.of(
        problem.system, spectrum.Method(step.method), problem.t_end, problem.load
    )
    history = _History(problem, structure)
    flight = plan.step(Stage.FLIGHT)
    assert flight is not None
    solver = _METHODS.get(Flight(flight.method), _integrated)
    wanted = problem.times if plan.step(Stage.HISTORY) else np.zeros(0)
    return solver(problem, structure, history, wanted, tick)


def _exact(
    problem: Problem, structure: Structure, history: _History, wanted: Floats, tick: Tick | None
) -> Result:
    """Fly from impact to impact."""
    keep = "impacts" in problem.outputs
    z = initial_state(problem, structure)
    run = Run(structure, z, wanted, problem.t_end, history.take, keep=keep, tick=tick)
    run.finish()
    return _result(problem, run, history)


def _soft(
    problem: Problem, structure: Structure, history: _History, wanted: Floats, tick: Tick | None
) -> Result:
    """Split into exact flow and kicks of the soft limiters."""
    assert problem.limiter is not None
    z = initial_state(problem, structure)
    tolerance = TOLERANCE if problem.tolerance is None else problem.tolerance
    run = soft.follow(structure, problem.limiter, z, wanted, problem.t_end, tolerance, tick)
    history.take(structure.scene(), run.states, 0)
    found = _bare(problem, history)
    found.update(
        error_penetration=run.compression,
        error_difference=run.difference,
        count_expansions=run.steps,
        error_statement=_HALVED,
    )
    return Result(**found)


def _integrated(
    problem: Problem, structure: Structure, history: _History, wanted: Floats, tick: Tick | None
) -> Result:
    """Integrate with scipy."""
    x, v = structure.place(structure.scene(), initial_state(problem, structure))
    v = v * math.ldexp(1.0, structure.exponent)
    tolerance = TOLERANCE if problem.tolerance is None else problem.tolerance
    run = reference.follow(
        structure, problem.limiter, x, v, wanted, problem.t_end, tolerance, problem.method, tick
    )
    history.fill(run.x, run.v, slice(None))
    found = _bare(problem, history)
    if "impacts" in problem.outputs:
        struck, blows = np.array(run.struck).reshape(-1, 2), np.array(run.blows).reshape(-1, 2)
        found.update(
            impact_time=np.array(run.times),
            impact_constraint=struck[:, 0].astype(np.int64),
            impact_side=struck[:, 1].astype(np.int64),
            impact_velocity=blows[:, 0].astype(np.float64),
            impact_impulse=blows[:, 1].astype(np.float64),
            impact_condition=np.full(len(run.times), np.nan),
        )
    found.update(
        count_impacts=len(run.times), count_expansions=run.evaluations, error_statement=_NONE
    )
    return Result(**found)


_METHODS: Final = {Flight.MODAL: _exact, Flight.SPLITTING: _soft}


class _History:
    """The arrays along the wanted times, filled in as the motion goes on."""

    def __init__(self, problem: Problem, structure: Structure) -> None:
        self.problem, self.structure = problem, structure
        times, outputs = problem.times.size, problem.outputs
        shape = (times, problem.wanted_dofs.size)
        self.x = np.empty(shape) if "x" in outputs else None
        self.v = np.empty(shape) if "v" in outputs else None
        self._all = np.array_equal(problem.wanted_dofs, np.arange(problem.system.n))
        self.energy = np.empty(times) if "energy" in outputs else None

    def take(self, scene: Scene, samples: Floats, first: int) -> None:
        """Fill in what is wanted at some times from states, shape (time, 2, pair)."""
        basis, modes = scene.basis, scene.basis.modes
        scale = math.ldexp(1.0, basis.exponent)
        some = slice(first, first + samples.shape[0])
        q, rate = basis.coordinates(samples)
        q += basis.still
        rate *= scale
        dofs = self.problem.wanted_dofs
        shapes, base = modes.shapes, modes.base
        if self.energy is None and not self._all:
            shapes, base = shapes[dofs], base[dofs]
        if (self.x is not None and self.v is not None) or self.energy is not None:
            both = np.concatenate([q, rate]) @ shapes.T  # one pass over a large matrix
            self.fill(both[: q.shape[0]] + base, both[q.shape[0] :], some)
        elif self.x is not None:
            self.x[some] = q @ shapes.T + base
        elif self.v is not None:
            self.v[some] = rate @ shapes.T

    def fill(self, x: Floats, v: Floats, some: slice) -> None:
        """Fill in what is wanted from x and v, of all dofs where the energy is wanted."""
        dofs = self.problem.wanted_dofs
        whole = x.shape[1] == self.problem.system.n
        if self.x is not None:
            self.x[some] = x[:, dofs] if whole else x
        if self.v is not None:
            self.v[some] = v[:, dofs] if whole else v
        if self.energy is not None:
            system, law = self.problem.system, self.problem.limiter
            force = self.structure.force
            energy = 0.5 * (v * (system.M @ v.T).T).sum(axis=1)
            energy += (x * (0.5 * (system.K @ x.T).T - force)).sum(axis=1)
            if law is not None:
                energy += law.potential(x @ self.structure.W.T, law.sizes(system))
            self.energy[some] = energy

    @property
    def drift(self) -> float | None:
        """The largest change of the energy relative to it, where it is conserved."""
        if self.energy is None or self.energy.size == 0 or not conserves(self.problem):
            return None
        size = float(np.abs(self.energy).max())
        return float(np.abs(self.energy - self.energy[0]).max()) / size if size > 0.0 else 0.0


def conserves(problem: Problem) -> bool:
    """Whether nothing takes energy from the motion or gives it."""
    system = problem.system
    lossless = system.C is None and not problem.load
    if problem.limiter is None:
        lossless &= all(c.restitution == 1.0 for c in system.constraints)
    return lossless


def _bare(problem: Problem, history: _History) -> dict[str, Any]:
    """Return the history and, for methods that know no more, empty tables."""
    found, none, outputs = empty(), np.zeros(0), problem.outputs
    if outputs & {"x", "v", "energy"}:
        found.update(t=problem.times, x=history.x, v=history.v, energy=history.energy)
    if outputs & {"x", "v"}:
        found["dof"] = problem.wanted_dofs
    for table in outputs & {"impacts", "contacts"}:
        for name in found:
            if name.startswith(table[:-1] + "_"):
                whole = name.endswith(("_constraint", "_side"))
                found[name] = none.astype(np.int64) if whole else none
    found.update(
        count_impacts=0,
        count_grazings=0,
        count_expansions=0,
        error_condition=1.0,
        error_penetration=0.0,
        error_predictable_until=problem.t_end,
        error_tolerance=TOLERANCE if problem.tolerance is None else problem.tolerance,
        error_energy_drift=history.drift,
        error_statement="",
    )
    return found


def _result(problem: Problem, run: Run, history: _History) -> Result:
    outputs, scale = problem.outputs, run.scale
    found = _bare(problem, history)
    at = _joined(run.impacts.at, (0, 2))
    times = (at[:, 0] + at[:, 1]) / scale
    growth = _joined(run.impacts.growth, (0,))
    if "impacts" in outputs:
        where = _joined(run.impacts.where, (0, 2)).astype(np.int64)
        what = _joined(run.impacts.what, (0, 3)) * scale
        found.update(
            impact_time=times,
            impact_constraint=where[:, 0],
            impact_side=where[:, 1],
            impact_velocity=what[:, 0],
            impact_impulse=what[:, 1],
            impact_condition=growth,
        )
    if "contacts" in outputs:
        rests = run.rests
        found.update(
            contact_start=np.array([r.start for r in rests]) / scale,
            contact_rest=np.array([r.rest for r in rests]) / scale,
            contact_stop=np.array([r.stop for r in rests]) / scale,
            contact_constraint=np.array([r.contact[0] for r in rests], dtype=np.int64),
            contact_side=np.array([r.contact[1] for r in rests], dtype=np.int64),
            contact_impulse=np.array([r.impulse for r in rests]) / scale,
        )
    tolerance = found["error_tolerance"]
    lost = np.flatnonzero(growth * 4.0 * _EPS > tolerance)
    found.update(
        count_impacts=run.impacts.count,
        count_grazings=int(run.counts[8]),
        count_expansions=int(run.counts[2]),
        error_condition=float(max(growth.max(initial=1.0), run.growth)),
        error_penetration=float(run.clock[6]),
        error_predictable_until=float(times[lost[0]]) if lost.size else problem.t_end,
        error_statement=_STATEMENT,
    )
    return Result(**found)


def _joined(pieces: list[Any], shape: tuple[int, ...]) -> Any:
    return np.concatenate(pieces) if pieces else np.zeros(shape)
