"""Solution of calibrations: searches, statistics of the best fit, intervals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats, nothing
from vibroimpact_solvers.calibration import fitting, profiles, statistics
from vibroimpact_solvers.calibration.model import Evaluation, Model
from vibroimpact_solvers.calibration.planning import Search
from vibroimpact_solvers.calibration.problem import Problem
from vibroimpact_solvers.errors import ConvergenceError, ModelError, PlanError, SolverError
from vibroimpact_solvers.meter import metered
from vibroimpact_solvers.plan import Plan, Stage, Tick
from vibroimpact_solvers.results.calibration import Ending, Result

_AGAIN: Final = 3
"""How often a better fit may turn up in a profile."""
_STATEMENT: Final = (
    "Errors are numerical, estimated, and beside those of the noise: of the last step of the "
    "search, of the stated errors of the model and of its derivatives. Those of covariance and "
    "directions are to first order; an interval is known to a hundred-thousandth of its length."
)


@metered
def solve(problem: Problem, plan: Plan, tick: Tick | None = None) -> Result:
    """Find the values that fit best, and what the data tells of them.

    Parameters
    ----------
    problem : Problem
    plan : Plan
        From `plan`.
    tick : callable, optional
        Called with (done, total) searches and ends of intervals; may raise `Cancelled`.
    """
    step = plan.step(Stage.FIT)
    assert step is not None
    assert isinstance(step.settings, Search)
    ends = 0 if plan.step(Stage.PROFILE) is None else 2 * len(problem.unknowns)
    done, total = 0, step.settings.starts + ends

    def report() -> None:
        nonlocal done
        done = min(done + 1, total)
        if tick is not None:
            tick(done, total)

    if tick is not None:
        tick(0, total)
    model = Model(problem, step.settings.differences)
    searches, failure = fitting.search_all(model, step.settings.starts, report)
    best = int(np.argmin([search.chi2 for search in searches]))
    end = searches[best].end
    if end is None:
        raise _impossible(failure)
    done = step.settings.starts
    at, last = fitting.polished(model, end)
    intervals = None
    for _ in range(_AGAIN):
        fisher = statistics.Fisher.of(model, at, last)
        directions = fisher.directions()
        covariance = fisher.covariance(directions)
        if not ends:
            break
        try:
            intervals = profiles.intervals(model, at, covariance[0], report)
            break
        except profiles.LowerError as lower:
            at, last = _lower(model, lower.better)
    return _result(problem, model, _Best(searches, best, fisher, directions, covariance, intervals))


def _lower(model: Model, better: Evaluation) -> tuple[Evaluation, Floats]:
    """Return the best fit near a point that is better than what counted as the best."""
    problem = model.problem
    fit = fitting.least_squares(model, better, problem.bounds, problem.scale, problem.evaluations)
    return fitting.polished(model, fit.end)


def _impossible(failure: SolverError | None) -> SolverError:
    """Return the error of a calibration none of whose starts can be computed."""
    message = "the model cannot be computed at any start"
    if isinstance(failure, ModelError | PlanError):
        return PlanError(f"{message}: {failure.message}", ("unknowns",))
    return ConvergenceError(f"{message}: {failure}")


@dataclass(frozen=True, eq=False, slots=True)
class _Best:
    """The best fit and what is known of it."""

    searches: list[fitting.Search]
    place: int
    fisher: statistics.Fisher
    directions: statistics.Directions
    covariance: tuple[Floats, Floats]
    intervals: list[tuple[profiles.End, profiles.End]] | None


def _result(problem: Problem, model: Model, best: _Best) -> Result:
    """Return the result, without outputs that were not requested."""
    fisher, at, sigma = best.fisher, best.fisher.at, model.sigma
    of_model = np.nan_to_num(at.errors, nan=np.inf)
    error = fisher.error(of_model / sigma)
    doubt = _doubt(at, error, of_model, sigma)
    test = statistics.noise_test(fisher, best.directions, problem.count + problem.priors, doubt)
    outputs, names = problem.outputs, [unknown.path for unknown in problem.unknowns]
    fields: dict[str, Any] = {
        "unknown": names,
        "unknown_unit": [unknown.unit for unknown in problem.unknowns],
        "value": at.x,
        "error_value": error,
        **_of_searches(best, len(names)),
        "count_evaluations": model.evaluations,
        "count_differences": model.for_differences,
        "count_unmatched": at.unmatched,
        "error_statement": _STATEMENT,
        "neglected": model.neglected,
        "cautions": list(_cautions(problem, best, test, of_model)) or None,
    }
    if "covariance" in outputs:
        fields["covariance"], fields["error_covariance"] = best.covariance
    if best.intervals is not None:
        ends = np.array([[end.value for end in pair] for pair in best.intervals])
        errors = np.array([[end.error for end in pair] for pair in best.intervals])
        fields["interval"], fields["error_interval"] = ends, errors + error[:, np.newaxis]
    if "undetermined" in outputs:
        fields["undetermined"] = statistics.sentences(best.directions, names)
        fields["direction_vector"] = best.directions.vector
        fields["direction_deviation"] = best.directions.deviation
        fields["error_direction_vector"] = best.directions.vector_error
        fields["error_direction_deviation"] = best.directions.deviation_error
    if "residual" in outputs:
        which, places = model.places
        fields |= {
            "residual": -at.residuals[: sigma.size],
            "error_residual": doubt[: sigma.size],
            "measurement_data": which,
            "measurement_index": places,
            "measurement_measured": model.measured,
            "measurement_sigma": sigma,
            "measurement_computed": at.computed,
            "error_measurement_computed": doubt[: sigma.size] * sigma,
        }
    if "chi2" in outputs:
        fields |= {"chi2": test.chi2, "error_chi2": test.chi2_error}
        fields |= {"degrees_of_freedom": test.freedom, "p": test.p, "error_p": test.p_error}
    if "model_fits" in outputs:
        fields["model_fits"] = test.fits
    return Result(**(nothing(Result) | fields))


def _doubt(at: Evaluation, error: Floats, of_model: Floats, sigma: Floats) -> Floats:
    """Return the errors of the residuals at the best fit, shape (residual,)."""
    assert at.jacobian is not None
    rows = np.abs(at.jacobian)
    doubt = np.where(rows > 0.0, rows * error, 0.0).sum(axis=1)
    doubt[: sigma.size] += (of_model + 4.0 * EPS * np.abs(at.computed)) / sigma
    return np.asarray(doubt)


def _of_searches(best: _Best, unknowns: int) -> dict[str, Any]:
    """Return the fields of the starts."""
    searches, nowhere = best.searches, np.full(unknowns, np.nan)
    ends = [search.end for search in searches]
    return {
        "start_initial": np.stack([search.start for search in searches]),
        "start_value": np.stack([nowhere if end is None else end.x for end in ends]),
        "start_chi2": np.array([np.nan if end is None else end.chi2 for end in ends]),
        "start_evaluations": np.array([search.evaluations for search in searches]),
        "start_status": np.array([int(search.ending) for search in searches]),
        "best": best.place,
        "converged": searches[best.place].ending is Ending.CONVERGED,
    }


def _cautions(
    problem: Problem, best: _Best, test: statistics.NoiseTest, of_model: Floats
) -> Iterator[str]:
    """Yield what a user should know before the numbers, a sentence each."""
    if (search := best.searches[best.place]).ending is not Ending.CONVERGED:
        yield f"the search did not converge in {search.evaluations} evaluations"
    for unknown, free in zip(problem.unknowns, best.fisher.free, strict=True):
        if not free:
            yield f"{unknown.path} lies at a bound, where its covariance has no meaning"
    if test.freedom < 1:
        yield "there are no more measurements than unknowns: nothing tests the model"
    if (count := best.fisher.at.unmatched) > 0:
        what = "impact" if problem.base_kind.chosen is None else "stable, admissible motion"
        yield f"model and record differ by {count} {what}{'s' if count > 1 else ''}"
    if np.isinf(of_model).any():
        yield (
            "measurements lie beyond the time until which the motion is predictable: a shorter "
            "record tells more"
        )
