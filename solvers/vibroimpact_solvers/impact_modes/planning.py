"""Choice of the methods for impact modes, and of what is left out; `solving` only follows it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from vibroimpact_solvers import condensation, receptance, spectrum, stability
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.impact_modes import costs, extended
from vibroimpact_solvers.impact_modes.family import Family, Kind
from vibroimpact_solvers.impact_modes.problem import KIND, OUTPUTS, Problem
from vibroimpact_solvers.matrices import Form
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step

NO_RADII: Final = (
    "without losses the spectral radius is 1, or leaves 1 as a square root: its derivatives are "
    "not computed"
)
_FEW = 16  # frequencies up to which ball arithmetic decides what is open
_DIRECT_CHECK = 1e9  # operations of the check of a path by series, for each harmonic
_IN_BALLS = 2e6  # flops for each frequency: one in some hundred is open
_SPREAD = 100.0  # root of what the fastest frequency may be over the slowest one
_SERIES = 5e5  # operations of a series, of which there is one at each frequency
_SERIES_FROM = 1.001  # start of the series, over the largest natural frequency
_SERIES_FROM_WITHOUT_FACTORS = 1.1  # the same without factorizations
_DERIVATIVE = 100.0  # operations of a derivative for each mode and frequency


@dataclass(frozen=True, slots=True)
class SeriesRange:
    """Where displacements come from the power series instead of the modal sum."""

    start: float  # lowest Omega of the series, over the largest natural frequency
    # Whether harmonics above it are solved for by factorizations, or by the modal sum
    factorizes: bool


@dataclass(frozen=True, slots=True)
class PathCheck:
    """Where the path between impacts is checked."""

    above_spectrum: bool  # whether for Omega > Omega_N too
    in_balls: bool  # whether ball arithmetic decides what double precision leaves open


def plan(problem: Problem) -> Plan:
    """Choose how the impact modes are computed and what is left out."""
    if problem.parameters or not _direct_pays(problem):
        return all_modes_plan(problem)
    family = Family.of(problem)
    steps = tuple(_direct_steps(problem))
    return Plan(KIND, steps, tuple(_skips(problem, family, steps)))


def all_modes_plan(problem: Problem) -> Plan:
    """Return the plan with all natural modes: for searches that have them."""
    family = Family.of(problem)
    steps = tuple(_modal_steps(problem, family))
    return Plan(KIND, steps, tuple(_skips(problem, family, steps)))


def partial_modes_plan(problem: Problem) -> Plan:
    """Return the plan by the natural modes near the harmonics, whatever it costs."""
    partial = costs.partial_step(problem, at_any_price=True)
    others = [step for step in _direct_steps(problem) if step.stage is not Stage.SPECTRUM]
    return Plan(KIND, tuple(others if partial is None else [partial, *others]))


def steps_like(plan: Plan, problem: Problem) -> tuple[Step, ...]:
    """Return the steps of a problem by the methods of a plan."""
    if has_all_modes(plan):
        return tuple(_modal_steps(problem, Family.of(problem)))
    return tuple(_direct_steps(problem))


def can_use_partial_modes(problem: Problem) -> bool:
    """Whether the solutions can be found without all natural modes, of which there are many."""
    system = problem.system
    if system.massless.size:
        return False  # series and counts of modes take a mass matrix that is positive definite
    antisymmetric = Family.of(problem).kind is Kind.ANTISYMMETRIC
    return antisymmetric and system.n > costs.ALWAYS_MODAL and costs.can_factorize(system)


def decides_in_balls(problem: Problem) -> bool:
    """Whether solutions that double precision leaves open are decided in ball arithmetic.

    One takes some hundredths of a second. Grids of frequencies do without.
    """
    return problem.system.n <= extended.LARGEST and problem.omega.size <= _FEW


def plan_in_doubles(problem: Problem) -> Plan:
    """Return that plan without ball arithmetic: for searches that ask again and again."""
    whole = all_modes_plan(problem)
    return replace(whole, steps=tuple(map(_in_doubles, whole.steps)))


def _in_doubles(step: Step) -> Step:
    if isinstance(step.settings, PathCheck):
        return replace(step, settings=replace(step.settings, in_balls=False))
    return step


def method_depends_on_frequencies(problem: Problem) -> bool:
    """Whether other frequencies may lead to another method, so that responses are not shared."""
    return problem.system.n > costs.ALWAYS_MODAL


def has_all_modes(plan: Plan) -> bool:
    """Whether a plan uses all natural modes."""
    step = plan.step(Stage.SPECTRUM)
    return step is not None and step.method != receptance.METHOD


def _modal_steps(problem: Problem, family: Family) -> Iterator[Step]:
    """Yield the steps by all natural modes."""
    system, points = problem.system, problem.omega.size
    method = spectrum.choose(system)
    _check_size(problem, method)
    yield spectrum.step(system, method)
    yield _impulse_step(problem, family)
    if problem.outputs & {"exists", "reason", "stability"}:
        yield _existence_step(problem, family)
    with_series = family.kind is Kind.ANTISYMMETRIC and _sums_without_cancelling(problem)
    for _, stage, times in _displacements(problem):
        dofs = problem.output_dofs.size
        flops = points * times * system.n * (2.0 * dofs + 40.0)
        reason = f"{dofs} of {system.n} degrees of freedom at {times} times"
        series, chosen = None, "modal sum"
        if with_series:
            solves = costs.can_factorize(system)
            chosen = "modal sum, above the spectrum direct"
            start = _SERIES_FROM if solves else _SERIES_FROM_WITHOUT_FACTORS
            series = SeriesRange(start, solves)
            above = problem.sample > start * spectrum.largest_frequency(system)
            flops += _SERIES * points * float(above.mean())
            reason += (
                f"; where Omega > {series.start:.2g} Omega_N the modal sum cancels, the series "
                "keeps the digits of every entry"
            )
        yield Step(
            stage, chosen, reason, flops, 8.0 * points * (times + 1.0) * dofs, settings=series
        )
    if "energy" in problem.outputs:
        reason = "the energy of each mode is constant"
        yield Step(Stage.ENERGY, "modal sum", reason, 40.0 * points * system.n, 8.0 * points)
    if "stability" in problem.outputs and _impacts_commute(problem):
        how = stability.choose(family.impacts)
        flops = points * stability.flops(system.n, how)
        why, size = stability.reason(how), 16.0 * points
        yield Step(Stage.STABILITY, how, why, flops, size, bounded=False)
    if problem.parameters:
        yield _derivatives_step(problem, family)


def _derivatives_step(problem: Problem, family: Family) -> Step:
    count, points, n = len(problem.parameters), problem.omega.size, problem.system.n
    times = sum(times for _, _, times in _displacements(problem))
    components = 1.0 if family.kind is Kind.ANTISYMMETRIC else 2.0
    structural = sum(each.structural for each in problem.parameters)
    flops = _DERIVATIVE * count * points * n * components * (1.0 + 0.5 * times)
    flops += 2.0 * structural * n**3 + 8.0 * count * points * times * n * problem.output_dofs.size
    each = 4.0 * family.count + 2.0 * times * problem.output_dofs.size + 4.0
    plural = "s" if count > 1 else ""
    reason = (
        f"by {count} parameter{plural}: the equations of the impulses, differentiated, with the "
        "rates of the natural modes; nothing is computed twice"
    )
    return Step(Stage.DERIVATIVES, "linear equations", reason, flops, 8.0 * points * count * each)


def _sums_without_cancelling(problem: Problem) -> bool:
    """Whether no entry of the power series is a small difference of larger numbers.

    It is so under impulses at single degrees of freedom where masses are lumped and springs join
    neighbours. With a full M it would be as uncertain as the condition number of M makes it.
    """
    M, K = problem.system.M, problem.system.K
    if problem.system.massless.size:
        return False
    single = all(len(one.coordinate) == 1 for one in problem.struck)
    return single and M.form is Form.DIAGONAL and K.joins_by_springs


def _check_size(problem: Problem, method: spectrum.Method) -> None:
    """Refuse natural modes and maps that are too large."""
    system = problem.system
    if spectrum.nbytes(system, method) > spectrum.MEMORY:
        if system.massless.size:
            message = (
                f"all natural modes of the {system.n - system.massless.size} degrees of freedom "
                f"with mass take more than {spectrum.MEMORY / 1e9:.0f} GB, and they are needed "
                "where others have no mass: reduce the model first (vibroimpact.reduce)"
            )
            raise PlanError(message, ("system",))
        message = (
            f"all natural modes of {system.n} degrees of freedom take more than "
            f"{spectrum.MEMORY / 1e9:.0f} GB; without them only impulses, shapes and energy of "
            "limiters with equal gaps and no static load can be computed, in banded or sparse "
            "structures"
        )
        raise PlanError(message, ("system",))
    modes = system.n - system.massless.size
    if "stability" in problem.outputs and modes > stability.LARGEST:
        message = (
            f"stability needs the multipliers of a map of {2 * modes} deviations, more than "
            f"{2 * stability.LARGEST}: leave the output out"
        )
        raise PlanError(message, ("outputs",))


def _direct_steps(problem: Problem) -> Iterator[Step]:
    """Yield the steps without all natural modes."""
    system, points = problem.system, problem.omega.size
    bound = spectrum.largest_frequency(system)
    partial = costs.partial_step(problem)
    if partial is not None:
        yield partial
    needed, depths, _ = receptance.truncations(bound, problem.sample, receptance.IMPULSES)
    harmonics, terms = problem.total(needed), int(depths.max())
    reason = f"no natural modes: {terms} powers of the structure bounded by Omega_N <= {bound:.4g}"
    if harmonics and partial is None:
        reason += f" and {harmonics / points:.1f} harmonics solved at each frequency"
    elif harmonics:
        reason = (
            f"{harmonics / points:.1f} harmonics at each frequency by partial modes, all others "
            f"by {terms} powers of the structure bounded by Omega_N <= {bound:.4g}"
        )
    solves = costs.solves_flops(problem, partial)
    work = solves + costs.products_flops(problem)
    yield Step(Stage.IMPULSE, "direct", reason, work, _size(points, len(problem.active)))
    if problem.outputs & {"exists", "reason"}:
        # Only the limited coordinates are evaluated, by series of few coordinates.
        existence = solves + _DIRECT_CHECK * max(points, harmonics)
        yield replace(_existence_step(problem, Family.of(problem)), flops=existence)
    for name, stage, times in _displacements(problem):
        dofs = problem.output_dofs.size
        reason = f"{dofs} of {system.n} degrees of freedom at {times} times"
        flops = 4.0 * terms * points * times * dofs + 2.0 * work
        if name == "harmonics" and partial is None:
            flops = points * times * spectrum.factor_flops(system)
        yield Step(stage, "direct", reason, flops, 8.0 * points * (times + 1.0) * dofs)
    if "energy" in problem.outputs:
        reason = "from the response at the constraints and its slope"
        yield Step(Stage.ENERGY, "direct", reason, work, 8.0 * points)


def _impulse_step(problem: Problem, family: Family) -> Step:
    n, count, points = problem.system.n, family.count, problem.omega.size
    if family.kind is Kind.ANTISYMMETRIC and count == 1:
        reason = "one constraint: a division for each frequency (eq. 10.53)"
        return Step(Stage.IMPULSE, "scalar", reason, 8.0 * n * points, _size(points, 1))
    reasons = {
        Kind.ANTISYMMETRIC: f"{count} coupled constraints: one small system of equations for each "
        "frequency (eq. 10.88)",
        Kind.SEPARATE: "unequal gaps or a load: one system of equations for the sum and one for "
        "the difference of the impulses at both walls",
        Kind.JOINT: "limiters with one wall: one system of equations for the impulses at the "
        "walls that exist",
    }
    size = len(family.upper) + len(family.lower)
    sides = count if family.kind is Kind.ANTISYMMETRIC else 2 * count
    work = points * (120.0 * n + 8.0 * n * size**2 + 20.0 * (size + 2) ** 3)
    return Step(Stage.IMPULSE, "bordered", reasons[family.kind], work, _size(points, sides))


def _size(points: int, count: int) -> float:
    """Return the bytes of the frequencies, and of impulses, momenta and their errors."""
    return (32.0 + 32.0 * count) * points


def _existence_step(problem: Problem, family: Family) -> Step:
    limits = len(problem.system.constraints)
    reason = (
        "signs of impulses and pre-impact velocities, then a certified check of the path between "
        "impacts, in steps within which no limit can be exceeded"
    )
    # Steps are as long as the motion of the limited coordinates allows, in which slow modes of
    # about the frequency of the motion move more than fast ones: half as many decades from each.
    # Where all modes are faster than the motion, the slowest one counts instead of it.
    with np.errstate(over="ignore"):  # infinitely many steps: such a plan is refused by its price
        ratio = spectrum.largest_frequency(problem.system) / problem.sample
        turns = 2.0 * np.pi * np.maximum(np.sqrt(ratio), ratio / _SPREAD)
    flops = problem.total(20.0 + turns) * limits * problem.system.n * 60.0
    size = 10.0 * problem.omega.size
    in_balls = decides_in_balls(problem)
    if in_balls:
        flops += _IN_BALLS * problem.omega.size
        reason += (
            f"; what double precision leaves open is decided in ball arithmetic, in at most "
            f"{extended.MOST} intervals of time each"
        )
    check = PathCheck(not _exists_above_spectrum(problem, family), in_balls)
    # Its rate counts on checks that end early.
    return Step(Stage.EXISTENCE, "certified", reason, flops, size, bounded=False, settings=check)


def _exists_above_spectrum(problem: Problem, family: Family) -> bool:
    """Whether all solutions with Omega > Omega_N exist: all terms of the velocity have one sign."""
    return family.kind is Kind.ANTISYMMETRIC and len(problem.system.constraints) == 1


def _impacts_commute(problem: Problem) -> bool:
    """Whether the order of simultaneous impacts does not matter."""
    if len(problem.active) == 1:
        return True
    rows = problem.system.directions(problem.active)
    return stability.commutes(rows @ condensation.solve_mass(problem.system)(rows.T))


def _displacements(problem: Problem) -> Iterator[tuple[str, Stage, int]]:
    """Yield the displacement outputs that are requested, and the number of times of each."""
    orders = problem.highest_harmonic // 2 + 1
    for name, stage, times in (
        ("shape", Stage.SHAPE, 1),
        ("waveform", Stage.WAVEFORM, problem.times.size),
        ("harmonics", Stage.HARMONICS, orders),
    ):
        if name in problem.outputs:
            yield name, stage, times


def _direct_pays(problem: Problem) -> bool:
    """Whether it is cheaper without all natural modes."""
    system, points = problem.system, problem.omega.size
    if not can_use_partial_modes(problem) or "stability" in problem.outputs:
        return False
    method = spectrum.choose(system)
    if spectrum.nbytes(system, method) > spectrum.MEMORY:
        return True
    # Whether the modes are cached does not count: a result must not depend on what was computed
    # before it, nor on which worker computes it.
    modal = spectrum.flops(system, method)
    times = sum(times for _, _, times in _displacements(problem))
    modal += points * system.n * (8.0 + 2.0 * times * problem.output_dofs.size)
    partial = costs.partial_step(problem)
    solves = costs.solves_flops(problem, partial) + (0.0 if partial is None else partial.flops)
    return solves + costs.products_flops(problem) < 0.5 * modal


def _skips(problem: Problem, family: Family, steps: tuple[Step, ...]) -> Iterator[Skip]:
    n, count = problem.system.n, family.count
    if has_all_modes(Plan(KIND, steps)):
        what = f"{n - count} of {n} rows of the modal matrix in the impulses"
        yield Skip(what, "only constrained coordinates enter them")
        yield from _nonparticipating_modes(problem)
    elif any(step.stage is Stage.SPECTRUM for step in steps):
        yield Skip("natural modes away from the harmonics", "a series replaces all of them")
    else:
        yield Skip("natural modes", "direct solves and a power series cost less")
    if family.kind is Kind.ANTISYMMETRIC:
        yield Skip("symmetric component of the motion", "equal gaps and no static load: it is zero")
    yield from inactive_constraints(problem.system.constraints, problem.active)
    if problem.outputs & {"exists", "reason"}:
        why = "no such impact mode exists"
        yield Skip("path check where an impulse is not positive", why)
        if _exists_above_spectrum(problem, family):
            why = "with one constraint and Omega > Omega_N every impact mode exists"
            yield Skip("path check above the spectrum", why)
    if problem.system.losses(problem.active):
        yield Skip("damping and restitution", "impact modes are motions without energy loss")
    if "stability" in problem.outputs:
        if any(step.stage is Stage.STABILITY for step in steps):
            yield Skip("stability of phantoms", "they are not motions of the structure")
        else:
            yield Skip("stability", stability.DIRECTION_DEPENDENT)
    for name in OUTPUTS:
        if name not in problem.outputs and name != "reason":
            yield Skip(name, "not requested")
    if not problem.parameters:
        yield Skip("derivatives", "not requested")
    elif "stability" in problem.outputs:
        yield Skip("derivatives of stability", NO_RADII)


def inactive_constraints(
    constraints: tuple[object, ...], active: tuple[int, ...]
) -> Iterator[Skip]:
    """Yield what is left out at the constraints that are not active."""
    struck = set(active)
    inactive = [str(i) for i in range(len(constraints)) if i not in struck]
    if inactive:
        listed = ", ".join(inactive)
        yield Skip(f"impulses at constraints {listed}", "not active; their limits are checked")


def _nonparticipating_modes(problem: Problem) -> Iterator[Skip]:
    """Yield the modes that take no part, where that is known without computing them."""
    chain, constraints = problem.system.chain, problem.struck
    if chain is None or any(len(c.coordinate) > 1 for c in constraints):
        return
    places = [c.coordinate[0][0] + 1 for c in constraints]
    period = math.lcm(*((chain.n + 1) // math.gcd(place, chain.n + 1) for place in places))
    modes = range(period, chain.n + 1, period)
    if modes:
        listed = ", ".join(str(j) for j in modes[:8]) + (", …" if len(modes) > 8 else "")
        yield Skip(f"modes {listed}", "they have a node at every active constraint")
