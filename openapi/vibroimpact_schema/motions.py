"""Documents of a motion: initial state, output times, loads and limiters."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, Tag, field_validator, model_validator
from pydantic_core import PydanticCustomError

from vibroimpact_schema.systems import Direction
from vibroimpact_schema.values import (
    Count,
    Document,
    Index,
    Indices,
    NonNegative,
    Number,
    Numbers,
    Positive,
    form,
)


class InitialState(Document):
    """Displacements and velocities at t = 0."""

    x: Numbers = Field(description="Displacements [dof], within all limits.", min_length=1)
    v: Numbers = Field(description="Velocities [dof].", min_length=1)


class Member(Document):
    """One impact mode of a family."""

    Omega: Positive = Field(description="Its fundamental angular frequency.")
    active: Annotated[Indices, Field(min_length=1)] | None = Field(
        None, description="Indices of the constraints at which it has impacts; absent: all."
    )


class InitialMode(Document):
    """An impact mode at tau = 0, half-way between its impacts."""

    impact_mode: Member


Initial = Annotated[
    Annotated[InitialState, Tag("@state")] | Annotated[InitialMode, Tag("@mode")],
    Discriminator(
        lambda value: form(value, {"impact_mode": "@mode"}, "@state"),
        custom_error_type="initial_form",
        custom_error_message="an initial state is an object with x and v, or with impact_mode",
    ),
]


States = Annotated[
    list[Annotated[Numbers, Field(min_length=1)]], Field(min_length=1, fail_fast=True)
]


class InitialStates(Document):
    """Initial states of the members of an ensemble, at t = 0."""

    x: States = Field(description="Displacements [member, dof].")
    v: States = Field(description="Velocities [member, dof].")

    @field_validator("x", "v")
    @classmethod
    def _even(cls, rows: list[list[float]]) -> list[list[float]]:
        if any(len(row) != len(rows[0]) for row in rows):
            raise PydanticCustomError("wrong_length", "all members need as many numbers")
        return rows

    @model_validator(mode="after")
    def _pairs(self) -> Self:
        if len(self.x) != len(self.v):
            raise PydanticCustomError("wrong_length", "x and v need as many members")
        return self


class EqualTimes(Document):
    """A number of equally spaced times from 0 to t_end, both included."""

    num: Count = Field(description="Number of times.")


Instants = Annotated[
    list[NonNegative],
    Field(min_length=1, fail_fast=True, description="Ascending times, up to t_end."),
]


Times = Annotated[
    Annotated[EqualTimes, Tag("@equal")] | Annotated[Instants, Tag("@times")],
    Discriminator(
        lambda value: "@times" if isinstance(value, list) else form(value, {}, "@equal"),
        custom_error_type="times_form",
        custom_error_message="times are an object with num, or a list of them",
    ),
]


class HarmonicLoad(Document):
    """A load ``amplitude cos(frequency t + phase)`` on one degree of freedom."""

    dof: Index = Field(description="Degree of freedom on which it acts.")
    amplitude: Number = Field(description="Its amplitude, mass length / time².")
    frequency: NonNegative = Field(description="Its angular frequency.")
    phase: Number = Field(0.0, description="Its phase at t = 0.")


class DriveTerm(Document):
    """A load ``amplitude cos(harmonic Omega t + phase)``, Omega being the drive's frequency."""

    dof: Index | None = Field(None, description="Degree of freedom on which it acts.")
    direction: Direction | None = Field(
        None, description="In place of dof: it acts on several of them, by these weights."
    )
    amplitude: Number = Field(description="Its amplitude, mass length / time².")
    harmonic: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        1, description="Multiple of the drive's frequency."
    )
    phase: Number = Field(0.0, description="Its phase at t = 0.")

    @model_validator(mode="after")
    def _placed(self) -> Self:
        if (self.dof is None) == (self.direction is None):
            raise PydanticCustomError("dof_or_direction", "give either dof or direction")
        return self


class SequenceImpact(Document):
    """One impact of a sequence."""

    constraint: Index = Field(description="Index of the constraint.")
    side: Literal["upper", "lower"] = Field("upper", description="The wall that is struck.")


Sequence = Annotated[
    Annotated[
        list[SequenceImpact], Field(min_length=1, max_length=32, fail_fast=True), Tag("@impacts")
    ]
    | Annotated[Literal["symmetric"], Tag("@symmetric")],
    Discriminator(
        lambda value: "@symmetric" if isinstance(value, str) else "@impacts",
        custom_error_type="sequence_form",
        custom_error_message="a sequence is a list of impacts, or symmetric",
    ),
]


class SequenceStart(Document):
    """Where the search for a sequence of several impacts begins."""

    phases: Annotated[
        list[Annotated[Numbers, Field(min_length=1)]],
        Field(min_length=1, max_length=1000, fail_fast=True),
    ] = Field(description="Phases Omega t of the impacts in their order [guess, impact], rad.")


class RigidLimiter(Document):
    """Rigid limiters: impacts with the coefficients of restitution of the constraints."""

    law: Literal["rigid"]


class PowerLimiter(Document):
    """Soft limiters: the force -stiffness (y / (scale gap))^exponent on each coordinate."""

    law: Literal["power"]
    exponent: Annotated[Number, Field(ge=1)] = Field(17.0, description="At least 1.")
    stiffness: Positive = Field(1.0, description="Force at scale times the gap.")
    scale: Positive = Field(1.0, description="Factor of the gaps.")


Limiter = Annotated[RigidLimiter | PowerLimiter, Field(discriminator="law")]
