"""Decides how bands are found and what is left out."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum

import numpy as np

from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers import receptance, spectrum, stability
from vibroimpact_solvers.errors import ModelError, PlanError
from vibroimpact_solvers.existence_bands.problem import KIND, OUTPUTS, Problem
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step

_SAMPLES = 60.0  # radii looked at in a band, about
_POINTS = 4000.0  # members looked at, about
_MOST = 1e7  # poles at most: they are held in memory, and nobody waits for more
_SOFT = 1e-12  # eigenvalues down to minus this part of the largest count as zero


class Method(StrEnum):
    """How bands are found."""

    CERTIFIED = "branch and bound"
    SEARCH = "search"


def plan(problem: Problem) -> Plan:
    """Decide how the bands are found and what is left out."""
    grows = "stability" in problem.outputs and _has_growth(problem)
    steps = tuple(_steps(problem, grows=grows))
    return Plan(KIND, steps, tuple(_skips(problem, steps, grows=grows)))


def split(problem: Problem, plan: Plan, seconds_each: float) -> list[Problem]:
    """Return the problem as its only piece: bands must not be cut."""
    return [problem]


def _why_not_provable(problem: Problem) -> str | None:
    """Return why bands have to be searched for, None where they can be proved."""
    system = problem.system
    struck = [system.constraints[index] for index in problem.active]
    if len(struck) > 1:
        return "several limiters are struck"
    if not struck[0].symmetric:
        return "the walls are not equally far"
    if system.force is not None and system.force.any():
        return "a static load acts"
    shift = _SOFT * spectrum.largest_frequency(system) ** 2
    if system.chain is None and not system.K.plus(shift, system.M).is_positive_definite():
        return "the structure alone is unstable"
    return None


def _steps(problem: Problem, *, grows: bool) -> Iterator[Step]:
    system = problem.system
    phase = spectrum.largest_frequency(system) / problem.start
    _check_poles(0.5 * phase)
    partial = _partial_step(problem)
    if partial is not None:
        yield partial
        reason = (
            "the poles are all known, the members between them by partial modes: edges by bisection"
        )
        yield Step(Stage.BANDS, Method.SEARCH, reason, 5e6 * _POINTS, 64.0 * _POINTS)
        return
    method = spectrum.choose(system)
    if spectrum.nbytes(system, method) > spectrum.MEMORY:
        message = f"bands need all natural modes, too many with {system.n} degrees of freedom"
        raise PlanError(message)
    yield spectrum.step(system, method)
    poles = system.n * (1.0 + 0.5 * phase)
    _check_poles(poles)
    limits = float(len(system.constraints))
    obstacle = _why_not_provable(problem)
    if obstacle is None:
        reason = (
            "one limiter with equal gaps: the sign of the impulse between neighbouring poles, "
            "then boxes of frequency and time over which bounds decide; no band can hide"
        )
        flops = poles * (3e3 + 1e2 * phase) * system.n * limits
        yield Step(Stage.BANDS, Method.CERTIFIED, reason, flops, 64.0 * poles)
    else:
        reason = f"{obstacle}: members between all poles, edges by bisection"
        flops = poles * 20.0 * system.n * (100.0 + 50.0 * phase) * limits
        yield Step(Stage.BANDS, Method.SEARCH, reason, flops, 64.0 * poles)
    if grows:
        reason = "multipliers of the half-period map at frequencies of every band"
        flops = 0.5 * poles * _SAMPLES * 25.0 * (2.0 * system.n) ** 3
        yield Step(Stage.STABILITY, "half-period map", reason, flops, 64.0 * poles)


def _check_poles(count: float) -> None:
    """Refuse ranges that begin so far below the spectrum that their poles cannot be listed.

    Harmonics of every order meet natural frequencies: there are about N / 2 times the ratio of
    the largest natural frequency and the lower end of the range.
    """
    if count > _MOST:
        message = (
            f"the range begins so far below the largest natural frequency that the impulse has "
            f"{count:.0e} poles above it; there may be {_MOST:.0e}"
        )
        raise ModelError(("frequency", "start"), message, code="out_of_range")


def _partial_step(problem: Problem) -> Step | None:
    """Return the step that finds only modes around harmonics, None where all modes pay."""
    system = problem.system
    members = problem.members(np.array([problem.start, problem.stop]), frozenset({"reason"}))
    if "stability" in problem.outputs or not modes.allows_partial(members):
        return None
    bound = spectrum.largest_frequency(system)
    odd = np.arange(1.0, bound / problem.start + 2.0, 2.0)
    width = receptance.size(system.n, bound)
    low, high = (odd * problem.start) ** 2, np.minimum(odd * problem.stop, bound) ** 2
    all_cells = np.ceil(system.n / receptance.MODES)
    cells = float(min(np.sum(np.ceil(np.maximum(high - low, 0.0) / width) + 1.0), all_cells))
    flops = cells * modes.cell_flops(members)
    method = spectrum.choose(system)
    fits = spectrum.nbytes(system, method) <= spectrum.MEMORY
    if fits and flops > 0.5 * spectrum.flops(system, method):
        return None
    reason = (
        f"of {system.n} natural modes only those around {odd.size} harmonics, in {cells:.0f} cells "
        "of frequency: none missed by the inertia of factors, the others by a series"
    )
    size = 8.0 * cells * 128.0 * len(system.constraints)
    return Step(Stage.SPECTRUM, receptance.METHOD, reason, flops, size, int(cells))


def _has_growth(problem: Problem) -> bool:
    """Whether deviations grow the same in whatever order simultaneous impacts come."""
    members = problem.members(np.array([problem.start]), frozenset({"stability"}))
    return modes.plan(members).step(Stage.STABILITY) is not None


def _skips(problem: Problem, steps: tuple[Step, ...], *, grows: bool) -> Iterator[Skip]:
    yield Skip("shapes, energies and amplitudes", "no output needs them")
    if any(step.method == Method.CERTIFIED for step in steps):
        yield Skip("a grid of frequencies", "poles and bounds make the bands complete without one")
        if len(problem.system.constraints) == 1:
            why = "with one limiter and Omega > Omega_N every member exists"
            yield Skip("the proof above the spectrum", why)
    idle = [i for i in range(len(problem.system.constraints)) if i not in problem.active]
    if idle:
        listed = ", ".join(str(i) for i in idle)
        yield Skip(f"impulses at constraints {listed}", "not active; their limits are checked")
    if "stability" in problem.outputs and not grows:
        yield Skip("stability", stability.DIRECTION_DEPENDENT)
    for name in OUTPUTS:
        if name not in problem.outputs:
            yield Skip(name, "not asked")
