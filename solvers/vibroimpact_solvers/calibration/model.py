"""The base as functions of the unknowns: residuals of all measurements, and their Jacobian.

Residuals are ``(computed - measured) / sigma``, one for each measurement in the order of the data;
one for all impacts that the model has beyond those measured; and one for each prior.
Impacts are matched in their order. One that the model lacks counts as one at the end of the record,
of no velocity and no impulse; one that it has too many as one that was measured at the end of the
record. Both are continuous where an impact passes the end of the record.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.calibration.kinds import IMPACT, TIMES
from vibroimpact_solvers.calibration.problem import Data, Problem
from vibroimpact_solvers.errors import SolverError, attempt
from vibroimpact_solvers.meter import look

_STEP: Final = EPS ** (1.0 / 3.0)
"""Steps of central differences in parts of the unknowns: roundings and curvature are then alike."""
_ONE_SIDED: Final = 1e-3
"""Relative error that is assumed of a difference quotient of one side."""


@dataclass(frozen=True, eq=False, slots=True)
class Evaluation:
    """Residuals at one point, and what they were made of."""

    x: Floats  # (unknown,)
    residuals: Floats  # (residual,)
    jacobian: Floats | None  # (residual, unknown)
    computed: Floats  # (measurement,)
    errors: Floats  # of computed, (measurement,)
    rate_errors: Floats | None  # of the Jacobian, (residual, unknown)
    unmatched: int

    @property
    def chi2(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)


class _Rows(NamedTuple):
    """What one entry of data takes from a result."""

    values: Floats  # (measurement,)
    errors: Floats
    rates: Floats | None  # (measurement, unknown)
    rate_errors: Floats | None
    lacking: int  # rows of motions that cannot have been measured


@dataclass(eq=False, slots=True)
class Model:
    """The residuals of a problem as functions of the unknowns; counts what it computes.

    Parameters
    ----------
    problem : Problem
    differences : bool
        Whether the Jacobian is that of central differences.
    """

    problem: Problem
    differences: bool
    evaluations: int = 0
    for_differences: int = 0
    neglected: list[str] | None = None
    _measured: list[tuple[Data, Integers]] = field(init=False)

    def __post_init__(self) -> None:
        self._measured = [
            (data, np.flatnonzero(np.isfinite(data.values))) for data in self.problem.data
        ]

    @property
    def measured(self) -> Floats:
        """The measured values, shape (measurement,)."""
        return np.concatenate([data.values.ravel()[places] for data, places in self._measured])

    @property
    def sigma(self) -> Floats:
        """Standard deviations of the measured values, shape (measurement,)."""
        return np.concatenate(
            [
                np.broadcast_to(data.sigma, data.values.shape).ravel()[places]
                for data, places in self._measured
            ]
        )

    @property
    def places(self) -> tuple[Integers, Integers]:
        """Entry of data of each measurement, and its place in the values, row by row."""
        which = [np.full(places.size, k) for k, (_, places) in enumerate(self._measured)]
        return np.concatenate(which), np.concatenate([places for _, places in self._measured])

    def evaluate(self, x: Floats, *, rates: bool) -> Evaluation | SolverError:
        """Return the residuals at a point, with their Jacobian, or why there are none."""
        with np.errstate(over="ignore", invalid="ignore"):
            outcome: Evaluation | SolverError = attempt(self._at, x, rates and not self.differences)
            if isinstance(outcome, SolverError):
                return outcome
            if not np.isfinite(outcome.chi2):
                return SolverError("the sum of squared residuals is too large for double precision")
            if not rates:
                return outcome
            if outcome.jacobian is None or not np.isfinite(outcome.jacobian).all():
                outcome = self._differenced(outcome)
            assert outcome.jacobian is not None
            if not np.isfinite(outcome.jacobian * self.problem.scale).all():
                return SolverError("the residuals have no derivatives in double precision")
            return outcome

    def _at(self, x: Floats, rates: bool) -> Evaluation:
        look()
        self.evaluations += 1
        point = self.problem.at(x, rates)
        solver = self.problem.base_kind.solver
        result = solver.solve(point.problem, solver.plan(point.problem))
        self.neglected = self.neglected or getattr(result, "neglected", None)
        weights = point.weights if rates else None
        rows = [self._rows(result, *each, point.problem, weights) for each in self._measured]
        computed = np.concatenate([row.values for row in rows])
        if not np.isfinite(computed).all():
            raise SolverError("an output that is measured has no value there")
        errors = np.concatenate([row.errors for row in rows])
        sigma = self.sigma
        beyond = self._beyond(result, point.problem, weights)
        off, of_priors = self._priors(x)
        residuals = np.concatenate([(computed - self.measured) / sigma, beyond.residual, off])
        unmatched = beyond.unmatched + sum(row.lacking for row in rows)
        if weights is None:
            return Evaluation(x, residuals, None, computed, errors, None, unmatched)
        of_data = _joined([row.rates for row in rows]) / sigma[:, np.newaxis]
        doubt = _joined([row.rate_errors for row in rows]) / sigma[:, np.newaxis]
        jacobian = np.concatenate([of_data, beyond.rates, of_priors])
        doubts = np.concatenate([doubt, np.zeros((len(jacobian) - len(doubt), x.size))])
        return Evaluation(x, residuals, jacobian, computed, errors, doubts, unmatched)

    def _priors(self, x: Floats) -> tuple[Floats, Floats]:
        """Return the residuals of the priors, shape (prior,), and their Jacobian."""
        known = [(place, u.prior) for place, u in enumerate(self.problem.unknowns) if u.prior]
        off = np.array([(x[place] - mean) / sigma for place, (mean, sigma) in known])
        rows = np.zeros((len(known), x.size))
        for row, (place, (_, sigma)) in zip(rows, known, strict=True):
            row[place] = 1.0 / sigma
        return off.reshape(len(known)), rows

    def _rows(
        self, result: Any, data: Data, places: Integers, base: Any, weights: Floats | None
    ) -> _Rows:
        """Return what a result has of some measurements."""
        kind = self.problem.base_kind
        fields = kind.measured()
        output = data.output
        if getattr(result, fields[output].name) is None and output in kind.absent:
            output = kind.absent[output]
        values = np.asarray(getattr(result, fields[output].name))
        errors = getattr(result, kind.error(output).name)
        errors = np.full(values.shape, np.nan) if errors is None else errors
        errors = np.broadcast_to(errors, values.shape)
        parts = [values, errors]
        if weights is not None:
            rates = np.asarray(getattr(result, kind.rates(output).name)) * weights
            of_rates = getattr(result, kind.error(output, rates=True).name)
            parts += [rates, np.broadcast_to(of_rates, rates.shape) * np.abs(weights)]
        lacking = 0
        if kind.chosen is not None:
            rows, lacking = kind.chosen(result, values, data.values, data.sigma)
            parts = [part[rows] for part in parts]
        if data.rows is not None:
            parts = [part[data.rows] for part in parts]
        parts = [part[: len(data.values)] for part in parts]
        if fields[output].quantity.dims[0] == IMPACT:
            end = base.t_end if output == TIMES else 0.0
            parts = [
                _lengthened(part, len(data.values), end * (k == 0)) for k, part in enumerate(parts)
            ]
        if data.output in kind.signs:
            parts = _turned(parts, data)
        dims, size = data.values.ndim, data.values.size
        flat = [part.reshape(size, *part.shape[dims:])[places] for part in parts]
        if weights is None:
            return _Rows(flat[0], flat[1], None, None, lacking)
        return _Rows(flat[0], flat[1], flat[2], flat[3], lacking)

    def _beyond(self, result: Any, base: Any, weights: Floats | None) -> _Beyond:
        """Return the residual of the impacts that the model has beyond those measured.

        There is one where times of impacts are measured.
        """
        unknowns = len(self.problem.unknowns)
        for data, _ in self._measured:
            if data.output != TIMES:
                continue
            count, sigma = len(data.values), float(np.mean(data.sigma))
            scaled = (base.t_end - result.impact_time[count:]) / sigma
            size = float(np.sqrt(scaled @ scaled))
            row = np.zeros((1, unknowns))
            if weights is not None and size > 0.0:
                row[0] = (
                    -(scaled / size) @ (result.derivative_impact_time[count:] * weights) / sigma
                )
            return _Beyond(np.array([size]), row, abs(int(result.impact_time.size) - count))
        return _Beyond(np.zeros(0), np.zeros((0, unknowns)), 0)

    def _differenced(self, at: Evaluation) -> Evaluation:
        """Return the same with central differences where there is no derivative."""
        low, high = self.problem.bounds
        columns, doubts = [], []
        before = self.evaluations
        for place, size in enumerate(self.problem.scale):
            h = _STEP * max(size, abs(at.x[place]))
            ends: list[tuple[float, Evaluation]] = []
            for step in (-h, h):
                x = at.x.copy()
                x[place] += step
                if low[place] <= x[place] <= high[place]:
                    outcome = attempt(self._at, x, False)
                    if isinstance(outcome, Evaluation) and outcome.unmatched == at.unmatched:
                        ends.append((x[place] - at.x[place], outcome))
            columns.append(_slope(at, ends))
            rounding = np.zeros(at.residuals.size)
            rounding[: at.errors.size] = np.nan_to_num(at.errors) / self.sigma
            doubts.append(rounding / h + _curvature(at, ends))
        self.for_differences += self.evaluations - before
        jacobian, doubt = np.stack(columns, axis=1), np.stack(doubts, axis=1)
        if at.jacobian is not None and at.rate_errors is not None:
            known = np.isfinite(at.jacobian)
            jacobian = np.where(known, at.jacobian, jacobian)
            doubt = np.where(known, at.rate_errors, doubt)
        return Evaluation(at.x, at.residuals, jacobian, at.computed, at.errors, doubt, at.unmatched)


class _Beyond(NamedTuple):
    """Impacts that the model has beyond those measured."""

    residual: Floats  # (1,)
    rates: Any  # (1, unknown)
    unmatched: int


def _slope(at: Evaluation, ends: list[tuple[float, Evaluation]]) -> Floats:
    """Return the difference quotient of residuals; zero where neither side can be computed."""
    match ends:
        case [(a, first), (b, second)]:
            return np.asarray((second.residuals - first.residuals) / (b - a))
        case [(a, first)]:
            return np.asarray((first.residuals - at.residuals) / a)
        case _:
            return np.zeros_like(at.residuals)


def _curvature(at: Evaluation, ends: list[tuple[float, Evaluation]]) -> Floats:
    """Return an estimate of what difference quotients miss, from those of both sides."""
    slopes = [(each.residuals - at.residuals) / step for step, each in ends]
    if len(slopes) == 2:
        return np.asarray(_STEP * np.abs(slopes[1] - slopes[0]))
    return _ONE_SIDED * np.abs(slopes[0] if slopes else np.zeros_like(at.residuals))


def _lengthened(part: Floats, count: int, fill: float) -> Floats:
    """Return as many rows as were measured; those that the model lacks are filled."""
    lacking = np.full((count - len(part), *part.shape[1:]), fill)
    return np.concatenate([part, lacking])


def _joined(parts: list[Floats | None]) -> Floats:
    return np.concatenate([part for part in parts if part is not None])


def _turned(parts: list[Floats], data: Data) -> list[Floats]:
    """Return modes with the signs that are nearer to those measured."""
    known: Booleans = np.isfinite(data.values)
    weighted = np.where(known, data.values, 0.0) / np.broadcast_to(data.sigma, known.shape) ** 2
    signs = np.where((weighted * parts[0]).sum(axis=1) < 0.0, -1.0, 1.0)
    turned = list(parts)
    for k in (0, 2):
        if k < len(parts):
            turned[k] = parts[k] * signs.reshape(-1, *[1] * (parts[k].ndim - 1))
    return turned
