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
    condition: list[float | None] = Field(
        description="Magnification of relative roundings in the impulses [frequency]; "
        "null: unbounded."
    )
    statement: str = Field(description="How the errors were obtained.")


ImpactModeReason = Literal["ok", "negative_impulse", "wrong_velocity", "penetration", "singular"]


class ImpactModesResult(Result):
    """Members of a family of impact modes; outputs that were not asked for are absent."""

    kind: Literal["impact-modes"]
    frequency: FrequencyAxis
    constraint: list[Index] = Field(description="The active constraints [constraint].")
    dof: list[Index] | None = Field(None, description="The degrees of freedom [dof].")
    tau: Curve | None = Field(None, description="Triangle-wave times [tau].")
    harmonic: list[Index] | None = Field(None, description="Multiples of Omega [harmonic].")
    impulse: list[Curve] | None = Field(
        None,
        description="Impulse parameter p at the upper walls [frequency, constraint], "
        "mass length / time²; 0 where a wall is not there.",
    )
    impulse_lower: list[Curve] | None = Field(
        None,
        description="The same at the lower walls; absent where both sides are alike.",
    )
    exists: list[bool] | None = Field(
        None, description="Whether the member is a real motion [frequency]."
    )
    reason: list[ImpactModeReason] | None = Field(
        None, description="Why the member is a phantom, or ok [frequency]."
    )
    certified: list[bool] | None = Field(
        None, description="Whether that is proved, apart from rounding [frequency]."
    )
    witness: list[float | None] | None = Field(
        None,
        description="Triangle-wave time at which a limit is passed; null: none [frequency].",
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
    stability: list[float | None] | None = Field(
        None,
        description="Spectral radius of the half-period map [frequency]; null where the order "
        "of simultaneous impacts decides, or the member does not exist.",
    )
    harmonics: list[list[Curve]] | None = Field(
        None,
        description="Fourier amplitudes [frequency, harmonic, dof], length: of sin(n Omega t) "
        "for odd and cos(n Omega t) for even multiples n.",
    )
    error: ImpulseError
