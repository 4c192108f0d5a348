"""Documents of sweeps: a computation over a grid of values of some of its fields."""

from __future__ import annotations

import math
from typing import Annotated, Any, Final, Generic, Literal, LiteralString, Self, TypeVar

from pydantic import (
    ConfigDict,
    Discriminator,
    Field,
    RootModel,
    Tag,
    ValidationInfo,
    field_validator,
)
from pydantic_core import PydanticCustomError

from vibroimpact_schema import grids, requests, slow_flows
from vibroimpact_schema.requests import ComputationRequest
from vibroimpact_schema.results import Result
from vibroimpact_schema.systems import AnySystem, SystemReference
from vibroimpact_schema.values import Count, Document, Number

Base = TypeVar("Base", bound=ComputationRequest)
Output = TypeVar("Output", bound=str)


class Axis(grids.Grid):
    """Fields of all axes."""

    path: Annotated[str, Field(pattern=r"^[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*$", max_length=200)] = (
        Field(
            description="Path of the number of the base request that varies: names of fields, "
            "keys and indices from 0, separated by dots. With an entry of a matrix the symmetric "
            "entry varies too.",
            examples=["system.constraints.0.gap", "system.K.0.1"],
        )
    )
    name: Annotated[str, Field(pattern="^[A-Za-z][A-Za-z0-9_]{0,39}$")] | None = Field(
        None,
        description="Name of the dimension; absent: the shortest end of the path that "
        "distinguishes the axis from the others.",
        examples=["gap"],
    )


class AxisValues(Axis):
    """A list of values, in any order."""

    values: Annotated[list[Number], Field(min_length=1, fail_fast=True)]


class AxisRange(Axis):
    """Fields of axes between two values, which may descend."""

    start: Number = Field(description="First value.")
    stop: Number = Field(description="Last value; below start, the values descend.")


class AxisPoints(AxisRange):
    """A number of equally spaced values, both ends included."""

    num: Count = Field(description="Number of values.")

    _extended = field_validator("num")(grids.extended)


class AxisSteps(AxisRange):
    """Values start, start + step, … to stop, which is included if a step reaches it.

    They are computed in decimal arithmetic and rounded once, so that a longer or a shifted axis
    with the same step has the same numbers, whose results are reused.
    """

    step: Number = Field(
        description="Difference of neighbours, not 0; negative where stop lies below start.",
    )

    @field_validator("step")
    @classmethod
    def _towards(cls, step: float, info: ValidationInfo) -> float:
        start, stop = info.data.get("start"), info.data.get("stop")
        if step == 0.0:
            raise PydanticCustomError("step_zero", "must not be 0")
        if start is not None and stop is not None and (stop - start) * step < 0.0:
            sides = ("below", "negative") if stop < start else ("above", "positive")
            message = "stop lies {side} start: the step must be {sign}"
            raise PydanticCustomError(
                "reversed_grid", message, {"side": sides[0], "sign": sides[1]}
            )
        return step


AnyAxis = AxisValues | AxisPoints | AxisSteps
AxisDocument = Annotated[
    Annotated[AxisValues, Tag("@values")]
    | Annotated[AxisPoints, Tag("@points")]
    | Annotated[AxisSteps, Tag("@steps")],
    Discriminator(
        grids.grid_form,
        custom_error_type="axis_form",
        custom_error_message="an axis is an object with path and values, with path, start, stop "
        "and num, or with path, start, stop and step",
    ),
]


CONTINUED: Final = ("attractors", "time-history")
"""Kinds whose sweeps may start each point where the last ended."""


def undifferentiated(base: Base, message: LiteralString) -> Base:
    """Refuse a base that asks for derivatives itself."""
    if getattr(base, "derivatives", None) is not None:
        raise PydanticCustomError("no_derivatives", message)
    return base


def counted(
    base: requests.NaturalFrequenciesRequest, message: LiteralString
) -> requests.NaturalFrequenciesRequest:
    """Refuse a base whose number of modes differs from one point to the other."""
    if base.stop is not None:
        raise PydanticCustomError("count_or_stop", message)
    return base


class SweepOf(Document, Generic[Base, Output]):
    """Fields of the sweeps of all kinds."""

    model_config = ConfigDict(serialize_by_alias=True)

    kind: str
    base: Base = Field(description="The request whose fields vary.")
    axes: Annotated[list[AxisDocument], Field(min_length=1, max_length=8)] = Field(
        description="Each is a dimension of the outputs; in this order, they come first."
    )
    outputs: Annotated[list[Output], Field(min_length=1, fail_fast=True)] | None = Field(
        None, description="What to compute; absent: the outputs of the base."
    )

    continue_: bool | None = Field(
        None,
        alias="continue",
        description="Whether each point starts where the last ended, along the first axis, as in a "
        "test on a shaker: of attractors and time-history. The base's initial state is that of the "
        "first point; in time histories the phases of harmonic loads run on. Absent: each point is "
        "what it is alone.",
    )

    @field_validator("continue_")
    @classmethod
    def _possible(cls, value: bool | None, info: ValidationInfo) -> bool | None:
        kind = info.data.get("kind", "")
        if value and kind not in CONTINUED:
            message = "only sweeps of {kinds} start points where the last ended, not of {kind}"
            details = {"kinds": " and ".join(CONTINUED), "kind": kind}
            raise PydanticCustomError("not_continued", message, details)
        return value or None

    @field_validator("base")
    @classmethod
    def _undifferentiated(cls, base: Base) -> Base:
        message = "sweeps have no derivatives: ask for them at single points"
        return undifferentiated(base, message)


class NaturalFrequenciesSweep(
    SweepOf[requests.NaturalFrequenciesRequest, requests.NaturalFrequenciesOutput]
):
    """Natural frequencies over a parameter grid: the same number of modes at every point."""

    kind: Literal["natural-frequencies"]

    @field_validator("base")
    @classmethod
    def _counted(
        cls, base: requests.NaturalFrequenciesRequest
    ) -> requests.NaturalFrequenciesRequest:
        return counted(
            base,
            "a sweep takes count instead of stop: the number of modes below a frequency differs "
            "from point to point",
        )


class ImpactModesSweep(SweepOf[requests.ImpactModesRequest, requests.ImpactModesOutput]):
    """Impact modes over a parameter grid."""

    kind: Literal["impact-modes"]


class ExistenceBandsSweep(SweepOf[requests.ExistenceBandsRequest, requests.ExistenceBandsOutput]):
    """Existence bands over a parameter grid."""

    kind: Literal["existence-bands"]


class ResonancesSweep(SweepOf[requests.ResonancesRequest, requests.ResonancesOutput]):
    """Internal resonances over a parameter grid."""

    kind: Literal["resonances"]


class PeriodicMotionsSweep(
    SweepOf[requests.PeriodicMotionsRequest, requests.PeriodicMotionsOutput]
):
    """Periodic motions over a parameter grid; impacts refer to the solutions of their point."""

    kind: Literal["periodic-motions"]


class AttractorsSweep(SweepOf[requests.AttractorsRequest, requests.AttractorsOutput]):
    """Attractors over a parameter grid: over one axis, a bifurcation diagram."""

    kind: Literal["attractors"]


class TimeHistorySweep(SweepOf[requests.TimeHistoryRequest, requests.TimeHistoryOutput]):
    """Time histories over a parameter grid."""

    kind: Literal["time-history"]


class SlowFlowSweep(SweepOf[slow_flows.SlowFlowRequest, slow_flows.SlowFlowOutput]):
    """Slow flows over a parameter grid."""

    kind: Literal["slow-flow"]


AnySweep = Annotated[
    NaturalFrequenciesSweep
    | ImpactModesSweep
    | ExistenceBandsSweep
    | ResonancesSweep
    | PeriodicMotionsSweep
    | AttractorsSweep
    | TimeHistorySweep
    | SlowFlowSweep,
    Field(discriminator="kind"),
]


class SweepRequest(RootModel[AnySweep]):
    """A computation at every point of the parameter grid that its axes span.

    What does not depend on an axis is computed once for all its values.
    """

    model_config = ConfigDict(strict=True, frozen=True, hide_input_in_errors=True)

    @property
    def base(self) -> ComputationRequest:
        """The request whose fields vary, with the outputs to be computed."""
        outputs = self.root.outputs
        return self.root.base if outputs is None else self._based(outputs=outputs)

    @property
    def system(self) -> AnySystem | SystemReference:
        """The structure of the base."""
        return self.root.base.system

    @property
    def points(self) -> int:
        """Number of points of the parameter grid."""
        return math.prod(axis.count for axis in self.root.axes)

    def with_system(self, system: AnySystem) -> Self:
        """Return the same request about another structure."""
        return type(self)(self.root.model_copy(update={"base": self._based(system=system)}))

    def _based(self, **fields: Any) -> ComputationRequest:
        return self.root.base.model_copy(update=fields)


class SweepResult(Result):
    """The outputs of the base over the parameter grid: the axes first, then their own dimensions.

    Outputs have the names of the results of the base's kind. Tables whose length differs from
    point to point are concatenated in the order of the points, the last axis fastest;
    ``<table>_count`` and ``<table>_offset`` are the number of rows of each point and the index
    of the first.
    """

    model_config = ConfigDict(extra="allow")

    kind: Literal["sweep"]
    axes: dict[str, list[float]] = Field(description="Values of each axis, in their order.")
    of: str = Field(description="Kind of the base.", examples=["impact-modes"])
    dimensions: dict[str, list[str]] = Field(description="Names of the dimensions of every output.")
    status: Any = Field(
        description="Whether there is a result at each point: ok, or why not; nested lists [axes]."
    )
    error: dict[str, Any] | None = None
