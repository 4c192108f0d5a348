"""Plans time histories: which method computes the motion, at which price, and what is skipped."""

from __future__ import annotations

import math
import weakref
from collections.abc import Iterator
from enum import StrEnum
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from vibroimpact_solvers import condensation, impact_modes, spectrum
from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.body import Body
from vibroimpact_solvers.derivatives import Parameter
from vibroimpact_solvers.matrices import Form, SymmetricMatrix
from vibroimpact_solvers.model import Coordinates, System
from vibroimpact_solvers.plan import Plan, Skip, Stage, Step
from vibroimpact_solvers.time_history import ends
from vibroimpact_solvers.time_history.derivatives import SHAKEN_MOTIONS
from vibroimpact_solvers.time_history.loads import (
    largest_frequency,
    require_phases,
    samples,
)
from vibroimpact_solvers.time_history.problem import (
    EXACT,
    KIND,
    MOVED,
    OUTPUTS,
    SAMPLED,
    STATES,
    ImpactMode,
    Problem,
    State,
)
from vibroimpact_solvers.time_history.start import impact_mode_problem

_MOST = 2**14  # windows; of the longest motions allowed, each then takes a few hundred megabytes
_DOUBT = 1e-10  # of the diagonal of K, within which it may be singular
_FEW = 500  # degrees of freedom up to which a full K is factorized for a plan
_LARGE = 100.0  # of the fastest frequency over the slowest one of larger structures
_QUICK = 2e7  # operations of some nanoseconds for which a plan looks what walls are within reach
_FLOPS_PER_SECOND, _BYTES_PER_SECOND = 1e9, 5e8  # by which windows are cut, whatever they take
_SAMPLE = 1.5e5  # work at a sample of a load
_ROW = 72.0  # bytes of an impact
_IN_A_RADIAN = 16.0  # impacts for each radian of the slow modes: fast motions of beams have 5 to 25
SECONDS: Final = 0.5
"""Planned work of a window of a long motion."""
BYTES: Final = 4.0e6
"""Planned size of what a window yields."""


class Method(StrEnum):
    """Methods for the motion."""

    MODAL = "exact between impacts"
    TAYLOR = "Taylor series"
    INTEGRATED = "integrator of scipy"
    SWITCHED = "exact between switchings of stops"
    POWERED = "Taylor series between switchings of stops"
    EXTENDED = "exact between impacts, in extended precision where needed"


def plan(problem: Problem) -> Plan:
    """Decide how the motion is computed and what is left out.

    Raises
    ------
    ModelError
        Where double precision does not tell at which phase of a load the motion ends.
    PlanError
        Where its end is never reached: see `ends`.
    """
    require_phases(problem.load, problem.t_end)
    far = _far(problem)
    plan = Plan(KIND, tuple(_steps(problem, far)), _skips(problem, far))
    if plan.seconds > ends.LONG:
        ends.check(problem, plan.seconds)
    return plan


def windows(plan: Plan) -> int:
    """Return the number of windows of time in which the motion is computed by a plan."""
    step = plan.step(Stage.FREE_MOTION)
    return 1 if step is None or step.method != Method.MODAL else step.count


def _steps(problem: Problem, far: list[int]) -> Iterator[Step]:
    system = problem.system
    method = spectrum.choose(system)
    yield spectrum.step(system, method)
    history = None
    if isinstance(problem.initial, ImpactMode):
        start = impact_modes.plan(impact_mode_problem(system, problem.initial))
        yield from (step for step in start.steps if step.stage is not Stage.SPECTRUM)
    if problem.outputs & SAMPLED:
        times, dofs = problem.times.size, problem.output_dofs.size
        reason = f"{dofs} of {system.n} degrees of freedom at {times} times"
        moved = float(max(2, len(problem.outputs & {*MOVED})))
        flops = times * system.n * (40.0 + 2.0 * moved * dofs)
        # Displacements and their derivatives; times and energies; as many errors.
        size = 16.0 * times * (moved * dofs + 2.0)
        history = Step(Stage.HISTORY, "modal sum", reason, flops, size)
    yield _motion_step(problem, len(system.constraints) - len(far), history)
    if history is not None:
        yield history
    if problem.parameters:
        yield _derivatives_step(problem)


def _derivatives_step(problem: Problem) -> Step:
    """Return the step of the derivatives, whose sources are integrated along the motion."""
    count, n = len(problem.parameters), float(problem.system.n)
    plural = "s" if count > 1 else ""
    reason = (
        f"by {count} parameter{plural}: rates of the motion, all of them together from impact to "
        f"impact, and {SHAKEN_MOTIONS} times more with roundings, for their errors"
    )
    turns = problem.t_end * _in_motion(problem)
    sources = sum(_has_sources(each) for each in problem.parameters)
    states = _impacts(problem) + problem.history_times.size
    nodes = states * 8.0 + 2.0 * problem.t_end * spectrum.largest_frequency(problem.system)
    each = 40.0 * n * (1.0 + count)
    flops = (1.0 + SHAKEN_MOTIONS) * (states * each + (nodes * 60.0 * n * sources))
    size = 16.0 * count * problem.history_times.size * (2.0 * problem.output_dofs.size + 1.0)
    size += 48.0 * count * (turns + _impacts(problem))
    return Step(Stage.DERIVATIVES, "rates of the motion", reason, 5e6 + flops, size, bounded=False)


def _has_sources(parameter: Parameter) -> bool:
    """Whether a parameter changes the motion between impacts, and not only its start."""
    changes = bool(parameter.structural or parameter.C or parameter.loads)
    return changes or parameter.force is not None


def _motion_step(problem: Problem, count: int, history: Step | None) -> Step:
    """Return the step of the motion, `count` constraints being within reach.

    The windows of time of an exact motion go by its work and its size, those of its history
    included. They are the same for all initial states that reach a wall, whichever it is.
    """
    system = problem.system
    fastest = max(spectrum.largest_frequency(system), largest_frequency(problem.load))
    turns = problem.t_end * fastest
    if problem.method != EXACT:
        reason = "asked for, to compare with; it can miss impacts"
        flops = 3e5 * (20.0 + turns) * system.n
        reason = f"{problem.method}: {reason}"
        return Step(Stage.FREE_MOTION, Method.INTEGRATED, reason, flops, bounded=False)
    if problem.powered:
        return _powered_step(problem, turns)
    if problem.limiter is not None:
        reason = (
            "soft limiters: series of the motion, of an order that goes with the tolerance; a run "
            "with longer steps tells how well it is known"
        )
        # Two runs of some ten steps in the time of the fastest mode; contacts take more.
        steps, more = 20.0 * (20.0 + turns), 1.0 + 0.3 * count
        flops = steps * more * (1e3 + 60.0 * system.n * more)
        return Step(Stage.FREE_MOTION, Method.TAYLOR, reason, flops, bounded=False)
    if problem.digits is not None:
        reason = (
            "in double precision first; where its predictability ends before the motion does, the "
            f"whole motion again with {problem.digits} decimal digits"
        )
        each = 1e6 + 1e4 * float(system.n) ** 2 * (1.0 + problem.digits / 50.0)
        flops = (20.0 + turns + _crossings(problem)) * each + 5e3 * float(system.n) ** 3
        size = 72.0 * turns
        return Step(Stage.FREE_MOTION, Method.EXTENDED, reason, flops, size, bounded=False)
    if problem.stopped:
        return _switched_step(problem, count)
    # How long an expansion lasts goes by the frequencies that are in the motion of the limited
    # coordinates, see `_in_motion`; an impact takes two at least. Without walls within reach the
    # whole motion is one.
    turns = problem.t_end * _in_motion(problem)
    breaks = samples(problem.load, problem.t_end)
    expansions = 10.0 + (2.0 * (turns + _crossings(problem)) if count else 0.0) + breaks
    reason = (
        "exact between impacts, which are found by certified expansions of the constrained "
        "coordinates"
    )
    if count:
        reason += "; the number of impacts is estimated: the price is no upper bound"
    if breaks:
        reason += "; loads are straight lines between their samples"
    whole = _price(system, expansions, len(system.constraints)) + breaks * _SAMPLE
    # Windows are cut by what could be written at most, so that motions may end between them.
    written = _ROW * expansions if count else 0.0
    size = min(written, _ROW * _impacts(problem))
    if history is not None:
        whole, written = whole + history.flops, written + history.bytes
    seconds = whole / _FLOPS_PER_SECOND + written / _BYTES_PER_SECOND
    parts = math.ceil(min(max(seconds / SECONDS, written / BYTES, 1.0), _MOST))
    if problem.parameters:  # which take the whole motion
        parts = 1
    if parts > 1:
        cut = f"in {parts} windows of time, each from the state at the end of the one before"
        reason = f"{reason}; {cut}"
    flops = _price(system, expansions, count) + breaks * _SAMPLE
    return Step(Stage.FREE_MOTION, Method.MODAL, reason, flops, size, parts, bounded=not count)


def _switched_step(problem: Problem, count: int) -> Step:
    """Return the step of a motion with stops of finite stiffness."""
    system, n = problem.system, float(problem.system.n)
    # Measured on chains, a contact takes 20 us and what goes with the number of modes, and with its
    # square where states are converted.
    contacts = _contacts(problem)
    reason = (
        "the structure is linear while no stop switches: wall reached, force lost or regained, "
        "wall left, each found by certified expansions; the number of contacts is estimated: the "
        "price is no upper bound"
    )
    coupled = any(c.law.lossy for c in system.constraints) or system.C is not None
    modes = (1.0 + count) * n**3 * (200.0 if coupled else 20.0)
    breaks = samples(problem.load, problem.t_end)
    flops = 1.5e7 + modes + contacts * (2e4 + 3e3 * n + 20.0 * n * n) + breaks * _SAMPLE
    return Step(Stage.FREE_MOTION, Method.SWITCHED, reason, flops, 400.0 * contacts, bounded=False)


def _contacts(problem: Problem) -> float:
    """Return about how many contacts there are with stops of finite stiffness.

    One in two radians of the slow modes or the load, or at the first speed.
    """
    return 5.0 + max(0.5 * problem.t_end * _slow(problem), 0.3 * _crossings(problem))


def _powered_step(problem: Problem, turns: float) -> Step:
    """Return the step of a motion with stops whose force grows with a power."""
    system, n = problem.system, float(problem.system.n)
    walls = sum((c.lower is not None) + (c.upper is not None) for c in system.constraints)
    contacts = _contacts(problem)
    reason = (
        "series of the motion, of an order that goes with the tolerance; steps end where a wall is "
        "reached or left, and grow from there, where the force has no series; a run with longer "
        "steps tells how well it is known; the number of contacts is estimated: the price is no "
        "upper bound"
    )
    # Two runs of a step in a radian or so of the fastest mode, and some hundred in a contact.
    steps = 2.0 * (20.0 + turns + 100.0 * contacts)
    flops = steps * (1e3 + 60.0 * n + walls * (500.0 + 40.0 * n))
    return Step(Stage.FREE_MOTION, Method.POWERED, reason, flops, 400.0 * contacts, bounded=False)


def _in_motion(problem: Problem) -> float:
    """Return the frequency by which expansions of a motion end, about.

    It lies between that of the slowest mode, which moves most, and that of the fastest one: half
    as many decades from each, as measured for beams, plates, chains and full matrices. The slow
    one is Rayleigh's quotient of the deflection under a force at a limiter.
    """
    fastest = spectrum.largest_frequency(problem.system)
    slowest = _reach(problem.system).slowest or fastest
    return max(math.sqrt(fastest * slowest), largest_frequency(problem.load))


def _impacts(problem: Problem) -> float:
    """Return about how many impacts there are, at the first speed or in periods of slow modes."""
    return 10.0 + _crossings(problem) + _IN_A_RADIAN * problem.t_end * _slow(problem)


def _slow(problem: Problem) -> float:
    """Return the frequency at which slow modes, or the load, bring the structure to its walls."""
    slowest = _reach(problem.system).slowest or spectrum.largest_frequency(problem.system)
    return max(slowest, largest_frequency(problem.load))


def _price(system: System, expansions: float, count: int) -> float:
    """Return the operations of an exact motion with `count` constraints."""
    return 1e6 + expansions * (150.0 + system.n * (15.0 + 15.0 * count))


def _crossings(problem: Problem) -> float:
    """Return how often a motion as fast as at its start could strike until its end.

    It crosses the narrowest gap at that speed, strikes in each half of the period of an impact
    mode, and bounces on walls to which the load presses it.
    """
    state, system = problem.initial, problem.system
    if isinstance(state, ImpactMode):
        count = len(state.active) or len(system.constraints)
        return problem.t_end * state.Omega / math.pi * count
    bounces = _bounces(problem, state) if system.loaded else 0.0
    gaps = [
        c.lower + c.upper for c in system.constraints if c.lower is not None and c.upper is not None
    ]
    if not gaps:
        return bounces
    speed = math.sqrt(float(state.v @ state.v) / state.v.size)
    return bounces + problem.t_end * speed / min(gaps)


def _bounces(problem: Problem, state: State) -> float:
    """Return how often coordinates could bounce on walls to which the load presses them.

    A coordinate that is alone with the constant acceleration a of the load falls from its
    distance h, strikes at ``u = (v^2 + 2 a h)^(1/2)`` and comes back after 2u/a, each time
    shorter by the coefficient of restitution r, until its bounces are roundings of the first.
    """
    system = problem.system
    if problem.limiter is not None or system.force is None:
        return 0.0
    rows = system.directions(range(len(system.constraints)))
    pushes = rows @ condensation.solve_mass(system)(system.force)
    bounces = 0.0
    for c, row, a in zip(system.constraints, rows, pushes.tolist(), strict=True):
        wall, y, v = c.upper if a > 0.0 else c.lower, float(row @ state.x), float(row @ state.v)
        if a == 0.0 or wall is None:
            continue
        falls = max(0.0, wall - math.copysign(1.0, a) * y)
        if (longest := 2.0 * math.sqrt(v * v + 2.0 * abs(a) * falls) / abs(a)) == 0.0:
            continue  # it rests
        lost, periods = 1.0 - c.restitution, problem.t_end / longest
        if lost > 0.0:  # the time of k bounces is longest (1 - r^k)/(1 - r)
            part = min(periods * lost, 1.0 - EPS)
            periods = math.log1p(-part) / math.log1p(-lost) if lost < 1.0 else 1.0
        bounces += periods
    return bounces


def _far(problem: Problem) -> list[int]:
    """Return the constraints whose walls are out of reach for as long as energy is only lost.

    ``|y| <= (2 E w^T K^-1 w)^(1/2)`` for a positive definite K and no load.
    """
    system, state = problem.system, problem.initial
    loaded = problem.load or (system.force is not None and system.force.any())
    if not isinstance(state, State) or loaded or problem.limiter is not None or problem.stopped:
        return []
    reach = _reach(system)
    if not reach.compliances.size:
        return []
    walls = [
        min(np.inf if wall is None else wall for wall in (c.lower, c.upper))
        for c in system.constraints
    ]
    # Signs of walls beyond the equilibrium do not count: such walls are within reach.
    energies = np.square(np.maximum(walls, 0.0)) / (2.0 * reach.compliances) * (1.0 - 1e-12)
    least: list[float] = energies.tolist()
    # Motions that are fast enough for all walls need no more than their speed.
    if 0.5 * reach.lightest * float(state.v @ state.v) >= max(least):
        return []
    energy = 0.5 * float(state.v @ (system.M @ state.v) + state.x @ (system.K @ state.x))
    return [i for i, enough in enumerate(least) if energy < enough]


class _Reach(NamedTuple):
    """What static deflections at the limiters tell, wherever their walls are.

    Parameters
    ----------
    compliances : array, shape (constraint,)
        Deflections of the constrained coordinates under unit forces; empty: unknown.
    lightest : float
        A lower bound of the mass that moves with any degree of freedom.
    slowest : float
        The lowest frequency at the limiters, about; 0: unknown, as of bodies that nothing holds.
    """

    compliances: Floats = np.zeros(0)
    lightest: float = 0.0
    slowest: float = 0.0


_REACHES: weakref.WeakKeyDictionary[Body, dict[Coordinates, _Reach]] = weakref.WeakKeyDictionary()


def _reach(system: System) -> _Reach:
    """Return what is known of the limiters of a structure, or look."""
    kept, coordinates = _REACHES.setdefault(system.body, {}), system.coordinates
    known = kept.get(coordinates)
    if known is None:
        kept.clear()  # of one choice of limiters at a time
        known = kept[coordinates] = _looked_up(system)
    return known


def _looked_up(system: System) -> _Reach:
    dense = Form.DENSE in {system.K.form, system.M.form}
    # Factors of K within its band, from which each constraint asks for one column of the inverse.
    width = system.K.width
    column = 12.0 + (width / 8.0 if system.K.form is Form.DENSE else width)
    work = system.n * (width**2 / 6.0 + len(system.constraints) * column)
    if (dense and system.n > _FEW) or work > _QUICK:
        return _Reach(slowest=spectrum.largest_frequency(system) / _LARGE)
    # Less than K by more than roundings: positive definite, it is so beyond doubt.
    less = system.K.plus(-_DOUBT, SymmetricMatrix.diagonal(system.K.main_diagonal))
    if not less.is_positive_definite():
        return _Reach()
    lightest = float(system.M.data[0].min()) if system.M.form is Form.DIAGONAL else 0.0
    W = system.directions(range(len(system.constraints)))
    if not len(W):
        return _Reach()
    deflections = less.factorize(definite=True)(np.ascontiguousarray(W.T))
    compliance = np.einsum("ij,ji->i", W, deflections)
    moving = np.einsum("ji,ji->i", deflections, system.M @ deflections)
    with np.errstate(all="ignore"):  # of numbers near the ends of double precision
        square = float((compliance / moving).min())
    slowest = math.sqrt(square) if math.isfinite(square) else 0.0
    return _Reach(compliance, lightest * (1.0 - 1e-12), slowest)


def _skips(problem: Problem, far: list[int]) -> tuple[Skip, ...]:
    lossy = any(c.restitution < 1.0 for c in problem.system.constraints)
    rigid = problem.limiter is None
    skips = _listed(
        problem.outputs, tuple(far), problem.method == EXACT and rigid, lossy and not rigid
    )
    return skips if problem.parameters else (*skips, Skip("derivatives", "not requested"))


@lru_cache(maxsize=256)
def _listed(
    outputs: frozenset[str], far: tuple[int, ...], exact: bool, gives_back: bool
) -> tuple[Skip, ...]:
    """Return the skips and their reasons."""
    why = "the energy of the motion does not reach its walls"
    skips = [Skip(f"constraint {index}", why) for index in far]
    if exact:
        why = "between two impacts, while the modes' amplitudes do not add up to them"
        skips.append(Skip("walls that are out of reach", why))
        why = "the free motion in closed form"
        skips.append(Skip("the search after the last possible impact", why))
    if gives_back:
        skips.append(Skip("restitution", "soft limiters give back what they take"))
    if not outputs & STATES:
        skips.append(Skip("history", "impacts and contacts need no state between them"))
    return (*skips, *(Skip(name, "not requested") for name in OUTPUTS if name not in outputs))
