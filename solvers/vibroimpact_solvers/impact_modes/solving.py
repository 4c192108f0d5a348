"""Does what a plan lists."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol, TypeVar

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.impact_modes.direct import DirectFamily
from vibroimpact_solvers.impact_modes.family import Family, Kind
from vibroimpact_solvers.impact_modes.impulses import Impulses
from vibroimpact_solvers.impact_modes.mixed import MixedFamily
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.impact_modes.planning import FAR, Displacement, factorizes
from vibroimpact_solvers.impact_modes.problem import Frequencies, Problem
from vibroimpact_solvers.impact_modes.result import Reason, Result, concatenate, empty
from vibroimpact_solvers.plan import Plan, Stage

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
_DIRECT = (
    "estimate: what roundings in the natural frequencies change, to first order, and the bound "
    "of the truncated series, relative to the largest impulse of the member"
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
    total = problem.omega.size
    members = _Members(problem, plan)
    block = members.block(problem)
    pieces = []
    for start in range(0, total, block):
        if tick is not None:
            tick(start, total)
        pieces.append(members.at(problem.slice(start, start + block)))
    if tick is not None:
        tick(total, total)
    return concatenate(pieces)


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

    def check(self, motion: Motion, problem: Problem, excess: float) -> tuple[Floats, Booleans]:
        """Return a time at which a limit is passed or nan, and whether that is certain."""


def _evaluator(problem: Problem, plan: Plan, family: Family) -> tuple[Evaluator[Any], float]:
    """Return the family as the plan wants it, and the largest natural frequency or a bound."""
    step = plan.step(Stage.SPECTRUM)
    if step is None:
        bound = spectrum.largest_frequency(problem.system)
        return DirectFamily(problem, bound), bound
    natural = spectrum.spectrum(problem.system, spectrum.Method(step.method))
    modal, largest = ModalFamily(problem, family, natural), natural.largest_frequency
    placed = (plan.step(s) for s in (Stage.SHAPE, Stage.WAVEFORM, Stage.HARMONICS))
    if not any(s is not None and s.method == Displacement.MIXED for s in placed):
        return modal, largest
    solves = factorizes(problem.system)
    direct = DirectFamily(problem, largest * (1.0 + 1e-12), factorizes=solves)
    start = largest * ((1.0 + 1e-9) if solves else FAR)
    return MixedFamily(modal, direct, start * 2.0 / np.pi), largest


class _Members:
    """The members of one problem, ready to be evaluated at frequencies."""

    def __init__(self, problem: Problem, plan: Plan) -> None:
        self.plan, self.family = plan, Family.of(problem)
        self.evaluator, self.largest = _evaluator(problem, plan, self.family)
        self.orders = np.arange(0, problem.highest_harmonic + 1)
        if self.family.kind is Kind.ODD:
            self.orders = self.orders[1::2]
        stages = (Stage.SHAPE, Stage.WAVEFORM, Stage.ENERGY, Stage.HARMONICS)
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

    def at(self, problem: Problem) -> Result:
        """Return the members at some of the frequencies."""
        outputs, dofs, omega = problem.outputs, problem.wanted_dofs, problem.omega
        impulses, motion = self.evaluator.members(problem.frequencies, with_motion=self.moves)
        found = empty()
        found.update(
            Omega=problem.fundamental,
            omega=omega,
            constraint=np.array(problem.active, dtype=np.int64),
            impulse_error=np.minimum(impulses.error, 1.0),
            condition=np.minimum(impulses.error / _EPS, _SINGULAR),
            error_statement=_STATEMENT if self.plan.step(Stage.SPECTRUM) else _DIRECT,
        )
        if "impulse" in outputs:
            found["impulse"] = impulses.plus
            found["impulse_lower"] = None if self.family.kind is Kind.ODD else impulses.minus
        if self.plan.step(Stage.EXISTENCE):
            reason, certified, witness = self._existence(problem, impulses, motion)
            found.update(certified=certified, witness=witness)
            found["exists"] = reason == Reason.OK if "exists" in outputs else None
            found["reason"] = reason if "reason" in outputs else None
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

    def _existence(
        self, problem: Problem, impulses: Impulses, motion: Any
    ) -> tuple[Integers, Booleans, Floats]:
        """Return reason codes, whether they are certain, and witnesses, each (frequency,)."""
        reason = self._signs(problem, impulses)
        witness = np.full(reason.size, np.nan)
        certified = impulses.error < _CERTAIN
        walks = (reason == Reason.OK) & (problem.fundamental <= self.clear_above)
        if walks.any():
            if self.moves:
                some = motion.at(walks)
            else:
                _, some = self.evaluator.members(problem.frequencies[walks])
            witness[walks], sure = self.evaluator.check(some, problem, EXCESS)
            certified[walks] &= sure
            reason[~np.isnan(witness)] = Reason.PENETRATION
        return reason, certified, witness

    def _signs(self, problem: Problem, impulses: Impulses) -> Integers:
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
