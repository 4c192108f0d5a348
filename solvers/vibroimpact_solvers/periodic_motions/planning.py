"""Choice of the methods for periodic motions, and of what is left out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import StrEnum

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.periodic_motions import along, free_bodies, stops
from vibroimpact_solvers.periodic_motions.problem import KIND, OUTPUTS, Problem
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step

_NODES = 60.0  # at which a solution is evaluated, about, while little turns in its period
_NODES_OF_A_RADIAN = 3.5
_NODE = 1e3  # operations at a node, whatever the structure is
_SLOW = 20.0  # modes of those that the quadrature follows where others are fast, at most
_CLOSED = 5.0  # operations of the quadrature for one of closed forms (`along`), by their rate
_WIDE = 4.0  # times what the quadrature has to follow, from which on fast vibrations are left out
_TURN = 20.0  # radians of what turns fastest in a period that count no more
# Bytes of the columns of a solution, with their errors; those of an extreme are for each dof.
_SOLUTION, _EXISTENCE, _EXTREMES, _ENERGIES, _STABILITY, _MULTIPLIER = 25, 26, 48, 48, 24, 32
_IMPACT = 88  # bytes of the columns of an impact, with their errors
_STARTS = 40.0  # of the search for a sequence, times steps
_SWEEPS = 8.0  # over the multipliers until all are settled


class Method(StrEnum):
    """How the phases of the impacts are found."""

    CLOSED_FORM = "closed form"
    SEARCH = "newton"


def plan(problem: Problem) -> Plan:
    """Choose how the motions are computed and what is left out.

    Raises
    ------
    ModelError
        Where the impacts clearly move a free body, see `free_bodies`; else the solution tells.
    """
    steps = tuple(stops.steps(problem) if problem.stopped else _steps(problem))
    return Plan(KIND, steps, tuple(_skips(problem)))


def _steps(problem: Problem) -> Iterator[Step]:
    system, count, outputs = problem.system, float(problem.Omega.size), problem.outputs
    method = spectrum.choose(system)
    size = spectrum.nbytes(system, method)
    if size > spectrum.MEMORY:
        message = f"the natural modes of the structure take more than {size / 1e9:.0f} GB"
        raise PlanError(message, ("system",))
    yield spectrum.step(system, method)
    none = free_bodies.expected(problem)
    modes, m = float(system.n), len(problem.impacts)
    # With one impact, mostly a motion without impacts and two with; more by high harmonics.
    each = 2.0 * _order(problem)
    rows = (1.0 + each) * count if m == 1 else 10.0 * count
    turns = _turns(problem)
    sides = 2.0 if problem.symmetric else 1.0
    struck = _IMPACT * sides * (each * count if m == 1 else rows * m)
    size = 8.0 * count + _SOLUTION * rows + struck
    if m == 1:
        reason = (
            "one impact in each half of the period: all solutions are roots of one "
            "trigonometric polynomial"
            if problem.symmetric
            else "one impact per period: all solutions are roots of one trigonometric polynomial"
        )
        flops = 300.0 * count * modes + 500.0 * each * count * len(problem.load)
        yield Step(Stage.IMPULSE, Method.CLOSED_FORM, reason + none, flops, size, bounded=False)
    else:
        reason = (
            f"{m} impacts per period: phases and impulses by Newton's method from many starts, "
            "which may miss a solution"
        )
        flops = 2e3 * count * _STARTS * m * m * modes
        yield Step(Stage.IMPULSE, Method.SEARCH, reason + none, flops, size, bounded=False)
    limits = float(len(system.constraints))
    if "exists" in outputs:
        reason = "bounds along all of the motion between impacts: no passage of a limit is missed"
        flops = rows * m * 100.0 * modes * (20.0 + 10.0 * limits) * max(1.0, turns / _TURN)
        size = _EXISTENCE * rows
        yield Step(Stage.EXISTENCE, "safe steps", reason, flops, size, bounded=False)
    dofs = float(problem.output_dofs.size)
    if {"extremes", "energy"} & outputs:
        reason, flops = _integrals(problem, rows, each * count if m == 1 else rows * m)
        extremes = _EXTREMES * dofs * ("extremes" in outputs)
        size = rows * (extremes + _ENERGIES * ("energy" in outputs))
        yield Step(Stage.ENERGY, "quadrature", reason, flops, size, bounded=False)
    if "waveform" in outputs:
        assert problem.tau is not None
        flops = rows * problem.tau.size * modes * (30.0 + 4.0 * dofs)
        size = 8.0 * rows * (problem.tau.size + 1.0) * dofs
        yield Step(Stage.WAVEFORM, "superposition", "as requested", flops, size, bounded=False)
    if {"stability", "multipliers"} & outputs:
        reason = "all zeros of a determinant of twice as many rows as impacts, at once"
        size = _STABILITY * rows
        if "multipliers" in outputs:
            size += _MULTIPLIER * 2.0 * modes * rows
        else:
            reason += "; the largest alone is refined"
        flops = rows * _SWEEPS * 2.0 * modes * (80.0 * m * m + 20.0) * modes
        name = "characteristic equation"
        yield Step(Stage.STABILITY, name, reason, flops, size, bounded=False)


def _integrals(problem: Problem, rows: float, legs: float) -> tuple[str, float]:
    """Return how integrals and extremes along solutions are found, and the operations of that.

    legs are free motions after impacts.
    """
    modes, dofs = float(problem.system.n), float(problem.output_dofs.size)
    extremes, energy = "extremes" in problem.outputs, "energy" in problem.outputs
    columns = dofs * extremes + modes * energy
    turns, by_load = _fastest_turns(problem), _load_turns(problem)
    slow = max(along.QUICKER * by_load, along.TURNED)
    reason = "quadrature over every free motion, exact to rounding"
    if turns <= _WIDE * slow:
        nodes = max(_NODES, _NODES_OF_A_RADIAN * turns)
        return reason, rows * nodes * (_NODE + 4.0 * columns * modes)
    reason = "quadrature of what is slow, exact to rounding; fast vibrations in closed form"
    nodes = _NODES_OF_A_RADIAN * slow
    flops = rows * nodes * (_NODE + 4.0 * columns * min(modes, _SLOW))
    closed = extremes * (along.SEARCH + along.SEARCHED * dofs * modes)
    closed += energy * along.PRODUCT * modes * modes
    return reason, flops + _CLOSED * legs * closed


def _order(problem: Problem) -> float:
    """Return about how often the load rises above its mean in a period of the drive.

    The zeros of sums of vibrations are those of one whose order is their root mean square. That
    of the velocities is taken which the forces cause by inertia.
    """
    orders = np.array([force.harmonic for force in problem.load], dtype=np.float64)
    middle = float(np.median(problem.Omega))
    sizes = np.array([force.at(middle).amplitude for force in problem.load])
    if not sizes.any():
        return 1.0
    sizes = sizes / np.abs(sizes).max()
    common = math.gcd(*(force.harmonic for force in problem.load))
    mean = np.sum(sizes**2) / np.sum((sizes / orders) ** 2)
    return max(1.0, math.sqrt(float(mean)) / common)


def _turns(problem: Problem) -> float:
    """Return by how many radians what turns fastest turns in a period, the mean one.

    Fast modes count where nothing damps them.
    """
    return _fastest_turns(problem) if problem.system.C is None else _load_turns(problem)


def _load_turns(problem: Problem) -> float:
    """Return by how many radians the highest harmonic of the load turns in a period."""
    highest = max((force.harmonic for force in problem.load), default=1)
    return 2.0 * math.pi * problem.periods * highest


def _fastest_turns(problem: Problem) -> float:
    """Return by how many radians the fastest mode, or the load, turns in a period, the mean one."""
    period = 2.0 * math.pi * problem.periods
    fastest = period * spectrum.largest_frequency(problem.system) / problem.Omega
    return float(np.maximum(_load_turns(problem), fastest).mean())


def _skips(problem: Problem) -> Iterator[Skip]:
    for name in OUTPUTS:
        if name not in problem.outputs:
            yield Skip(name, "not requested")
