"""Solutions of one family at some frequencies: impulses, existence, and what else a plan lists."""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import spectrum, stability
from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers, nothing
from vibroimpact_solvers.derivatives import named
from vibroimpact_solvers.impact_modes import extended
from vibroimpact_solvers.impact_modes.derivatives import Derivatives
from vibroimpact_solvers.impact_modes.direct import DirectFamily
from vibroimpact_solvers.impact_modes.family import Family, Impulses, Kind
from vibroimpact_solvers.impact_modes.modal import ModalFamily
from vibroimpact_solvers.impact_modes.modal_with_series import ModalWithSeriesFamily
from vibroimpact_solvers.impact_modes.planning import PathCheck, SeriesRange, has_all_modes
from vibroimpact_solvers.impact_modes.problem import DISPLACEMENTS, Problem
from vibroimpact_solvers.model import System
from vibroimpact_solvers.plan import Plan, Stage
from vibroimpact_solvers.receptance import ExpansionSize, PartialModalResponse
from vibroimpact_solvers.results.impact_modes import Reason, Result
from vibroimpact_solvers.spectrum import Spectrum

_OF_MOTIONS: Final = frozenset(
    (Stage.SHAPE, Stage.WAVEFORM, Stage.ENERGY, Stage.HARMONICS, Stage.STABILITY, Stage.DERIVATIVES)
)
"""Stages that need the motion, not the impulses alone."""
_ONE = np.ones(1)
_HARMONIC = 4.0 / np.pi  # error of a Fourier amplitude over that of the displacement
_OF_MOMENTA = 2.0 * EPS  # relative, by the frequency and their own rounding
_BLOCK = 2**21  # numbers in a block of frequencies
_SINGULAR = 1e32  # stands for an infinite condition number
_CERTAIN = 1e-6  # relative error of the impulses up to which their signs count as proved
_PROVED = (
    "bounds: proved errors of the natural modes and all roundings, of impulses the same for all of "
    "a solution; relative is that of its largest impulse"
)
_ESTIMATED = (
    "estimates: errors of the natural modes by rounding and all further roundings, of impulses the "
    "same for all of a solution; relative is that of its largest impulse"
)
_SERIES = "; estimates of displacements above the spectrum, which are summed by a power series"
_RADII = (
    "; of stability: bounds of the effect of rounding and of errors of natural frequencies and "
    "participations or motion, to first order, on the multipliers"
)
_DIRECT = (
    "estimate: effect of rounding in the natural frequencies, to first order, and the bound of "
    "the truncated series, of impulses the same for all of a solution; relative is that of its "
    "largest impulse"
)
_PARTIAL = (
    "estimate: effect of rounding in the natural frequencies, to first order, and the bounds of "
    "the truncated series, including that of the omitted natural modes, of impulses the same for "
    "all of a solution; relative is that of its largest impulse"
)


_PREPARED: Final[weakref.WeakKeyDictionary[System, dict[tuple[int, ...], ModalFamily]]] = (
    weakref.WeakKeyDictionary()
)

FamilyEvaluator = ModalFamily | DirectFamily
"""Evaluates impulses and motions of a family; both classes have the same methods."""


def _evaluator(
    problem: Problem, plan: Plan, family: Family, natural: Spectrum | None
) -> tuple[FamilyEvaluator, float]:
    """Return the evaluator that the plan names, and the largest natural frequency or a bound."""
    step = plan.step(Stage.SPECTRUM)
    if step is None or not has_all_modes(plan):
        bound = spectrum.largest_frequency(problem.system)
        expansion = None if step is None else step.settings
        response = None
        if isinstance(expansion, ExpansionSize):
            response = partial_modal_response(problem, expansion)
        return DirectFamily(problem, bound, frequency_response=response), bound
    if natural is None:
        natural = spectrum.spectrum(problem.system, spectrum.Method(step.method))
    largest = natural.largest_frequency
    stages = (plan.step(s) for s in (Stage.SHAPE, Stage.WAVEFORM, Stage.HARMONICS))
    series = next((s.settings for s in stages if s is not None), None)
    if isinstance(series, SeriesRange):
        return ModalWithSeriesFamily(problem, family, natural, series), largest
    return _modal(problem, family, natural), largest


def _modal(problem: Problem, family: Family, natural: Spectrum) -> ModalFamily:
    """Return the evaluator by all natural modes, prepared once for each structure."""
    kept = _PREPARED.setdefault(problem.system, {})
    known = kept.get(problem.active)
    if known is None or known.spectrum is not natural:
        known = kept[problem.active] = ModalFamily(problem, family, natural)
    return known


def partial_modal_response(problem: Problem, expansion: ExpansionSize) -> PartialModalResponse:
    """Return the frequency response of a problem by the natural modes near each frequency."""
    system = problem.system
    displaced = problem.outputs & DISPLACEMENTS
    dofs = problem.output_dofs if displaced else np.empty(0, dtype=np.int64)
    directions = np.ascontiguousarray(system.directions(problem.active).T)
    bound = spectrum.largest_frequency(system)
    return PartialModalResponse(system, directions, bound, dofs, expansion)


@dataclass(frozen=True, eq=False, slots=True)
class PathMotions:
    """Frequencies at which the path is checked, and the motions there."""

    where: Booleans
    motion: Any = None


class FamilySolver:
    """One family, ready to be solved at frequencies as a plan says.

    `natural` are the natural modes, where they are known.
    """

    def __init__(self, problem: Problem, plan: Plan, natural: Spectrum | None = None) -> None:
        self.plan, self.family = plan, Family.of(problem)
        self.evaluator, self._largest = _evaluator(problem, plan, self.family, natural)
        self._orders = self.family.orders(problem)
        self.stages = frozenset(step.stage for step in plan.steps)
        self.needs_motion = not self.stages.isdisjoint(_OF_MOTIONS)
        self._derivatives: Derivatives | None = None
        if Stage.DERIVATIVES in self.stages:
            assert isinstance(self.evaluator, ModalFamily)
            self._derivatives = Derivatives(problem, self.evaluator)
        existence = plan.step(Stage.EXISTENCE)
        check = None if existence is None else existence.settings
        self._check_below, self._in_balls = np.inf, False
        if isinstance(check, PathCheck):
            self._in_balls = check.in_balls
        if isinstance(check, PathCheck) and not check.above_spectrum:
            self._check_below = self._largest * (1.0 + 1e-12)

    def block(self, problem: Problem) -> int:
        """Return the number of frequencies solved at a time, by the memory that they take."""
        outputs = problem.output_dofs.size * (1 + problem.times.size + self._orders.size)
        each = problem.system.n * (4 + problem.times.size) + outputs if self.needs_motion else 64
        return max(1, min(_BLOCK // each, 2**15))

    def result(
        self,
        problem: Problem,
        impulses: Impulses,
        motion: Any,
        reason: Integers,
        paths: PathMotions,
    ) -> Result:
        """Return the solutions at the frequencies of the problem."""
        outputs, dofs = problem.outputs, problem.output_dofs
        values = nothing(Result)
        values.update(
            Omega=problem.fundamental,
            omega=problem.omega,
            constraint=np.array(problem.active, dtype=np.int64),
            impulse_error=self._absolute(impulses, 0.0),
            relative_error=np.minimum(impulses.error, 1.0),
            condition=np.minimum(impulses.error / EPS, _SINGULAR),
            error_statement=self._statement(),
            neglected=problem.neglected or None,
        )
        if problem.tolerance is not None:
            values["within_tolerance"] = impulses.error <= problem.tolerance
        if "impulse" in outputs:
            values.update(self._impulses(problem, impulses))
        if Stage.EXISTENCE in self.stages:
            values.update(self._existence(problem, impulses, motion, reason, paths))
        if Stage.SHAPE in self.stages:
            values.update(self._shape(problem, motion))
        if Stage.WAVEFORM in self.stages:
            waveform = self.evaluator.displacements(motion, problem.times, dofs)
            values.update(waveform=waveform, tau=problem.times)
            errors = self.evaluator.motion_errors(motion, waveform, dofs)
            values["waveform_error"] = errors[:, np.newaxis]
        if Stage.HARMONICS in self.stages:
            harmonics = self.evaluator.harmonics(motion, self._orders, dofs)
            values.update(harmonics=harmonics, harmonic=self._orders)
            errors = self.evaluator.motion_errors(motion, harmonics, dofs)
            values["harmonics_error"] = _HARMONIC * errors[:, np.newaxis]
        if outputs & DISPLACEMENTS:
            values["dof"] = dofs
        if Stage.ENERGY in self.stages:
            values["energy"] = self.evaluator.energy(motion)
            values["energy_error"] = self.evaluator.energy_errors(motion)
        if self._derivatives is not None:
            values.update(self._derivatives.values(problem, impulses, motion))
            values.update(named(problem.parameters))
        return Result(**values)

    def _absolute(self, impulses: Impulses, rounding: float) -> Floats:
        """Return errors of impulses that are rounded once more, (frequency, constraint)."""
        largest = np.maximum(np.abs(impulses.plus), np.abs(impulses.minus)).max(axis=1)
        with np.errstate(invalid="ignore"):
            error = (impulses.error + rounding) * largest
        # Without an impulse nothing is known of those that there might be.
        error = np.where(np.isfinite(impulses.error), error, np.inf)
        return np.repeat(error[:, np.newaxis], self.family.count, axis=1)

    def _impulses(self, problem: Problem, impulses: Impulses) -> dict[str, Floats]:
        """Return impulses, momenta and their errors."""
        to_momentum = 2.0 / problem.omega[:, np.newaxis]
        error = self._absolute(impulses, _OF_MOMENTA) * to_momentum
        values = {
            "impulse": impulses.plus,
            "momentum": impulses.plus * to_momentum,
            "momentum_error": error,
        }
        if self.family.kind is not Kind.ANTISYMMETRIC:
            values.update(
                impulse_lower=impulses.minus,
                momentum_lower=impulses.minus * to_momentum,
                impulse_lower_error=self._absolute(impulses, 0.0),
                momentum_lower_error=error,
            )
        return values

    def _shape(self, problem: Problem, motion: Any) -> dict[str, Floats]:
        """Return shapes and their errors; a struck degree of freedom is at its wall."""
        dofs = problem.output_dofs
        shape = self.evaluator.displacements(motion, _ONE, dofs)[:, 0]
        errors = self.evaluator.motion_errors(motion, shape, dofs)
        moves = np.abs(motion.p).max(axis=1) > 0.0
        for place in self.family.upper:
            one = problem.struck[place]
            if len(one.coordinate) == 1 and one.upper is not None:
                ((dof, weight),) = one.coordinate
                struck = np.ix_(moves, dofs == dof)
                shape[struck], errors[struck] = one.upper / weight, EPS * abs(one.upper / weight)
        return {"shape": shape, "shape_error": errors}

    @property
    def _has_proved_modes(self) -> bool:
        """Whether errors are bounds: all natural modes are known, with proved errors."""
        return isinstance(self.evaluator, ModalFamily) and self.evaluator.spectrum.proved

    def _statement(self) -> str:
        if has_all_modes(self.plan):
            statement = _PROVED if self._has_proved_modes else _ESTIMATED
            if isinstance(self.evaluator, ModalWithSeriesFamily):
                statement += _SERIES
            return statement + (_RADII if Stage.STABILITY in self.stages else "")
        return _PARTIAL if Stage.SPECTRUM in self.stages else _DIRECT

    def needs_path_check(self, problem: Problem, reason: Integers) -> Booleans:
        """Return where only a check of the path can tell whether the solution exists."""
        return np.asarray((reason == Reason.OK) & (problem.fundamental <= self._check_below))

    def _existence(
        self,
        problem: Problem,
        impulses: Impulses,
        motion: Any,
        reason: Integers,
        paths: PathMotions,
    ) -> dict[str, Any]:
        """Complete the reasons; return the outputs that depend on existence."""
        outputs, values = problem.outputs, dict[str, Any]()
        certified, witness = self._checked(problem, impulses, reason, paths)
        in_balls = self._extended(problem, reason, certified, witness)
        exists = reason == Reason.OK
        if outputs & {"exists", "reason"}:
            values.update(certified=certified, witness=witness, extended=in_balls)
        if "exists" in outputs:
            values["exists"] = exists
        if "reason" in outputs:
            values["reason"] = reason
        if "stability" in outputs:
            radii, errors = self._growth(problem, exists, motion, impulses)
            values.update(stability=radii, stability_error=errors * radii)
            values["neutral"] = stability.neutral(radii, errors * radii)
        return values

    def _checked(
        self, problem: Problem, impulses: Impulses, reason: Integers, paths: PathMotions
    ) -> tuple[Booleans, Floats]:
        """Complete the reasons; return whether they are proved, and witnesses (frequency,)."""
        witness = np.full(reason.size, np.nan)
        certified = self._certain(impulses, reason) & self._has_proved_modes
        where = paths.where
        if where.any():
            error = np.minimum(impulses.error[where], 1.0)
            witness[where], sure = self.evaluator.check_path(paths.motion, error, problem)
            certified[where] &= sure
            reason[~np.isnan(witness)] = Reason.PENETRATION
        return certified, witness

    def _extended(
        self, problem: Problem, reason: Integers, certified: Booleans, witness: Floats
    ) -> Booleans:
        """Decide in ball arithmetic what is not certain yet; return where, (frequency,)."""
        decided = np.zeros(reason.size, dtype=np.bool_)
        if not self._in_balls:
            return decided
        for f in np.flatnonzero(~certified & (reason != Reason.SINGULAR)):
            verdict = extended.decided(problem, int(f))
            if verdict is not None:
                (reason[f], witness[f]), decided[f] = verdict, True
        certified |= decided
        return decided

    def _certain(self, impulses: Impulses, reason: Integers) -> Booleans:
        """Return whether errors of the impulses leave the reasons unchanged, (frequency,)."""
        largest = np.maximum(np.abs(impulses.plus), np.abs(impulses.minus)).max(axis=1)
        error = (np.minimum(impulses.error, 1.0) * largest)[:, np.newaxis]
        pulls, leaves = np.zeros((2, reason.size), dtype=np.bool_)
        firm = np.ones(reason.size, dtype=np.bool_)
        mobility = self.evaluator.mobility
        sums = np.abs(mobility).sum(axis=0)
        for p, struck in ((impulses.plus, self.family.upper), (impulses.minus, self.family.lower)):
            walls = list(struck)
            pulls |= (p[:, walls] <= -error).any(axis=1)
            towards, velocity_error = (p @ mobility)[:, walls], error * sums[walls]
            leaves |= (towards <= -velocity_error).any(axis=1)
            firm &= (p[:, walls] > error).all(axis=1) & (towards > 4.0 * velocity_error).all(axis=1)
        decided = np.where(reason == Reason.WRONG_VELOCITY, leaves, firm)
        decided = np.where(reason == Reason.NEGATIVE_IMPULSE, pulls, decided)
        return np.asarray((impulses.error < _CERTAIN) & decided)

    def _growth(
        self, problem: Problem, exists: Booleans, motion: Any, impulses: Impulses
    ) -> tuple[Floats, Floats]:
        """Return spectral radii of the half-period maps and errors, nan without a motion."""
        radii, errors = np.full((2, exists.size), np.nan)
        error = np.minimum(impulses.error, 1.0)
        if exists.any() and Stage.STABILITY in self.stages:
            # Every plan with stability has all natural modes.
            assert isinstance(self.evaluator, ModalFamily)
            orbits = self.evaluator.orbits(
                motion.at(exists),
                problem.frequencies[exists],
                impulses.plus[exists],
                impulses.minus[exists],
                error[exists],
            )
            radii[exists], errors[exists] = stability.growth(orbits)
        return radii, errors

    def reasons(self, problem: Problem, impulses: Impulses) -> Integers:
        """Return the reason codes that follow from impulses and pre-impact velocities."""
        mobility = self.evaluator.mobility
        codes = np.zeros(impulses.error.size, dtype=np.int64)
        for p, struck in ((impulses.plus, self.family.upper), (impulses.minus, self.family.lower)):
            towards = p @ mobility
            wrong = ~(towards[:, struck] > 0.0).all(axis=1)
            codes[wrong & (codes == Reason.OK)] = Reason.WRONG_VELOCITY
        for p, struck in ((impulses.plus, self.family.upper), (impulses.minus, self.family.lower)):
            codes[~(p[:, struck] > 0.0).all(axis=1)] = Reason.NEGATIVE_IMPULSE
        codes[impulses.singular] = Reason.SINGULAR
        return codes
