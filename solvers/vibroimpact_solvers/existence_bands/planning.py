"""Choice of the methods for existence bands, and of what is left out."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum

import numpy as np

from vibroimpact_solvers import impact_modes as modes
from vibroimpact_solvers import receptance, spectrum, stability
from vibroimpact_solvers.body import once_per_body
from vibroimpact_solvers.errors import ModelError, PlanError
from vibroimpact_solvers.existence_bands.problem import KIND, OUTPUTS, Problem
from vibroimpact_solvers.model import System
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step

_BANDS = 0.7  # power of the number of poles with which that of bands grows, about
_SAMPLES = 60.0  # spectral radii computed in a band, about
_POLE = 2e5  # operations for the impact modes about one in a search
_POINTS = 4000.0  # impact modes computed in a search, about
_MOST = 1e7  # poles at most: they are kept in memory, and more take too long
_SOFT = 1e-12  # eigenvalues down to minus this part of the largest count as zero


class Method(StrEnum):
    """Methods for existence bands."""

    CERTIFIED = "branch and bound"
    SEARCH = "search"
    ONE_SOLUTION = "one solution"


def plan(problem: Problem) -> Plan:
    """Choose how the bands are computed and what is left out."""
    growth = _growth(problem) if "stability" in problem.outputs else None
    steps = tuple(_steps(problem, growth))
    return Plan(KIND, steps, tuple(_skips(problem, steps, grows=growth is not None)))


def _why_not_provable(problem: Problem) -> str | None:
    """Return why bands have to be searched for, None if they can be proved."""
    system = problem.system
    struck = [system.constraints[index] for index in problem.active]
    if len(struck) > 1:
        return "there are impacts at several limiters"
    if not struck[0].symmetric:
        return "the gaps are unequal"
    if system.loaded:
        return "a static load acts"
    if system.chain is None and _is_unstable(system):
        return "the structure without limiters is unstable"
    return None


@once_per_body
def _is_unstable(system: System) -> bool:
    """Whether a structure that nothing limits has growing motions."""
    shift = _SOFT * spectrum.largest_frequency(system) ** 2
    return not system.K.plus(shift, system.M).is_positive_definite()


def _steps(problem: Problem, growth: Step | None) -> Iterator[Step]:
    system = problem.system
    phase = spectrum.largest_frequency(system) / problem.start
    _check_poles(problem, 0.5 * phase)
    if not (system.K.data.any() or system.loaded):
        yield spectrum.step(system, spectrum.choose(system))
        reason = "without stiffness and load each solution is admissible at all frequencies or none"
        yield Step(Stage.BANDS, Method.ONE_SOLUTION, reason, 1e4 * system.n, 64.0)
        if growth is not None:
            yield _stability_step(growth, 2.0)
        return
    obstacle, method = _why_not_provable(problem), spectrum.choose(system)
    fits = spectrum.nbytes(system, method) <= spectrum.MEMORY
    proves = problem.resolution is not None and obstacle is None and fits
    # Natural frequencies are half of the largest one, on average.
    inside = system.n * (1.0 + 0.25 * phase * (1.0 - problem.start / problem.stop))
    partial = None if proves else _partial_step(problem)
    if partial is not None:
        _check_poles(problem, inside)
        yield partial
        reason = "impact modes between all poles by partial modes, edges by bisection"
        points = max(_POINTS, inside)
        yield Step(Stage.BANDS, Method.SEARCH, reason, 5e6 * points, 64.0 * points, bounded=False)
        return
    if not fits:
        message = f"bands need all natural modes, too many with {system.n} degrees of freedom"
        raise PlanError(message, ("system",))
    yield spectrum.step(system, method)
    poles = system.n * (1.0 + 0.5 * phase)
    _check_poles(problem, poles)
    if problem.resolution is not None:
        poles = min(poles, problem.grid.size)
    limits = float(len(system.constraints))
    if obstacle is None:
        reason = (
            "one limiter with equal gaps: the sign of the impulse between neighbouring poles, "
            "then bounds over boxes of frequency and time"
        )
        if problem.resolution is None:
            reason += "; no band can be missed"
        else:
            inside = min(inside, float(problem.grid.size))
            reason += (
                f", about {problem.grid.size} frequencies: no band as wide as the resolution can "
                "be missed"
            )
        # For one pole, as measured of chains and beams: of the fastest modes few boxes are narrow.
        flops = inside * (4e5 + 1.3e4 * system.n) * limits
        yield Step(Stage.BANDS, Method.CERTIFIED, reason, flops, 64.0 * poles, bounded=False)
    else:
        reason = f"{obstacle}: impact modes between all poles, edges by bisection"
        flops = poles * _POLE * limits
        yield Step(Stage.BANDS, Method.SEARCH, reason, flops, 64.0 * poles, bounded=False)
    if growth is not None:
        yield _stability_step(growth, poles)


def _stability_step(one: Step, poles: float) -> Step:
    """Return the step for the stability of bands, of that for one motion."""
    # Of many poles few are ends of bands.
    flops = 0.5 * poles**_BANDS * _SAMPLES * one.flops
    reason = f"at frequencies of every band: {one.reason}"
    return Step(Stage.STABILITY, one.method, reason, flops, 64.0 * poles, bounded=False)


def _check_poles(problem: Problem, count: float) -> None:
    """Refuse ranges that begin so far below the spectrum that their poles cannot be listed.

    Harmonics of every order coincide with natural frequencies: there are about N / 2 times the
    ratio of the largest natural frequency to the lower end of the range.
    """
    if problem.resolution is None and count > _MOST:
        message = (
            f"the range begins so far below the largest natural frequency that the impulse has "
            f"{count:.0e} poles above it, of which at most {_MOST:.0e} can be listed: ask for a "
            "`resolution`, such as 1e-3"
        )
        raise ModelError(("frequency", "start"), message, code="out_of_range")


def _partial_step(problem: Problem) -> Step | None:
    """Return the step for the modes near the harmonics, None if all modes cost less."""
    system = problem.system
    ends = problem.impact_modes_at(np.array([problem.start, problem.stop]), frozenset({"reason"}))
    if "stability" in problem.outputs or not modes.can_use_partial_modes(ends):
        return None
    bound = spectrum.largest_frequency(system)
    odd = np.arange(1.0, bound / problem.start + 2.0, 2.0)
    width = receptance.interval_width(system.n, bound)
    low, high = (odd * problem.start) ** 2, np.minimum(odd * problem.stop, bound) ** 2
    every = np.ceil(system.n / receptance.MODES_PER_INTERVAL)
    intervals = float(min(np.sum(np.ceil(np.maximum(high - low, 0.0) / width) + 1.0), every))
    flops = intervals * modes.interval_flops(ends)
    method = spectrum.choose(system)
    fits = spectrum.nbytes(system, method) <= spectrum.MEMORY
    if fits and flops > 0.5 * spectrum.flops(system, method):
        return None
    reason = (
        f"of {system.n} natural modes only those near {odd.size} harmonics, in {intervals:.0f} "
        "intervals of frequency: their number proved by Sylvester's law of inertia, the others by "
        "a series"
    )
    size, count = 8.0 * intervals * 128.0 * len(system.constraints), int(intervals)
    expansion = receptance.ExpansionSize.of(ends.tolerance)
    return Step(Stage.SPECTRUM, receptance.METHOD, reason, flops, size, count, expansion)


def _growth(problem: Problem) -> Step | None:
    """Return the step for the stability of one motion, None if the order of impacts matters."""
    one = problem.impact_modes_at(np.array([problem.start]), frozenset({"stability"}))
    return modes.plan(one).step(Stage.STABILITY)


def _skips(problem: Problem, steps: tuple[Step, ...], *, grows: bool) -> Iterator[Skip]:
    yield Skip("shapes, energies and amplitudes", "no output depends on them")
    if any(step.method == Method.CERTIFIED for step in steps):
        yield Skip("a grid of frequencies", "poles and bounds make the bands complete without one")
        if len(problem.system.constraints) == 1:
            why = "with one limiter and Omega > Omega_N every impact mode exists"
            yield Skip("the proof above the spectrum", why)
    if any(step.method == Method.ONE_SOLUTION for step in steps):
        why = "without stiffness the paths between impacts are straight lines at every one"
        yield Skip("other frequencies", why)
    yield from modes.inactive_constraints(problem.system.constraints, problem.active)
    if "stability" in problem.outputs and not grows:
        yield Skip("stability", stability.DIRECTION_DEPENDENT)
    for name in OUTPUTS:
        if name not in problem.outputs:
            yield Skip(name, "not requested")
