"""Decides how members are computed and what is left out; `solving` follows and decides nothing."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from enum import StrEnum
from typing import Final

import numpy as np

from vibroimpact_solvers import receptance, spectrum, stability
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.cost import OVERHEAD_SECONDS, seconds
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.impact_modes.family import Family, Kind
from vibroimpact_solvers.impact_modes.problem import KIND, OUTPUTS, Problem
from vibroimpact_solvers.matrices import Form
from vibroimpact_solvers.model import System
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step

SMALL: Final = 256
"""Degrees of freedom up to which a full matrix is factorized at single frequencies."""
FAR: Final = 1.1
"""Where the series starts without factorizations, over the largest natural frequency."""

ALWAYS_MODAL: Final = 256
"""Degrees of freedom up to which natural modes are always worth finding."""

_MANY = 1000  # frequencies among which what all of them share does not count
_CROWD = 64  # harmonics per degree of freedom beyond which all cells are touched


class Impulse(StrEnum):
    """Methods for the impulses."""

    SCALAR = "scalar"
    BORDERED = "bordered"
    DIRECT = "direct"


class Displacement(StrEnum):
    """Methods for displacements and harmonics."""

    MODAL = "modal sum"
    MIXED = "modal sum, above the spectrum direct"
    DIRECT = "direct"


class Existence(StrEnum):
    """Methods for the existence of members."""

    CERTIFIED = "certified"


def plan(problem: Problem) -> Plan:
    """Decide how the members are computed and what is left out."""
    family = Family.of(problem)
    if family.kind is Kind.ODD and _direct_pays(problem):
        steps = tuple(_direct_steps(problem))
    else:
        steps = tuple(_modal_steps(problem, family))
    return Plan(KIND, steps, tuple(_skips(problem, family, steps)))


def partial_plan(problem: Problem) -> Plan:
    """Return the plan that goes by the natural modes around harmonics, whatever it costs."""
    waves = _partial_step(problem, at_any_price=True)
    others = [step for step in _direct_steps(problem) if step.stage is not Stage.SPECTRUM]
    return Plan(KIND, tuple(others if waves is None else [waves, *others]))


def allows_partial(problem: Problem) -> bool:
    """Whether members can be found without all natural modes, and there are many of these."""
    system = problem.system
    odd = Family.of(problem).kind is Kind.ODD
    return odd and system.n > ALWAYS_MODAL and factorizes(system)


def cell_flops(problem: Problem) -> float:
    """Estimated operations for the modes about one cell, and the series of the others."""
    system, reach = problem.system, receptance.Reach.of(problem.tolerance)
    kept = receptance.MODES * reach.factor
    solves = 2.5 * kept + reach.terms * len(problem.active)
    flops = 3.0 * _factor_flops(system) + solves * _solve_flops(system)
    return flops + 8.0 * system.n * kept**2


def factorizes(system: System) -> bool:
    """Whether direct solves at single frequencies are cheap."""
    return system.n <= SMALL or Form.DENSE not in {system.M.form, system.K.form}


def _modal_steps(problem: Problem, family: Family) -> Iterator[Step]:
    system, points = problem.system, problem.omega.size
    method = spectrum.choose(system)
    if spectrum.nbytes(system, method) > spectrum.MEMORY:
        message = (
            f"all natural modes of {system.n} degrees of freedom take more than "
            f"{spectrum.MEMORY / 1e9:.0f} GB; without them only impulses, shapes and energy of "
            "limiters with equal gaps and no static load can be found, in banded or sparse "
            "structures"
        )
        raise PlanError(message)
    if "stability" in problem.outputs and system.n > stability.LARGEST:
        message = (
            f"stability needs the multipliers of a map of {2 * system.n} deviations, more than "
            f"{2 * stability.LARGEST}: leave the output out"
        )
        raise PlanError(message)
    yield spectrum.step(system, method)
    yield _impulse_step(problem, family)
    if problem.outputs & {"exists", "reason", "stability"}:
        yield _existence_step(problem)
    mixed = family.kind is Kind.ODD
    for _, stage, times in _displacements(problem):
        dofs = problem.wanted_dofs.size
        flops = points * times * system.n * (2.0 * dofs + 40.0)
        reason = f"{dofs} of {system.n} degrees of freedom at {times} times"
        if mixed:
            start = 1.0 if factorizes(system) else FAR
            flops += 1e4 * points  # calls of the series, one frequency after another
            reason += (
                f"; where Omega > {start:g} Omega_N the sum over modes cancels, the series keeps "
                "the digits of every entry"
            )
        chosen = Displacement.MIXED if mixed else Displacement.MODAL
        yield Step(stage, chosen, reason, flops, 8.0 * points * times * dofs)
    if "energy" in problem.outputs:
        reason = "each mode holds a constant energy"
        yield Step(Stage.ENERGY, "modal sum", reason, 40.0 * points * system.n, 8.0 * points)
    if "stability" in problem.outputs and _impacts_commute(problem):
        reason = "multipliers of the map over half a period, from saltation matrices"
        flops = 50.0 * points * (2.0 * system.n) ** 3
        yield Step(Stage.STABILITY, "half-period map", reason, flops, 16.0 * points)


def has_all_modes(plan: Plan) -> bool:
    """Whether a plan goes by all natural modes."""
    step = plan.step(Stage.SPECTRUM)
    return step is not None and step.method != receptance.METHOD


def _direct_steps(problem: Problem) -> Iterator[Step]:
    system, points = problem.system, problem.omega.size
    bound = spectrum.largest_frequency(system)
    partial = _partial_step(problem)
    if partial is not None:
        yield partial
    needed, depths, _ = receptance.truncations(bound, problem.fundamental, receptance.IMPULSES)
    harmonics, terms = float(needed.sum()), int(depths.max())
    reason = f"no natural modes: {terms} powers of the structure bounded by Omega_N <= {bound:.4g}"
    if harmonics and partial is None:
        reason += f" and {harmonics / points:.1f} harmonics solved at each frequency"
    elif harmonics:
        reason = (
            f"{harmonics / points:.1f} harmonics at each frequency by partial modes, all others "
            f"by {terms} powers of the structure bounded by Omega_N <= {bound:.4g}"
        )
    waves = _factorized_flops(problem) if partial is None else 1e5 * harmonics
    work = waves + _products_flops(problem)
    yield Step(Stage.IMPULSE, Impulse.DIRECT, reason, work, 16.0 * points)
    if problem.outputs & {"exists", "reason"}:
        # Only the limited coordinates are followed, by series of few rows.
        yield replace(_existence_step(problem), flops=waves + 2e7 * points)
    for name, stage, times in _displacements(problem):
        dofs = problem.wanted_dofs.size
        reason = f"{dofs} of {system.n} degrees of freedom at {times} times"
        flops = 4.0 * terms * points * times * dofs + 2.0 * work
        if name == "harmonics" and partial is None:
            flops = points * times * _factor_flops(system)
        yield Step(stage, Displacement.DIRECT, reason, flops, 8.0 * points * times * dofs)
    if "energy" in problem.outputs:
        reason = "from the response at the constraints and its slope"
        yield Step(Stage.ENERGY, "direct", reason, work, 8.0 * points)


def _impulse_step(problem: Problem, family: Family) -> Step:
    n, count, points = problem.system.n, family.count, problem.omega.size
    if family.kind is Kind.ODD and count == 1:
        reason = "one constraint: a division for each frequency (eq. 10.53)"
        return Step(Stage.IMPULSE, Impulse.SCALAR, reason, 8.0 * n * points, 16.0 * points)
    reasons = {
        Kind.ODD: f"{count} constraints couple: one small system for each frequency (eq. 10.88)",
        Kind.SEPARATE: "unequal gaps or a load: one system for the sum and one for the "
        "difference of the impulses at both walls",
        Kind.JOINT: "limiters with one wall: one system for the impulses that are there",
    }
    size = len(family.upper) + len(family.lower)
    work = points * (120.0 * n + 8.0 * n * size**2 + 20.0 * (size + 2) ** 3)
    return Step(Stage.IMPULSE, Impulse.BORDERED, reasons[family.kind], work, 16.0 * points * size)


def _existence_step(problem: Problem) -> Step:
    limits = len(problem.system.constraints)
    reason = (
        "signs of impulses and pre-impact velocities, then a walk along the motion in steps "
        "that no limit can be passed in"
    )
    with np.errstate(over="ignore"):  # infinitely many, and so refused by whoever prices them
        steps = 20.0 + 4.0 * spectrum.largest_frequency(problem.system) / problem.omega
    flops = float(steps.sum()) * limits * problem.system.n * 60.0
    return Step(Stage.EXISTENCE, Existence.CERTIFIED, reason, flops, 10.0 * problem.omega.size)


def _impacts_commute(problem: Problem) -> bool:
    """Whether impacts struck together end the same in any order."""
    if len(problem.active) == 1:
        return True
    rows = problem.system.directions(problem.active)
    return stability.commutes(rows @ problem.system.M.factorize()(rows.T))


def _displacements(problem: Problem) -> Iterator[tuple[str, Stage, int]]:
    """Yield the displacement outputs that are asked, and at how many times each is taken."""
    orders = problem.highest_harmonic // 2 + 1
    for name, stage, times in (
        ("shape", Stage.SHAPE, 1),
        ("waveform", Stage.WAVEFORM, problem.times.size),
        ("harmonics", Stage.HARMONICS, orders),
    ):
        if name in problem.outputs:
            yield name, stage, times


def _direct_pays(problem: Problem) -> bool:
    """Whether it is cheaper to do without natural modes."""
    system, points = problem.system, problem.omega.size
    if system.n <= ALWAYS_MODAL or not factorizes(system) or "stability" in problem.outputs:
        return False
    method = spectrum.choose(system)
    if spectrum.nbytes(system, method) > spectrum.MEMORY:
        return True
    # Whether they are known already does not count: a result does not depend on what was
    # computed before it, nor on which worker computes it.
    modal = spectrum.flops(system, method)
    times = sum(times for _, _, times in _displacements(problem))
    modal += points * system.n * (8.0 + 2.0 * times * problem.wanted_dofs.size)
    return _direct_flops(problem) < 0.5 * modal


def _direct_flops(problem: Problem) -> float:
    partial = _partial_step(problem)
    waves = _factorized_flops(problem) if partial is None else partial.flops
    return waves + _products_flops(problem)


def _products_flops(problem: Problem) -> float:
    system = problem.system
    return 100.0 * 2.0 * (system.K.entries + system.M.entries) * len(problem.active)


def _factorized_flops(problem: Problem) -> float:
    return _wave_count(problem) * _factor_flops(problem.system)


def _wave_count(problem: Problem) -> float:
    """Return at how many frequencies the structure is driven, for all members."""
    orders = _orders(problem).size if "harmonics" in problem.outputs else 0
    return float(_harmonics(problem).sum()) + orders * problem.omega.size


def _harmonics(problem: Problem) -> Floats:
    """Return how many harmonics of each member are solved for."""
    bound = spectrum.largest_frequency(problem.system)
    return receptance.truncations(bound, problem.fundamental, receptance.IMPULSES)[0]


def _orders(problem: Problem) -> Floats:
    return np.arange(1.0, problem.highest_harmonic + 1.0, 2.0)


def _wave_frequencies(problem: Problem) -> Floats:
    """Return the frequencies at which the structure is driven, of all members."""
    counts = _harmonics(problem).astype(np.int64)
    first = np.cumsum(counts) - counts
    odd = 2.0 * (np.arange(counts.sum()) - np.repeat(first, counts)) + 1.0
    found = np.repeat(problem.fundamental, counts) * odd
    if "harmonics" in problem.outputs:
        asked = np.outer(problem.fundamental, _orders(problem)).ravel()
        return np.concatenate([found, asked])
    return found


def _partial_step(problem: Problem, *, at_any_price: bool = False) -> Step | None:
    """Return the step that finds modes around the harmonics, None where solving costs less."""
    system = problem.system
    waves = _wave_count(problem)
    if system.n <= ALWAYS_MODAL or not waves:
        return None
    bound, reach = spectrum.largest_frequency(system), receptance.Reach.of(problem.tolerance)
    if waves > _CROWD * system.n:
        cells = -(-system.n // receptance.MODES)
    else:
        cells = receptance.touched(system.n, bound, _wave_frequencies(problem))
    kept, each = receptance.MODES * reach.factor, cell_flops(problem)
    if not at_any_price and cells * each > waves * _factor_flops(system):
        return None
    places = problem.wanted_dofs.size if any(_displacements(problem)) else 0
    places += len(problem.system.constraints)
    size = 8.0 * cells * places * (kept + reach.terms * len(problem.active))
    reason = (
        f"few of {system.n} natural modes matter: about {kept} around each of {cells} cells in "
        f"which {waves:.0f} harmonics lie, none missed by the inertia of factors; the "
        f"others by their static correction in the cell and {reach.terms - 1} accelerations"
    )
    return Step(Stage.SPECTRUM, receptance.METHOD, reason, cells * each, size, cells)


def _solve_flops(system: System) -> float:
    """Estimated operations of one solve with factors at hand."""
    width = max(system.M.width, system.K.width)
    if Form.SPARSE in {system.M.form, system.K.form}:
        return 200.0 * system.n
    if Form.DENSE in {system.M.form, system.K.form}:
        return 2.0 * float(system.n) ** 2
    return 8.0 * system.n * (width + 2)


def _factor_flops(system: System) -> float:
    """Estimated operations of one factorization and solve at a frequency."""
    width = max(system.M.width, system.K.width)
    if Form.SPARSE in {system.M.form, system.K.form}:
        # Nested dissection of a planar mesh; three-dimensional ones cost more.
        return 20.0 * math.pow(system.n, 1.5)
    if Form.DENSE in {system.M.form, system.K.form}:
        return float(system.n) ** 3
    return 4.0 * system.n * (width + 1) ** 2 + 50.0 * system.n


def _skips(problem: Problem, family: Family, steps: tuple[Step, ...]) -> Iterator[Skip]:
    n, count = problem.system.n, family.count
    if has_all_modes(Plan(KIND, steps)):
        what = f"{n - count} of {n} rows of the modal matrix in the impulses"
        yield Skip(what, "only constrained coordinates enter them")
        yield from _silent_modes(problem)
    elif any(step.stage is Stage.SPECTRUM for step in steps):
        yield Skip("natural modes away from the harmonics", "a series stands for all of them")
    else:
        yield Skip("natural modes", "direct solves and a power series cost less")
    if family.kind is Kind.ODD:
        yield Skip("even motion", "equal gaps and no static load: it vanishes")
    idle = [i for i in range(len(problem.system.constraints)) if i not in problem.active]
    if idle:
        listed = ", ".join(str(i) for i in idle)
        yield Skip(f"impulses at constraints {listed}", "not active; their limits are checked")
    if problem.outputs & {"exists", "reason"}:
        yield Skip("the walk where an impulse is not positive", "no such member exists")
        if family.kind is Kind.ODD and len(problem.system.constraints) == 1:
            why = "with one constraint and Omega > Omega_N every member exists"
            yield Skip("the walk above the spectrum", why)
    if problem.system.C is not None or any(c.restitution < 1.0 for c in problem.struck):
        yield Skip("damping and restitution", "impact modes are motions without loss")
    if "stability" in problem.outputs:
        if any(step.stage is Stage.STABILITY for step in steps):
            yield Skip("stability of phantoms", "they are no motions")
        else:
            yield Skip("stability", stability.DIRECTION_DEPENDENT)
    for name in OUTPUTS:
        if name not in problem.outputs and name != "reason":
            yield Skip(name, "not asked")


def _silent_modes(problem: Problem) -> Iterator[Skip]:
    """Yield which modes take no part, where that is known without computing them."""
    chain, constraints = problem.system.chain, problem.struck
    if chain is None or any(len(c.coordinate) > 1 for c in constraints):
        return
    places = [c.coordinate[0][0] + 1 for c in constraints]
    period = math.lcm(*((chain.n + 1) // math.gcd(place, chain.n + 1) for place in places))
    silent = range(period, chain.n + 1, period)
    if silent:
        listed = ", ".join(str(j) for j in silent[:8]) + (", …" if len(silent) > 8 else "")
        yield Skip(f"modes {listed}", "they have a node at every active constraint")


def split(problem: Problem, plan: Plan, seconds_each: float) -> list[Problem]:
    """Cut a problem into deterministic pieces of about the given cost, by frequency.

    Pieces of equally spaced frequencies end at whole multiples of some number of steps from
    zero, so that a longer or shifted grid of the same steps has the same pieces.
    """
    size = problem.omega.size
    each = max(_seconds_of_one(problem, plan), OVERHEAD_SECONDS * 1e-3)
    points = max(1, int(seconds_each / each))
    first = -lattice_index(problem.fundamental) % points
    bounds = [0, *range(first or points, size, points), size]
    return [problem.slice(*pair) for pair in itertools.pairwise(bounds)]


def _seconds_of_one(problem: Problem, plan: Plan) -> float:
    """Return the price of one frequency beside others, the same for any grid of frequencies.

    It is that of half the largest natural frequency, by the methods of the plan.
    """
    middle = np.array([spectrum.largest_frequency(problem.system) / np.pi])
    many = replace(problem, omega=np.repeat(middle, _MANY), Omega=None, rests=None)
    if not has_all_modes(plan):
        steps = tuple(_direct_steps(many))
    else:
        steps = tuple(_modal_steps(many, Family.of(many)))
    own = tuple(step for step in steps if step.stage is not Stage.SPECTRUM)
    return seconds(Plan(KIND, own)) / _MANY


def lattice_index(points: Floats) -> int:
    """Return how many steps the first of equally spaced points lies from zero; else 0."""
    if points.size < 2:
        return 0
    step = float(points[-1] - points[0]) / (points.size - 1)
    if step <= 0.0 or np.abs(np.diff(points) - step).max() > 1e-6 * step:
        return 0
    return round(float(points[0]) / step)


def content(piece: Problem) -> bytes:
    """Return the frequencies of a piece, to the last bit."""
    assert piece.rests is not None
    return b"".join(each.tobytes() for each in (piece.omega, piece.fundamental, piece.rests))
