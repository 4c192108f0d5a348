"""Documents of frequency and time grids."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from pydantic import Discriminator, Field, Tag, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from vibroimpact_schema.values import (
    LARGEST_INTEGER,
    Count,
    Document,
    NonNegative,
    Positive,
    Positives,
    holds,
)

VALUES: Final = "@values"
STEPS: Final = "@steps"
POINTS: Final = "@points"

_ROUNDING = 4.0 * 2.0**-52

FrequencyUnit = Literal["Omega", "omega"]


def forwards(stop: float, info: ValidationInfo) -> float:
    """Validate that the end of a range does not lie below its start."""
    if stop < info.data.get("start", stop):
        raise PydanticCustomError("reversed_grid", "stop lies below start")
    return stop


def extended(num: int, info: ValidationInfo) -> int:
    """Validate that a grid of several points has an extent."""
    start, stop = info.data.get("start"), info.data.get("stop")
    if num > 1 and start is not None and start == stop:
        raise PydanticCustomError("empty_grid", "start and stop coincide: num must be 1")
    return num


def steps(start: float, stop: float, step: float) -> int:
    """Return the number of values start, start + step, … up to stop."""
    # A stop that a whole number of steps should reach may be missed by rounding.
    size = max(abs(start), abs(stop))
    return int(min((stop - start + _ROUNDING * size) / step, LARGEST_INTEGER - 1.0)) + 1


def form(value: Any, points: type[Document]) -> str | None:
    """Return the tag of the form of a grid.

    Parameters
    ----------
    value
        A document, before or after validation.
    points : type
        Class of grids by number of points, the form where neither key is there.
    """
    if holds(value, "values"):
        return VALUES
    if holds(value, "step"):
        return STEPS
    return POINTS if isinstance(value, (dict, points)) else None


class Frequencies(Document):
    """Fields of all frequency grids."""

    unit: FrequencyUnit = Field(
        "Omega",
        description="Meaning of the numbers: Omega, the fundamental angular frequency of the "
        "motion, or omega = (2/pi) Omega, that of the triangle wave; rad per unit of time.",
        # Generators of clients that name values in capitals would give both the same name.
        json_schema_extra={"x-enum-varnames": ["FUNDAMENTAL", "TRIANGLE_WAVE"]},
    )


class FrequencyValues(Frequencies):
    """A list of frequencies, in any order."""

    values: Positives = Field(description="The frequencies.", min_length=1)

    @property
    def count(self) -> int:
        """Number of frequencies."""
        return len(self.values)


class FrequencyRange(Frequencies):
    """Fields of grids between two frequencies."""

    start: Positive = Field(description="First frequency.")
    stop: Positive = Field(description="Last frequency; not below start.")

    _forwards = field_validator("stop")(forwards)


class FrequencyInterval(FrequencyRange):
    """All frequencies between two."""

    @field_validator("stop")
    @classmethod
    def _extended(cls, stop: float, info: ValidationInfo) -> float:
        if stop == info.data.get("start"):
            raise PydanticCustomError("empty_grid", "start and stop coincide")
        return stop


class FrequencyPoints(FrequencyRange):
    """A number of equally spaced frequencies, both ends included."""

    num: Count = Field(description="Number of points.")

    @property
    def count(self) -> int:
        """Number of frequencies."""
        return self.num

    _extended = field_validator("num")(extended)


class FrequencySteps(FrequencyRange):
    """Frequencies start, start + step, … up to stop, which is included if a step reaches it."""

    step: Positive = Field(description="Distance between neighbours.")

    @property
    def count(self) -> int:
        """Number of frequencies."""
        return steps(self.start, self.stop, self.step)


def frequency_form(value: Any) -> str | None:
    """Return the tag of the form of a frequency grid."""
    return form(value, FrequencyPoints)


FrequencyGrid = Annotated[
    Annotated[FrequencyValues, Tag(VALUES)]
    | Annotated[FrequencyPoints, Tag(POINTS)]
    | Annotated[FrequencySteps, Tag(STEPS)],
    Discriminator(
        frequency_form,
        custom_error_type="frequency_form",
        custom_error_message="frequencies are an object with values, with start, stop and num, "
        "or with start, stop and step",
    ),
]


class TimeValues(Document):
    """A list of times, in any order."""

    values: Annotated[list[NonNegative], Field(min_length=1, fail_fast=True)] = Field(
        description="The times, not negative."
    )

    @property
    def count(self) -> int:
        """Number of times."""
        return len(self.values)


class TimePoints(Document):
    """A number of equally spaced times, both ends included."""

    start: NonNegative = Field(0.0, description="First time.")
    stop: Positive = Field(description="Last time; after start.")
    num: Annotated[Count, Field(ge=2)] = Field(description="Number of points.")

    @field_validator("stop")
    @classmethod
    def _forwards(cls, stop: float, info: ValidationInfo) -> float:
        if stop <= info.data.get("start", 0.0):
            raise PydanticCustomError("reversed_grid", "stop is not after start")
        return stop

    @property
    def count(self) -> int:
        """Number of times."""
        return self.num


def time_form(value: Any) -> str | None:
    """Return the tag of the form of a time grid."""
    if holds(value, "values"):
        return VALUES
    return POINTS if isinstance(value, (dict, TimePoints)) else None


TimeGrid = Annotated[
    Annotated[TimeValues, Tag(VALUES)] | Annotated[TimePoints, Tag(POINTS)],
    Discriminator(
        time_form,
        custom_error_type="time_form",
        custom_error_message="times are an object with values, or with start, stop and num",
    ),
]

TAGS: Final = frozenset({VALUES, STEPS, POINTS})
"""Parts of an error's path that name a branch of a union, not a place in the document."""
