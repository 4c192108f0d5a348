"""Documents of a motion: initial state, output times, loads and limiters."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, field_validator, model_validator
from pydantic_core import PydanticCustomError

from vibroimpact_schema.systems import Direction
from vibroimpact_schema.values import (
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
    """Initial states of many motions, at t = 0."""

    x: States = Field(description="Displacements [motion, dof].")
    v: States = Field(description="Velocities [motion, dof].")

    @field_validator("x", "v")
    @classmethod
    def _even(cls, rows: list[list[float]]) -> list[list[float]]:
        if any(len(row) != len(rows[0]) for row in rows):
            raise PydanticCustomError("wrong_length", "all motions need as many numbers")
        return rows

    @model_validator(mode="after")
    def _pairs(self) -> Self:
        if len(self.x) != len(self.v):
            raise PydanticCustomError("wrong_length", "x and v need as many motions")
        return self


def _states_form(value: Any) -> str | None:
    """Return the tag of the form of initial states."""
    if isinstance(value, list):
        return "@list"
    x = value.get("x") if isinstance(value, dict) else getattr(value, "x", None)
    one = isinstance(x, list) and bool(x) and not isinstance(x[0], list)
    return form(value, {"impact_mode": "@mode"}, "@state" if one else "@states")


Initials = Annotated[
    Annotated[InitialStates, Tag("@states")]
    | Annotated[InitialState, Tag("@state")]
    | Annotated[InitialMode, Tag("@mode")]
    | Annotated[list[Initial], Field(min_length=1, fail_fast=True), Tag("@list")],
    Discriminator(
        _states_form,
        custom_error_type="initial_form",
        custom_error_message="initial states are an object with x and v, of one motion or of "
        "many, or with impact_mode, or a list of such objects for one motion each",
    ),
]
"""Initial states of many motions."""


class HarmonicLoad(Document):
    """A load ``amplitude cos(frequency t + phase)`` on one degree of freedom."""

    dof: Index = Field(description="Degree of freedom on which it acts.")
    amplitude: Number = Field(description="Its amplitude, mass length / time².")
    frequency: NonNegative = Field(description="Its angular frequency.")
    phase: Number = Field(0.0, description="Its phase at t = 0.")


BaseQuantity = Literal["acceleration", "velocity", "displacement"]


class HarmonicBase(Document):
    """A base that moves by ``amplitude cos(frequency t + phase)``; all else is relative to it.

    The system has its influence.
    """

    base: BaseQuantity = Field(description="What of the base the amplitude is.")
    amplitude: Number = Field(description="Its amplitude: length, with velocity / time, ….")
    frequency: Positive = Field(description="Its angular frequency.")
    phase: Number = Field(0.0, description="Its phase at t = 0.")


class Samples(Document):
    """Times of samples, between which a load is a straight line."""

    t: Annotated[list[Number], Field(min_length=2, fail_fast=True)] | None = Field(
        None, description="Ascending times of the samples, from 0 or before to t_end or after."
    )
    interval: Positive | None = Field(
        None, description="In place of t: time between two samples, the first one at t = 0."
    )

    @model_validator(mode="after")
    def _timed(self) -> Self:
        if (self.t is None) == (self.interval is None):
            raise PydanticCustomError("t_or_interval", "give either t or interval")
        return self


Sampled = Annotated[list[Number], Field(min_length=2, fail_fast=True)]


class SampledLoad(Samples):
    """A load given by samples, measured say, a straight line from each to the next."""

    dof: Index | None = Field(None, description="Degree of freedom on which it acts.")
    direction: Direction | None = Field(
        None, description="In place of dof: it acts on several of them, by these weights."
    )
    force: Sampled = Field(description="Its values, mass length / time² [sample].")

    @model_validator(mode="after")
    def _placed(self) -> Self:
        if (self.dof is None) == (self.direction is None):
            raise PydanticCustomError("dof_or_direction", "give either dof or direction")
        return self


class BaseMotion(Samples):
    """A base that moves; displacements and velocities are relative to it."""

    base: Annotated[
        Annotated[list[Number], Field(min_length=1, fail_fast=True), Tag("@influence")]
        | Annotated[Literal["acceleration"], Tag("@word")],
        Discriminator(lambda value: "@word" if isinstance(value, str) else "@influence"),
    ] = Field(
        description="Displacements of the structure that a unit displacement of the base gives "
        "[dof]: 1 for those in its direction; or acceleration: those are the influence of the "
        "system.",
    )
    acceleration: Sampled = Field(
        description="Acceleration of the base, a straight line from each sample to the next "
        "[sample]."
    )


def _load_form(value: Any) -> str | None:
    """Return the tag of the form of a load of motions."""
    tag = form(value, {"force": "@sampled", "acceleration": "@base", "base": "@base"}, "@harmonic")
    if tag == "@base":
        moves = isinstance(value, HarmonicBase)
        if isinstance(value, dict):
            moves = isinstance(value.get("base"), str) and "acceleration" not in value
        return "@harmonic_base" if moves else tag
    return tag


MotionLoad = Annotated[
    Annotated[HarmonicLoad, Tag("@harmonic")]
    | Annotated[SampledLoad, Tag("@sampled")]
    | Annotated[BaseMotion, Tag("@base")]
    | Annotated[HarmonicBase, Tag("@harmonic_base")],
    Discriminator(
        _load_form,
        custom_error_type="load_form",
        custom_error_message="a load is an object with amplitude and frequency, with force, with "
        "base and acceleration, or with base, amplitude and frequency",
    ),
]


class DriveTerm(Document):
    """A load ``amplitude cos(harmonic Omega t + phase)``, Omega being the drive's frequency.

    Or a base that moves so, to which all else is then relative.
    """

    dof: Index | None = Field(None, description="Degree of freedom on which it acts.")
    direction: Direction | None = Field(
        None, description="In place of dof: it acts on several of them, by these weights."
    )
    base: BaseQuantity | None = Field(
        None,
        description="In place of dof: the base moves, by the influence of the system, and "
        "amplitude is that of its acceleration, velocity or displacement.",
    )
    amplitude: Number = Field(
        description="Its amplitude, mass length / time²; of a base, length / time² or so."
    )
    scale: Literal["Omega2"] | None = Field(
        None,
        description="Omega2: the amplitude is multiplied by the square of the drive's frequency, "
        "as that of an unbalance, whose amplitude is then mass times eccentricity.",
    )
    harmonic: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        1, description="Multiple of the drive's frequency."
    )
    phase: Number = Field(0.0, description="Its phase at t = 0.")

    @model_validator(mode="after")
    def _placed(self) -> Self:
        given = [each for each in (self.dof, self.direction, self.base) if each is not None]
        if len(given) != 1:
            raise PydanticCustomError("dof_or_direction", "give one of dof, direction and base")
        if self.base is not None and self.scale is not None:
            message = "the motion of a base has no scale: give its displacement instead"
            raise PydanticCustomError("base_or_scale", message)
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
    """Soft limiters: the force -stiffness (y / (scale gap))^exponent on each coordinate.

    It acts from y = 0 on; the law of a constraint acts from its gap on.
    """

    law: Literal["power"]
    exponent: Annotated[Number, Field(ge=1)] = Field(17.0, description="At least 1.")
    stiffness: Positive = Field(1.0, description="Force at scale times the gap.")
    scale: Positive = Field(1.0, description="Factor of the gaps.")


Limiter = Annotated[RigidLimiter | PowerLimiter, Field(discriminator="law")]
