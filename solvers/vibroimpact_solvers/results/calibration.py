"""Calibrations: the numbers of a model that fit measurements, and how well these tell them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, ClassVar, Final

from vibroimpact_solvers.arrays import Floats, Group, Integers, Quantity
from vibroimpact_solvers.results.shared import Neglected, Statement


class Ending(IntEnum):
    """How the search from one start ended."""

    CONVERGED = 0
    EVALUATIONS = 1
    NOT_POSSIBLE = 2


ENDINGS: Final = tuple(each.name.lower() for each in Ending)

_MIXED: Final = "in the units of the unknowns"
_UNTOLD: Final = "the data does not tell it"
_BEYOND: Final = "the motion is not predictable as long as the record"
_UNBOUNDED: Final = "no end: the data does not bound it"


def _measurement(column: str, long_name: str, **rest: Any) -> Quantity:
    """Return the declaration of a column of the measurements."""
    return Quantity(("measurement",), "1", long_name, path=f"measurements/{column}", **rest)


def _start(column: str, dims: tuple[str, ...], long_name: str, **rest: Any) -> Quantity:
    """Return the declaration of a column of the starts."""
    return Quantity(("start", *dims), "1", long_name, path=f"starts/{column}", **rest)


def _direction(column: str, dims: tuple[str, ...], long_name: str, **rest: Any) -> Quantity:
    """Return the declaration of a column of the directions."""
    return Quantity(("direction", *dims), "1", long_name, path=f"directions/{column}", **rest)


def _error(of: str, dims: tuple[str, ...], what: str, **rest: Any) -> Quantity:
    return Quantity(dims, "1", f"absolute error of the {what}", path=f"error/{of}", **rest)


@dataclass(frozen=True, eq=False)
class Result:
    """The values that fit best, and what the measurements tell of them.

    Measurements are those that are not null, in the order of the data.
    """

    GROUPS: ClassVar[Mapping[str, Group]] = {
        "measurements": Group("Measurements", "All measured numbers, one column each."),
        "directions": Group(
            "Directions",
            "Principal axes of the covariance, the least known first, in parts of the values.",
        ),
        "starts": Group("Starts", "Searches from each start, one column each."),
        "count": Group("CalibrationCount", "Numbers of computations."),
        "error": Group("CalibrationError", "Numerical errors of the outputs.", together=False),
        "error/measurements": Group("MeasurementsError", "Errors of columns of the measurements."),
        "error/directions": Group("DirectionsError", "Errors of columns of the directions."),
    }

    unknown: Annotated[
        list[str],
        Quantity(("unknown",), "1", "path of the unknown in the base", True),
    ]
    unknown_unit: Annotated[list[str], Quantity(("unknown",), "1", "unit of the unknown")]
    value: Annotated[
        Floats,
        Quantity(("unknown",), "1", "value that fits best", note=_MIXED, error="error/value"),
    ]
    covariance: Annotated[
        Floats | None,
        Quantity(
            ("unknown", "other"),
            "1",
            "covariance of the values",
            note=f"{_MIXED}; of the equations made linear, for unknowns that are not at a bound",
            missing=f"{_UNTOLD}, or it is at a bound",
            error="error/covariance",
        ),
    ]
    interval: Annotated[
        Floats | None,
        Quantity(
            ("unknown", "end"),
            "1",
            "95 % interval of each unknown, lower and upper end",
            note=f"{_MIXED}; by profile of the likelihood, cut at the bounds",
            missing=_UNBOUNDED,
            error="error/interval",
        ),
    ]
    undetermined: Annotated[
        list[str] | None,
        Quantity(
            ("undetermined",),
            "1",
            "combination of unknowns, relative changes by the sizes of their values, that the data "
            "does not tell",
        ),
    ]
    residual: Annotated[
        Floats | None,
        Quantity(
            ("measurement",),
            "1",
            "measured less computed value, by its standard deviation",
            error="error/residual",
        ),
    ]
    measurement_data: Annotated[Integers | None, _measurement("data", "index of the entry of data")]
    measurement_index: Annotated[
        Integers | None, _measurement("index", "place in its values, row by row")
    ]
    measurement_measured: Annotated[Floats | None, _measurement("measured", "measured value")]
    measurement_sigma: Annotated[
        Floats | None, _measurement("sigma", "standard deviation of the noise")
    ]
    measurement_computed: Annotated[
        Floats | None,
        _measurement(
            "computed",
            "value of the model at the best fit",
            note="in the unit of the output; of an impact that the model lacks the end of the "
            "record, or the measured value",
            error="error/measurements/computed",
        ),
    ]
    chi2: Annotated[
        float | None,
        Quantity(
            (),
            "1",
            "sum of the squared residuals",
            note="with a term for each prior, and for impacts that the model has beyond those "
            "measured",
            error="error/chi2",
        ),
    ]
    degrees_of_freedom: Annotated[
        int | None,
        Quantity((), "1", "measurements and priors less the combinations that they determine"),
    ]
    p: Annotated[
        float | None,
        Quantity(
            (),
            "1",
            "probability of a larger chi2 if model and noise are right",
            note="absent without degrees of freedom",
            error="error/p",
        ),
    ]
    model_fits: Annotated[
        bool | None,
        Quantity(
            (),
            "1",
            "whether p is at least 0.05: the data does not reject the model",
            note="absent without degrees of freedom",
        ),
    ]
    direction_vector: Annotated[
        Floats | None,
        _direction(
            "vector", ("unknown",), "components, parts of the sizes of the unknowns",
            error="error/directions/vector",
        ),
    ]  # fmt: skip
    direction_deviation: Annotated[
        Floats | None,
        _direction(
            "deviation",
            (),
            "standard deviation along it, in parts of the sizes of the unknowns",
            missing=_UNTOLD,
            error="error/directions/deviation",
        ),
    ]
    start_initial: Annotated[
        Floats, _start("initial", ("unknown",), "values from which the search began", note=_MIXED)
    ]
    start_value: Annotated[
        Floats,
        _start(
            "value", ("unknown",), "values at which it ended", note=_MIXED,
            missing="nothing can be computed at the start",
        ),
    ]  # fmt: skip
    start_chi2: Annotated[
        Floats,
        _start("chi2", (), "chi2 at its end", missing="nothing can be computed at the start"),
    ]
    start_evaluations: Annotated[Integers, _start("evaluations", (), "evaluations of the model")]
    start_status: Annotated[Integers, _start("status", (), "how the search ended", flags=ENDINGS)]
    best: Annotated[int, Quantity((), "1", "index of the start that led to the best fit")]
    converged: Annotated[bool, Quantity((), "1", "whether the search from that start converged")]
    count_evaluations: Annotated[
        int,
        Quantity(
            (), "1", "computations of the base, those for differences included",
            path="count/evaluations",
        ),
    ]  # fmt: skip
    count_differences: Annotated[
        int,
        Quantity((), "1", "computations for differences alone", path="count/differences"),
    ]
    count_unmatched: Annotated[
        int,
        Quantity(
            (), "1",
            "impacts that the model has and the data has not, or the other way round, or "
            "frequencies at which the model has no stable motion, at the best fit",
            path="count/unmatched",
        ),
    ]  # fmt: skip
    error_value: Annotated[
        Floats,
        _error("value", ("unknown",), "value, without the noise of the data", missing=_BEYOND),
    ]
    error_covariance: Annotated[
        Floats | None,
        _error(
            "covariance", ("unknown", "other"), "covariance",
            missing=f"{_UNTOLD}, or it is at a bound",
        ),
    ]  # fmt: skip
    error_interval: Annotated[
        Floats | None, _error("interval", ("unknown", "end"), "end", missing=_UNBOUNDED)
    ]
    error_residual: Annotated[
        Floats | None, _error("residual", ("measurement",), "residual", missing=_BEYOND)
    ]
    error_measurement_computed: Annotated[
        Floats | None,
        _error("measurements/computed", ("measurement",), "computed value", missing=_BEYOND),
    ]
    error_chi2: Annotated[float | None, _error("chi2", (), "chi2", missing=_BEYOND)]
    error_p: Annotated[float | None, _error("p", (), "probability")]
    error_direction_vector: Annotated[
        Floats | None,
        _error(
            "directions/vector", ("direction", "unknown"), "components",
            missing="the direction cannot be told from its neighbours",
        ),
    ]  # fmt: skip
    error_direction_deviation: Annotated[
        Floats | None,
        _error("directions/deviation", ("direction",), "standard deviation", missing=_UNTOLD),
    ]
    error_statement: Statement
    neglected: Neglected
    cautions: Annotated[
        list[str] | None,
        Quantity(
            (), "1", "what to know before the numbers are used, a sentence each", path="cautions"
        ),
    ]
