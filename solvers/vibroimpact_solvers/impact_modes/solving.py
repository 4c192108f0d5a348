"""Does what a plan lists."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol, TypeVar

import numpy as np

from vibroimpact_solvers import spectrum, stability
from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.impact_modes.direct import DirectFamily
from vibroimpact_solvers.impact_modes.family import Family, Kind
from vibroimpact_solvers.impact_modes.impulses import Impulses
from vibroimpact_solvers.impact_modes.mixed import MixedFamily
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.impact_modes.modal import members as modal_members
from vibroimpact_solvers.impact_modes.planning import (
    FAR,
    Displacement,
    factorizes,
    has_all_modes,
)
from vibroimpact_solvers.impact_modes.problem import Frequencies, Problem
from vibroimpact_solvers.impact_modes.result import Reason, Result, concatenate, empty
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.receptance import ModalWaves, Reach
from vibroimpact_solvers.spectrum import Spectrum

Tick = Callable[[int, int], None]
Motion = TypeVar("Motion")

EXCESS: Final = 1e-10
"""A limit counts as passed where it is exceeded by more than this part of the room."""

_EPS = float(np.finfo(np.float64).eps)
_ONE = np.ones(1)
_BLOCK = 2**21  # numbers that a block of frequencies may take
_SINGULAR = 1e32  # stands for an infinite condition number
_CERTAIN = 1e-6  # relative error of the impulses up to which their signs are taken as proved
_STATEMENT = (
    "estimate: what roundings in the natural frequencies, the modes and the walls change, to "
    "first order, relative to the largest impulse of the member"
)
_RADII = (
    "; of stability: bounds of what roundings and errors of natural frequencies and motion do to "
    "the half-period map, to first order in its multipliers"
)
_DIRECT = (
    "estimate: what roundings in the natural frequencies change, to first order, and the bound "
    "of the truncated series, relative to the largest impulse of the member"
)
_PARTIAL = (
    "estimate: what roundings in the natural frequencies change, to first order, and the bounds "
    "of the truncated series, that of the natural modes left out among them, relative to the "
    "largest impulse of the member"
)


def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Compute what the plan lists.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        The one that `plan(problem)` returned.
    tick : callable, optional
        Called with (done, total) frequencies; may raise `Cancelled`.
    """
    return solve_alike((problem,), (Members(problem, plan),), tick)[0]


def solve_alike(
    problems: Sequence[Problem], members: Sequence[Members], tick: Tick | None = None
) -> list[Result]:
    """Compute problems that differ in nothing but the places of walls.

    Their responses are computed once; otherwise each result is what `solve` returns.
    """
    total = problems[0].omega.size
    block = max(1, members[0].block(problems[0]) // len(problems))
    pieces = []
    for start in range(0, total, block):
        if tick is not None:
            tick(start, total)
        pieces.append(at_all(members, [p.slice(start, start + block) for p in problems]))
    if tick is not None:
        tick(total, total)
    return [concatenate(one) for one in zip(*pieces, strict=True)]


def join(problem: Problem, plan: Plan, results: Sequence[Result]) -> Result:
    """Put the results of all pieces together again."""
    return concatenate(results)


class Evaluator(Protocol[Motion]):
    """A family that can be evaluated: `ModalFamily`, `MixedFamily` or `DirectFamily`."""

    @property
    def mobility(self) -> Floats:
        """``W M^(-1) W^T``, shape (constraint, constraint)."""

    def members(self, at: Frequencies, *, with_motion: bool = True) -> tuple[Impulses, Motion]:
        """Return impulses and motion of the members at some frequencies."""

    def displacements(self, motion: Motion, tau: Floats, dofs: Integers) -> Floats:
        """Return displacements, shape (frequency, tau, dof)."""

    def harmonics(self, motion: Motion, orders: Integers, dofs: Integers) -> Floats:
        """Return Fourier amplitudes, shape (frequency, order, dof)."""

    def energy(self, motion: Motion) -> Floats:
        """Return the total energies, shape (frequency,)."""

    def check(
        self, motion: Motion, error: Floats, problem: Problem, excess: float
    ) -> tuple[Floats, Booleans]:
        """Return a time at which a limit is passed or nan, and whether that is certain.

        The error is the relative one of the motion, shape (frequency,).
        """


def _evaluator(
    problem: Problem, plan: Plan, family: Family, natural: Spectrum | None
) -> tuple[Evaluator[Any], float]:
    """Return the family as the plan wants it, and the largest natural frequency or a bound."""
    step = plan.step(Stage.SPECTRUM)
    if step is None or not has_all_modes(plan):
        bound = spectrum.largest_frequency(problem.system)
        waves = None if step is None else partial_waves(problem)
        return DirectFamily(problem, bound, waves=waves), bound
    if natural is None:
        natural = spectrum.spectrum(problem.system, spectrum.Method(step.method))
    modal, largest = ModalFamily(problem, family, natural), natural.largest_frequency
    placed = (plan.step(s) for s in (Stage.SHAPE, Stage.WAVEFORM, Stage.HARMONICS))
    if not any(s is not None and s.method == Displacement.MIXED for s in placed):
        return modal, largest
    solves = factorizes(problem.system)
    direct = DirectFamily(problem, largest * (1.0 + 1e-12), factorizes=solves)
    start = largest * ((1.0 + 1e-9) if solves else FAR)
    return MixedFamily(modal, direct, start * 2.0 / np.pi), largest


def partial_waves(problem: Problem) -> ModalWaves:
    """Return the waves of a problem by the natural modes around them."""
    system = problem.system
    moved = problem.outputs & {"shape", "waveform", "harmonics"}
    places = problem.wanted_dofs if moved else np.empty(0, dtype=np.int64)
    directions = np.ascontiguousarray(system.directions(problem.active).T)
    bound, reach = spectrum.largest_frequency(system), Reach.of(problem.tolerance)
    return ModalWaves(system, directions, bound, places, reach)


class Members:
    """The members of one problem, ready to be evaluated at frequencies.

    Parameters
    ----------
    problem : Problem
    plan : Plan
    natural : Spectrum, optional
        The natural modes, where they are at hand.
    """

    def __init__(self, problem: Problem, plan: Plan, natural: Spectrum | None = None) -> None:
        self.plan, self.family = plan, Family.of(problem)
        self.evaluator, self.largest = _evaluator(problem, plan, self.family, natural)
        self.orders = np.arange(0, problem.highest_harmonic + 1)
        if self.family.kind is Kind.ODD:
            self.orders = self.orders[1::2]
        stages = (Stage.SHAPE, Stage.WAVEFORM, Stage.ENERGY, Stage.HARMONICS, Stage.STABILITY)
        self.moves = any(plan.step(stage) is not None for stage in stages)
        # With one constraint every term of its velocity has the sign of the impulse.
        self.clear_above = np.inf
        if self.family.kind is Kind.ODD and len(problem.system.constraints) == 1:
            self.clear_above = self.largest * (1.0 + 1e-12)

    def block(self, problem: Problem) -> int:
        """Return the number of frequencies to be taken at a time, as their memory allows."""
        wanted = problem.wanted_dofs.size * (1 + problem.times.size + self.orders.size)
        each = problem.system.n * (4 + problem.times.size) + wanted if self.moves else 64
        return max(1, min(_BLOCK // each, 2**15))

    def result(
        self, problem: Problem, impulses: Impulses, motion: Any, reason: Integers, walk: _Walk
    ) -> Result:
        """Return the members at some of the frequencies."""
        outputs, dofs, omega = problem.outputs, problem.wanted_dofs, problem.omega
        found = empty()
        found.update(
            Omega=problem.fundamental,
            omega=omega,
            constraint=np.array(problem.active, dtype=np.int64),
            impulse_error=np.minimum(impulses.error, 1.0),
            condition=np.minimum(impulses.error / _EPS, _SINGULAR),
            error_statement=self._statement(),
        )
        if problem.tolerance is not None:
            found["within_tolerance"] = impulses.error <= problem.tolerance
        if "impulse" in outputs:
            found["impulse"] = impulses.plus
            found["impulse_lower"] = None if self.family.kind is Kind.ODD else impulses.minus
        if self.plan.step(Stage.EXISTENCE):
            certified, witness = self._existence(problem, impulses, reason, walk)
            if outputs & {"exists", "reason"}:
                found.update(certified=certified, witness=witness)
            found["exists"] = reason == Reason.OK if "exists" in outputs else None
            found["reason"] = reason if "reason" in outputs else None
            if "stability" in outputs:
                exists, error = reason == Reason.OK, np.minimum(impulses.error, 1.0)
                found["stability"], found["stability_error"] = self._growth(exists, motion, error)
        if self.plan.step(Stage.SHAPE):
            found["shape"] = self.evaluator.displacements(motion, _ONE, dofs)[:, 0]
        if self.plan.step(Stage.WAVEFORM):
            found["waveform"] = self.evaluator.displacements(motion, problem.times, dofs)
            found["tau"] = problem.times
        if self.plan.step(Stage.HARMONICS):
            found["harmonics"] = self.evaluator.harmonics(motion, self.orders, dofs)
            found["harmonic"] = self.orders
        if outputs & {"shape", "waveform", "harmonics"}:
            found["dof"] = dofs
        if self.plan.step(Stage.ENERGY):
            found["energy"] = self.evaluator.energy(motion)
        return Result(**found)

    def _statement(self) -> str:
        if has_all_modes(self.plan):
            return _STATEMENT + (_RADII if self.plan.step(Stage.STABILITY) else "")
        return _PARTIAL if self.plan.step(Stage.SPECTRUM) else _DIRECT

    def walks(self, problem: Problem, reason: Integers) -> Booleans:
        """Return where only a walk along the motion can tell whether the member exists."""
        return np.asarray((reason == Reason.OK) & (problem.fundamental <= self.clear_above))

    def _existence(
        self, problem: Problem, impulses: Impulses, reason: Integers, walk: _Walk
    ) -> tuple[Booleans, Floats]:
        """Complete the reasons; return whether they are certain, and witnesses (frequency,)."""
        witness = np.full(reason.size, np.nan)
        certified = self._certain(impulses, reason)
        if walk.where.any():
            error = np.minimum(impulses.error[walk.where], 1.0)
            witness[walk.where], sure = self.evaluator.check(walk.motion, error, problem, EXCESS)
            certified[walk.where] &= sure
            reason[~np.isnan(witness)] = Reason.PENETRATION
        return certified, witness

    def _certain(self, impulses: Impulses, reason: Integers) -> Booleans:
        """Return whether errors of the impulses leave the reasons as they are, (frequency,)."""
        largest = np.maximum(np.abs(impulses.plus), np.abs(impulses.minus)).max(axis=1)
        doubt = (np.minimum(impulses.error, 1.0) * largest)[:, np.newaxis]
        pulls, leaves = np.zeros((2, reason.size), dtype=np.bool_)
        firm = np.ones(reason.size, dtype=np.bool_)
        mobility = self.evaluator.mobility
        reach = np.abs(mobility).sum(axis=0)
        for p, struck in ((impulses.plus, self.family.upper), (impulses.minus, self.family.lower)):
            walls = list(struck)
            pulls |= (p[:, walls] <= -doubt).any(axis=1)
            towards, unsure = (p @ mobility)[:, walls], doubt * reach[walls]
            leaves |= (towards <= -unsure).any(axis=1)
            firm &= (p[:, walls] > doubt).all(axis=1) & (towards > unsure).all(axis=1)
        decided = np.where(reason == Reason.WRONG_VELOCITY, leaves, firm)
        decided = np.where(reason == Reason.NEGATIVE_IMPULSE, pulls, decided)
        return np.asarray((impulses.error < _CERTAIN) & decided)

    def _growth(self, exists: Booleans, motion: Any, error: Floats) -> tuple[Floats, Floats]:
        """Return spectral radii of the half-period maps and errors, nan without a motion."""
        radii, errors = np.full((2, exists.size), np.nan)
        if exists.any() and self.plan.step(Stage.STABILITY):
            # No plan wants stability without natural modes.
            assert isinstance(self.evaluator, ModalFamily | MixedFamily)
            orbits = self.evaluator.orbits(motion.at(exists), error[exists])
            radii[exists], errors[exists] = stability.growth(orbits)
        return radii, errors

    def signs(self, problem: Problem, impulses: Impulses) -> Integers:
        """Return the reasons that impulses and pre-impact velocities give."""
        mobility = self.evaluator.mobility
        codes = np.zeros(impulses.error.size, dtype=np.int64)
        for p, struck in ((impulses.plus, self.family.upper), (impulses.minus, self.family.lower)):
            towards = p @ mobility
            wrong = ~(towards[:, struck] > 0.0).all(axis=1)
            codes[wrong & (codes == Reason.OK)] = Reason.WRONG_VELOCITY
        for p, struck in ((impulses.plus, self.family.upper), (impulses.minus, self.family.lower)):
            codes[~(p[:, struck] > 0.0).all(axis=1)] = Reason.NEGATIVE_IMPULSE
        room = max(abs(w) for c in problem.struck for w in (c.lower, c.upper) if w is not None)
        fastest = np.maximum(1.0, self.largest / problem.omega)
        load = 0.0 if problem.system.force is None else float(np.abs(problem.system.force).max())
        usual = room * problem.omega**2 * fastest / mobility.diagonal().min() + load
        codes[impulses.singular(usual)] = Reason.SINGULAR
        return codes


@dataclass(frozen=True, eq=False, slots=True)
class _Walk:
    """Where the motion is followed, and the motions there."""

    where: Booleans
    motion: Any = None


def at_all(members: Sequence[Members], problems: Sequence[Problem]) -> list[Result]:
    """Return the members of problems that differ in nothing but the places of walls."""
    evaluators = [one.evaluator for one in members]
    at, moves = problems[0].frequencies, members[0].moves
    found = _evaluate(evaluators, at, with_motion=moves)
    nowhere = np.zeros(at.size, dtype=np.bool_)
    reasons = [np.zeros(at.size, dtype=np.int64)] * len(members)
    walks = [_Walk(nowhere)] * len(members)
    if members[0].plan.step(Stage.EXISTENCE):
        solved = list(zip(members, problems, found, strict=True))
        reasons = [one.signs(problem, impulses) for one, problem, (impulses, _) in solved]
        where = [
            one.walks(problem, reason)
            for one, problem, reason in zip(members, problems, reasons, strict=True)
        ]
        walks = _follow(evaluators, at, [motion for _, motion in found], where, moves=moves)
    return [
        one.result(problem, impulses, motion, reason, walk)
        for one, problem, (impulses, motion), reason, walk in zip(
            members, problems, found, reasons, walks, strict=True
        )
    ]


def _follow(
    evaluators: Sequence[Evaluator[Any]],
    at: Frequencies,
    motions: Sequence[Any],
    where: Sequence[Booleans],
    *,
    moves: bool,
) -> list[_Walk]:
    """Return the motions that are to be followed; those that are not there yet are computed."""
    if moves:
        return [_Walk(w, motion.at(w)) for w, motion in zip(where, motions, strict=True)]
    anywhere = np.logical_or.reduce(where)
    if not anywhere.any():
        return [_Walk(w) for w in where]
    found = _evaluate(evaluators, at[anywhere], with_motion=True)
    return [_Walk(w, some.at(w[anywhere])) for w, (_, some) in zip(where, found, strict=True)]


def _evaluate(
    evaluators: Sequence[Evaluator[Any]], at: Frequencies, *, with_motion: bool
) -> list[tuple[Impulses, Any]]:
    """Return impulses and motions, by common responses where there are natural modes."""
    inner = (one.modal if isinstance(one, MixedFamily) else one for one in evaluators)
    modal = [one for one in inner if isinstance(one, ModalFamily)]
    if len(modal) == len(evaluators):
        return modal_members(modal, at, with_motion=with_motion)
    return [one.members(at, with_motion=with_motion) for one in evaluators]
