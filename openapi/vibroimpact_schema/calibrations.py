"""Documents of calibrations: numbers of a request from measurements of its outputs."""

from __future__ import annotations

from typing import Annotated, Any, Generic, Literal, Self, TypeVar

from pydantic import ConfigDict, Field, RootModel, field_validator

from vibroimpact_schema import requests
from vibroimpact_schema.requests import ComputationRequest
from vibroimpact_schema.sweeps import counted, undifferentiated
from vibroimpact_schema.systems import AnySystem, SystemReference
from vibroimpact_schema.values import Document, Number, Numbers, Positive, Positives

Base = TypeVar("Base", bound=ComputationRequest)

CalibrationOutput = Literal[
    "value", "covariance", "interval", "undetermined", "residual", "chi2", "model_fits"
]


class Prior(Document):
    """What is known of an unknown beforehand: a normal distribution."""

    mean: Number = Field(description="Its mean.")
    sigma: Positive = Field(description="Its standard deviation.")


class Unknown(Document):
    """An unknown number of the base."""

    path: Annotated[str, Field(pattern=r"^[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*$", max_length=200)] = (
        Field(
            description="Its path in the base, as sweeps name it; or system.M.scale, "
            "system.K.scale, system.C.scale: a factor of the whole matrix, 1 in the base.",
            examples=["system.constraints.0.gap", "system.K.scale"],
        )
    )
    start: Number = Field(description="Where the first search begins, in place of the base's.")
    lower: Number | None = Field(None, description="Smallest value; absent: none.")
    upper: Number | None = Field(None, description="Largest value; absent: none.")
    prior: Prior | None = Field(None, description="Absent: nothing is known beforehand.")


Row = Annotated[list[Number | None], Field(min_length=1, fail_fast=True)]


class MeasuredOutput(Document):
    """Measurements of one output of the base, with normal noise that is not correlated."""

    output: Annotated[str, Field(pattern=r"^[A-Za-z_0-9]+(\.[A-Za-z_0-9]+)*$", max_length=100)] = (
        Field(
            description="Its path in results, with dots: a numeric output that has derivatives, or "
            "an amplitude of periodic motions, solution.x_max, solution.x_min or solution.rms.",
            examples=["impacts.time", "x", "Omega", "solution.x_max"],
        )
    )
    values: (
        Row
        | Annotated[list[Row], Field(min_length=1, fail_fast=True)]
        | Annotated[list[list[Row]], Field(min_length=1, fail_fast=True)]
    ) = Field(
        description="Measured values in the shape of the output, null where nothing was measured. "
        "Of modes the lowest ones; of impacts all from 0 to t_end, in their order; of periodic "
        "motions a row for each frequency."
    )
    sigma: (
        Positive
        | Annotated[Positives, Field(min_length=1)]
        | Annotated[list[Positives], Field(min_length=1, fail_fast=True)]
    ) = Field(
        description="Standard deviation of the noise: one number, or one for each value, in the "
        "same shape."
    )
    t: Annotated[Numbers, Field(min_length=1)] | None = Field(
        None,
        description="Times of the rows of a history, ascending, in place of the base's t; absent: "
        "these.",
    )


class CalibrationOf(Document, Generic[Base]):
    """Fields of the calibrations of all kinds."""

    kind: str
    base: Base = Field(
        description="The request whose numbers are unknown; its outputs are those that are "
        "measured."
    )
    unknowns: Annotated[list[Unknown], Field(min_length=1, max_length=100)] = Field(
        description="The unknown numbers."
    )
    data: Annotated[list[MeasuredOutput], Field(min_length=1, max_length=100)] = Field(
        description="The measurements."
    )
    starts: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        8,
        description="Searches at most: the first from the starts of the unknowns, the others from "
        "points between the bounds, within two standard deviations of the prior or, where there is "
        "neither, within half the start. They end when two agree on a fit that the data permits.",
    )
    evaluations: Annotated[int, Field(strict=True, ge=1, le=100_000)] = Field(
        100, description="Most evaluations of the model in one search."
    )
    seed: Annotated[int, Field(strict=True, ge=0, le=2**53 - 1)] | None = Field(
        None, description="Of the points from which searches start; absent: made of the data."
    )
    outputs: Annotated[list[CalibrationOutput], Field(min_length=1, fail_fast=True)] = Field(
        ["value", "covariance", "interval", "undetermined", "residual", "chi2", "model_fits"],
        description="Outputs; only these are computed, the values always. "
        "value: the unknowns that fit best [unknown]; "
        "covariance: of the values [unknown, unknown]; "
        "interval: 95 % interval of each by profile of the likelihood [unknown, 2]; "
        "undetermined: combinations of unknowns that the data does not tell, and all principal "
        "directions; "
        "residual: measured less computed values, by their standard deviations; "
        "chi2: the sum of their squares, its degrees of freedom, and the probability of a larger "
        "one; "
        "model_fits: whether that is at least 0.05.",
    )

    @field_validator("base")
    @classmethod
    def _undifferentiated(cls, base: Base) -> Base:
        message = "calibrations differentiate by their unknowns: leave derivatives out"
        return undifferentiated(base, message)


class NaturalFrequenciesCalibration(CalibrationOf[requests.NaturalFrequenciesRequest]):
    """Numbers of a structure from its natural frequencies and mode shapes."""

    kind: Literal["natural-frequencies"]

    @field_validator("base")
    @classmethod
    def _counted(
        cls, base: requests.NaturalFrequenciesRequest
    ) -> requests.NaturalFrequenciesRequest:
        return counted(
            base,
            "a calibration takes count instead of stop: the number of modes below a frequency "
            "differs with the unknowns",
        )


class ImpactModesCalibration(CalibrationOf[requests.ImpactModesRequest]):
    """Numbers of a structure from its impact modes."""

    kind: Literal["impact-modes"]


class TimeHistoryCalibration(CalibrationOf[requests.TimeHistoryRequest]):
    """Numbers of a structure, its load and its start from a record of a motion."""

    kind: Literal["time-history"]


class PeriodicMotionsCalibration(CalibrationOf[requests.PeriodicMotionsRequest]):
    """Numbers of a driven structure from its amplitudes over the frequency of the drive.

    A measured amplitude is that of the stable, admissible motion that is nearest to it.
    """

    kind: Literal["periodic-motions"]


AnyCalibration = Annotated[
    NaturalFrequenciesCalibration
    | ImpactModesCalibration
    | TimeHistoryCalibration
    | PeriodicMotionsCalibration,
    Field(discriminator="kind"),
]


class CalibrationRequest(RootModel[AnyCalibration]):
    """Unknown numbers of a request from measurements of its outputs.

    The values of least squares, how far the data tells them, which it does not tell, and whether
    the model can be right.
    """

    model_config = ConfigDict(strict=True, frozen=True, hide_input_in_errors=True)

    @property
    def base(self) -> ComputationRequest:
        """The request whose numbers are unknown."""
        return self.root.base

    @property
    def system(self) -> AnySystem | SystemReference:
        """The structure of the base."""
        return self.root.base.system

    def with_system(self, system: AnySystem) -> Self:
        """Return the same request about another structure."""
        base: Any = self.root.base.with_system(system)
        return type(self)(self.root.model_copy(update={"base": base}))
