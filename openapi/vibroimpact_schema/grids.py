"""Documents of frequency and time grids."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, Final, Literal

from pydantic import (
    Discriminator,
    Field,
    GetPydanticSchema,
    Tag,
    ValidationInfo,
    field_validator,
)
from pydantic_core import PydanticCustomError, core_schema

from vibroimpact_schema.values import (
    LARGEST_INTEGER,
    Count,
    Document,
    NonNegative,
    Positive,
    Positives,
    form,
)

_ROUNDING = 4.0 * 2.0**-52

FrequencyUnit = Literal["Omega", "omega", "Hz", "rpm"]


def frequency_unit(description: str) -> Any:
    """Return the field of the unit of frequencies."""
    return Field(
        "Omega",
        description=description,
        # Generators of clients that name values in capitals would give two of them the same name.
        json_schema_extra={
            "x-enum-varnames": ["FUNDAMENTAL", "TRIANGLE_WAVE", "HERTZ", "REVOLUTIONS_PER_MINUTE"]
        },
    )


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


class Grid(Document):
    """What grids of frequencies, times and other numbers have in common."""

    @property
    def count(self) -> int:
        """Number of values; 0 of an interval."""
        if hasattr(self, "values"):
            return len(self.values)
        if hasattr(self, "num"):
            return int(self.num)
        if not hasattr(self, "step"):
            return 0
        start, stop, step = (getattr(self, name) for name in ("start", "stop", "step"))
        # A stop that a whole number of steps should reach may be missed by rounding.
        size = max(abs(start), abs(stop))
        reached = stop - start + math.copysign(_ROUNDING * size, step)
        return int(min(reached / step, LARGEST_INTEGER - 1.0)) + 1


def grid_form(value: Any) -> str | None:
    """Return the tag of the form of a grid of frequencies, or of an axis."""
    return form(value, {"values": "@values", "step": "@steps"}, "@points")


class Frequencies(Grid):
    """Fields of all frequency grids."""

    unit: FrequencyUnit = frequency_unit(
        "Meaning of the numbers: Omega, the fundamental angular frequency of the "
        "motion, or omega = (2/pi) Omega, that of the triangle wave; rad per unit of time. Hz and "
        "rpm: Omega / (2 pi) per second and per minute, of a system whose unit of time is ns, us, "
        "ms, s, min or h, or none, which stands for s."
    )


class FrequencyValues(Frequencies):
    """A list of frequencies, in any order."""

    values: Positives = Field(description="The frequencies.", min_length=1)


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

    _extended = field_validator("num")(extended)


class FrequencySteps(FrequencyRange):
    """Frequencies start, start + step, … up to stop, which is included if a step reaches it."""

    step: Positive = Field(description="Distance between neighbours.")


def _as_values(values: list[float]) -> FrequencyValues:
    """Return the document that a bare list stands for."""
    return FrequencyValues(values=values)


def _as_interval(ends: list[float]) -> FrequencyInterval:
    start, stop = ends
    if stop <= start:
        raise PydanticCustomError("reversed_grid", "stop is not above start")
    return FrequencyInterval(start=start, stop=stop)


def _from(given: Any, made: Callable[[Any], Any]) -> GetPydanticSchema:
    """Return what lets a field be given as another type, of which its value is made."""
    return GetPydanticSchema(
        lambda _, handler: core_schema.no_info_after_validator_function(
            made, handler.generate_schema(given)
        )
    )


_Listed = Annotated[Positives, Field(min_length=1, description="The frequencies Omega.")]
_Ends = Annotated[
    Positives, Field(min_length=2, max_length=2, description="Ends Omega: start and stop.")
]

FrequencyGrid = Annotated[
    Annotated[FrequencyValues, _from(_Listed, _as_values), Tag("@list")]
    | Annotated[FrequencyValues, Tag("@values")]
    | Annotated[FrequencyPoints, Tag("@points")]
    | Annotated[FrequencySteps, Tag("@steps")],
    Discriminator(
        lambda value: "@list" if isinstance(value, list) else grid_form(value),
        custom_error_type="frequency_form",
        custom_error_message="frequencies are a list, or an object with values, with start, stop "
        "and num, or with start, stop and step",
    ),
]
"""Frequencies; a list stands for the object with these values."""

FrequencyBand = Annotated[
    Annotated[FrequencyInterval, _from(_Ends, _as_interval), Tag("@list")]
    | Annotated[FrequencyInterval, Tag("@interval")],
    Discriminator(lambda value: "@list" if isinstance(value, list) else "@interval"),
]
"""All frequencies between two, also as a pair."""


class TimeValues(Grid):
    """A list of times, in any order."""

    values: Annotated[list[NonNegative], Field(min_length=1, fail_fast=True)] = Field(
        description="The times, not negative."
    )


class TimeRange(Grid):
    """Fields of grids between two times."""

    start: NonNegative = Field(0.0, description="First time.")
    stop: Positive = Field(description="Last time; after start.")

    @field_validator("stop")
    @classmethod
    def _forwards(cls, stop: float, info: ValidationInfo) -> float:
        if stop <= info.data.get("start", 0.0):
            raise PydanticCustomError("reversed_grid", "stop is not after start")
        return stop


class TimePoints(TimeRange):
    """A number of equally spaced times, both ends included."""

    num: Annotated[Count, Field(ge=2)] = Field(description="Number of points.")


class TimeSteps(TimeRange):
    """Times start, start + step, … up to stop, which is included if a step reaches it."""

    step: Positive = Field(description="Distance between neighbours.")


class EqualTimes(Grid):
    """A number of equally spaced times from 0 to t_end, both included."""

    num: Count = Field(description="Number of times.")


Instants = Annotated[
    list[NonNegative],
    Field(min_length=1, fail_fast=True, description="The times."),
]

_TIMES: Final = {"values": "@values", "step": "@steps"}
TimeGrid = Annotated[
    Annotated[Instants, Tag("@list")]
    | Annotated[TimeValues, Tag("@values")]
    | Annotated[TimePoints, Tag("@points")]
    | Annotated[TimeSteps, Tag("@steps")],
    Discriminator(
        lambda value: "@list" if isinstance(value, list) else form(value, _TIMES, "@points"),
        custom_error_type="time_form",
        custom_error_message="times are a list, or an object with values, with start, stop and "
        "num, or with start, stop and step",
    ),
]
"""Output times of a motion without a length of its own."""

_TIMES_UP_TO_END: Final = {**_TIMES, "stop": "@points"}
Times = Annotated[
    Annotated[Instants, Tag("@list")]
    | Annotated[EqualTimes, Tag("@equal")]
    | Annotated[TimeValues, Tag("@values")]
    | Annotated[TimePoints, Tag("@points")]
    | Annotated[TimeSteps, Tag("@steps")],
    Discriminator(
        lambda value: (
            "@list" if isinstance(value, list) else form(value, _TIMES_UP_TO_END, "@equal")
        ),
        custom_error_type="times_form",
        custom_error_message="times are a list, or an object with num, with values, with start, "
        "stop and num, or with start, stop and step",
    ),
]
"""Output times of a motion of a given length, ascending and up to its end."""
