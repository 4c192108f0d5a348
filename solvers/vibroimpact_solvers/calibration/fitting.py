"""Least squares: searches from several starts, and the last steps to the best fit."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import scipy.optimize
import scipy.stats

from vibroimpact_solvers.arrays import Booleans, Floats
from vibroimpact_solvers.calibration.model import Evaluation, Model
from vibroimpact_solvers.calibration.problem import Problem, Unknown
from vibroimpact_solvers.errors import SolverError
from vibroimpact_solvers.results.calibration import Ending

CANDIDATES: Final = 8
"""Points that are looked at for each start but the first."""
LEVEL: Final = 0.05
"""Probability below which the data rejects the model."""
_TOLERANCE: Final = 1e-10
_AT_BOUND: Final = 1e-7
"""Distance from a bound, in parts of the size of an unknown, at which it counts as being there."""
_NEAR_BOUND: Final = 1e-3
"""The same for bounds towards which the sum of squares falls."""
_SAME_CHI2: Final = 1e-4
_POLISHES: Final = 8
_RANK: Final = 1e-9
"""Singular value, relative to the largest, below which a direction is not told at all."""
RANK_BY_DIFFERENCES: Final = 1e-6
"""The same with derivatives by differences, whose errors are larger."""


@dataclass(frozen=True, eq=False, slots=True)
class Search:
    """What the search from one start ended with."""

    start: Floats
    end: Evaluation | None
    evaluations: int
    ending: Ending

    @property
    def chi2(self) -> float:
        """Sum of squares at the end; infinite where nothing can be computed at the start."""
        return np.inf if self.end is None else self.end.chi2


def search_all(
    model: Model, searches: int, report: Callable[[], None]
) -> tuple[list[Search], SolverError | None]:
    """Search from one start after the other, until two agree on a fit that the data permits.

    Returns
    -------
    list of Search
    SolverError or None
        Why the first start that could not be computed could not.
    """
    made: list[Search] = []
    failure: SolverError | None = None
    for start in _starts(model, searches):
        outcome = _search(model, start)
        if isinstance(outcome, SolverError):
            failure = failure or outcome
            outcome = Search(start, None, 1, Ending.NOT_POSSIBLE)
        made.append(outcome)
        report()
        if _agreed(model.problem, made):
            break
    return made, failure


def _search(model: Model, start: Floats) -> Search | SolverError:
    """Search from one start."""
    first = model.evaluate(start, rates=True)
    if isinstance(first, SolverError):
        return first
    problem, before = model.problem, model.evaluations
    fit = least_squares(model, first, problem.bounds, problem.scale, problem.evaluations)
    ending = Ending.CONVERGED if fit.converged else Ending.EVALUATIONS
    return Search(start, fit.end, 1 + model.evaluations - before, ending)


@dataclass(frozen=True, eq=False, slots=True)
class Fit:
    """The end of a search."""

    end: Evaluation
    converged: bool


def least_squares(
    model: Model,
    first: Evaluation,
    bounds: tuple[Floats, Floats],
    scale: Floats,
    evaluations: int,
    free: Booleans | None = None,
    tolerance: float = _TOLERANCE,
) -> Fit:
    """Return the least sum of squares near a point, by a trust region within the bounds.

    Parameters
    ----------
    model : Model
    first : Evaluation
        Where the search begins, with the Jacobian.
    bounds, scale
        Of the unknowns.
    evaluations : int
        Most of them.
    free : array of bool, optional
        Unknowns that may change; None: all.
    tolerance : float
        Relative change of the sum, or of the point, at which the search ends.
    """
    chosen = np.ones(first.x.size, dtype=bool) if free is None else free
    best = first

    @lru_cache(1)  # the Jacobian is that of the point at which residuals were asked for last
    def evaluated(point: bytes) -> Evaluation | SolverError:
        nonlocal best
        outcome = model.evaluate(np.frombuffer(point), rates=True)
        if isinstance(outcome, Evaluation) and outcome.chi2 < best.chi2:
            best = outcome
        return outcome

    def at(part: Floats) -> Evaluation | SolverError:
        x = first.x.copy()
        x[chosen] = part
        if not np.isfinite(x).all():
            return SolverError("the step is not finite")
        return first if x.tobytes() == first.x.tobytes() else evaluated(x.tobytes())

    def residuals(part: Floats) -> Floats:
        outcome = at(part)
        if isinstance(outcome, SolverError):
            return np.full(first.residuals.size, np.inf)
        return outcome.residuals

    def jacobian(part: Floats) -> Floats:
        outcome = at(part)
        assert isinstance(outcome, Evaluation)
        assert outcome.jacobian is not None
        return outcome.jacobian[:, chosen]

    assert first.jacobian is not None
    if not (first.jacobian[:, chosen].T @ first.residuals).any():
        return Fit(first, True)
    # A slope that is zero to the last bit is divided by itself on the way.
    with np.errstate(all="ignore"):
        solution = scipy.optimize.least_squares(
            residuals,
            first.x[chosen],
            jac=jacobian,
            bounds=(bounds[0][chosen], bounds[1][chosen]),
            x_scale=scale[chosen],
            ftol=tolerance,
            xtol=tolerance,
            gtol=None,
            max_nfev=evaluations,
        )
    return Fit(best, solution.status > 0)


def _agreed(problem: Problem, made: list[Search]) -> bool:
    """Whether two searches ended at the same best fit, which the data does not reject."""
    order = sorted(made, key=lambda each: each.chi2)
    if len(order) < 2 or order[1].end is None or order[0].end is None:
        return False
    lowest, next_ = order[0], order[1]
    alike = next_.chi2 - lowest.chi2 <= _SAME_CHI2 * (1.0 + lowest.chi2)
    freedom = problem.count + problem.priors - len(problem.unknowns)
    return bool(alike and (freedom < 1 or scipy.stats.chi2.sf(lowest.chi2, freedom) >= LEVEL))


def _starts(model: Model, searches: int) -> Iterator[Floats]:
    """Yield starts: the given one, then the best of points spread over the range.

    These are made when the second one is asked for.
    """
    problem = model.problem
    yield problem.start
    if searches < 2:
        return
    points = _spread(problem, CANDIDATES * (searches - 1))
    outcomes = [model.evaluate(x, rates=False) for x in points]
    sums = [np.inf if isinstance(each, SolverError) else each.chi2 for each in outcomes]
    for place in np.argsort(sums, kind="stable")[: searches - 1]:
        yield points[place]


def _spread(problem: Problem, count: int) -> Floats:
    """Return points of a Latin hypercube over the range of the unknowns, (point, unknown)."""
    seed = problem.seed
    if seed is None:
        digest = hashlib.sha256()
        for data in problem.data:
            digest.update(np.ascontiguousarray(data.values).tobytes())
        seed = int.from_bytes(digest.digest()[:8], "little")
    random = np.random.default_rng(seed)
    columns = []
    for unknown in problem.unknowns:
        low, high = _range(unknown)
        strata = (random.permutation(count) + random.random(count)) / count
        columns.append(low + (high - low) * strata)
    return np.stack(columns, axis=1)


def _range(unknown: Unknown) -> tuple[float, float]:
    """Return the range in which starts lie: the bounds, the prior, or half the size about it."""
    middle, reach = unknown.start, 0.5 * unknown.scale
    if unknown.prior is not None:
        middle, reach = unknown.prior.mean, 2.0 * unknown.prior.sigma
    low, high = middle - reach, middle + reach
    if unknown.prior is None:
        low = unknown.lower if np.isfinite(unknown.lower) else low
        high = unknown.upper if np.isfinite(unknown.upper) else high
    return float(np.clip(low, unknown.lower, unknown.upper)), float(
        np.clip(high, unknown.lower, unknown.upper)
    )


def at_bounds(problem: Problem, x: Floats) -> Booleans:
    """Return which unknowns lie at a bound, shape (unknown,)."""
    low, high = problem.bounds
    reach = _AT_BOUND * problem.scale
    return (x - low <= reach) | (high - x <= reach)


def polished(model: Model, end: Evaluation) -> tuple[Evaluation, Floats]:
    """Take the last steps to a best fit, with unknowns at their bounds held there.

    Returns
    -------
    Evaluation
        With the Jacobian.
    array, shape (unknown,)
        How far the next step would go: the error of the point, without that of the model.
    """
    problem = model.problem
    low, high = problem.bounds
    at = _snapped(model, end)
    step = np.zeros(at.x.size)
    for _ in range(_POLISHES):
        step = _newton_step(model, at)
        size = float(np.abs(step / problem.scale).max(initial=0.0))
        if size <= 4.0 * np.finfo(np.float64).eps:
            break
        moved = model.evaluate(np.clip(at.x + step, low, high), rates=True)
        if isinstance(moved, SolverError) or moved.chi2 > at.chi2 * (1.0 + 1e-14):
            break
        before, at = size, moved
        step = _newton_step(model, at)
        if float(np.abs(step / problem.scale).max(initial=0.0)) > 0.5 * before:
            break  # only roundings are left
    return at, np.abs(step)


def _snapped(model: Model, end: Evaluation) -> Evaluation:
    """Put unknowns at the bounds that they approach: a trust region stays inside."""
    assert end.jacobian is not None
    problem = model.problem
    low, high = problem.bounds
    downhill = -(end.jacobian.T @ end.residuals)
    near = _NEAR_BOUND * problem.scale
    x = np.where((end.x - low <= near) & (downhill < 0.0), low, end.x)
    x = np.where((high - x <= near) & (downhill > 0.0), high, x)
    if (x == end.x).all():
        return end
    moved = model.evaluate(x, rates=True)
    better = isinstance(moved, Evaluation) and moved.chi2 <= end.chi2
    return moved if isinstance(moved, Evaluation) and better else end


def _newton_step(model: Model, at: Evaluation) -> Floats:
    """Return the step to the minimum of the equations made linear, of unknowns off their bounds."""
    assert at.jacobian is not None
    problem = model.problem
    held = at_bounds(problem, at.x)
    scaled = at.jacobian * problem.scale
    scaled[:, held] = 0.0
    step = np.linalg.lstsq(scaled, -at.residuals, rcond=rank_limit(model))[0]
    return np.asarray(step * problem.scale)


def rank_limit(model: Model) -> float:
    """Return the singular value, relative to the largest, below which nothing is told."""
    return RANK_BY_DIFFERENCES if model.differences else _RANK
