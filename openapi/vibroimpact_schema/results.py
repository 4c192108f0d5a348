"""The documents that results are, one per kind; arrays as nested lists."""

from __future__ import annotations

from typing import Literal

from pydantic import AwareDatetime, Field

from vibroimpact_schema.plans import Steps
from vibroimpact_schema.values import Digest, Document, Index

Curve = list[float]


class Provenance(Document):
    """Where a result comes from."""

    created: AwareDatetime = Field(description="When it was computed.")
    solver_version: str


class FrequencyAxis(Document):
    """The frequencies of a result, both ways."""

    Omega: Curve = Field(description="Fundamental angular frequency [frequency], 1/time.")
    omega: Curve = Field(description="Triangle-wave frequency (2/pi) Omega [frequency], 1/time.")


class Result(Document):
    """What all results share."""

    digest: Digest = Field(description="Name of the result.")
    plan: Steps
    provenance: Provenance


class ImpulseError(Document):
    """How far the numbers can be trusted."""

    impulse: list[float | None] = Field(
        description="Relative error of the impulses [frequency]; null: unknown."
    )
    statement: str = Field(description="How it was obtained.")


ImpactModeReason = Literal["ok", "negative_impulse", "wrong_velocity", "penetration", "singular"]


class ImpactModesResult(Result):
    """Members of a family of impact modes; outputs that were not asked for are absent."""

    kind: Literal["impact-modes"]
    frequency: FrequencyAxis
    constraint: list[Index] = Field(description="The active constraints [constraint].")
    dof: list[Index] | None = Field(None, description="The degrees of freedom [dof].")
    tau: Curve | None = Field(None, description="Triangle-wave times [tau].")
    impulse: list[Curve] | None = Field(
        None, description="Impulse parameter p [frequency, constraint], mass length / time²."
    )
    exists: list[bool] | None = Field(
        None, description="Whether the member is a real motion [frequency]."
    )
    reason: list[ImpactModeReason] | None = Field(
        None, description="Why the member is a phantom, or ok [frequency]."
    )
    shape: list[Curve] | None = Field(
        None, description="Displacement at tau = 1 [frequency, dof], length."
    )
    waveform: list[list[Curve]] | None = Field(
        None, description="Displacement [frequency, tau, dof], length."
    )
    energy: Curve | None = Field(
        None, description="Total energy [frequency], mass length² / time²."
    )
    error: ImpulseError
