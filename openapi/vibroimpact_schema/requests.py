"""Documents that ask for a computation, one per kind, and the one that asks for a job."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from vibroimpact_schema.grids import FrequencyGrid
from vibroimpact_schema.systems import System
from vibroimpact_schema.values import Document, Indices, Number, Positive

Priority = Annotated[int, Field(strict=True, ge=-10, le=10)]


class ComputationRequest(Document):
    """What all computations take."""

    system: System
    tolerance: Positive | None = Field(
        None, description="Relative accuracy asked for; absent: what double precision gives."
    )


ImpactModesOutput = Literal[
    "impulse", "exists", "reason", "shape", "waveform", "energy", "harmonics"
]


class ImpactModesRequest(ComputationRequest):
    """Impact modes: periodic motions with one impact per half period at every active limiter.

    Each frequency has one member of the family, real or phantom.
    """

    frequency: FrequencyGrid
    active: Annotated[Indices, Field(min_length=1)] | None = Field(
        None, description="Indices of the constraints that are hit; absent: all."
    )
    dofs: Annotated[Indices, Field(min_length=1)] | None = Field(
        None, description="Degrees of freedom of shape and waveform; absent: all."
    )
    tau: (
        Annotated[list[Annotated[Number, Field(ge=-1, le=1)]], Field(min_length=1, fail_fast=True)]
        | None
    ) = Field(
        None,
        description="Triangle-wave times of the waveform, -1 to 1; needed where it is asked for.",
    )
    outputs: Annotated[list[ImpactModesOutput], Field(min_length=1, fail_fast=True)] = Field(
        ["impulse", "exists", "reason"],
        description="What to compute; what is not asked for is not computed. "
        "impulse: p [frequency, constraint] (mass length / time²); "
        "exists, reason: whether the member is a real motion, and if not why [frequency]; "
        "shape: x at tau = 1 [frequency, dof] (length); "
        "waveform: x at tau [frequency, tau, dof] (length); "
        "energy [frequency] (mass length² / time²); "
        "harmonics: Fourier amplitudes [frequency, harmonic, dof] (length).",
    )


class JobRequest(Document):
    """A computation to be queued."""

    kind: Annotated[str, Field(max_length=40)] = Field(
        description="Kind of computation.", examples=["impact-modes"]
    )
    request: dict[str, Any] = Field(description="The request, as POST /v1/compute/{kind} takes it.")
    priority: Priority = Field(0, description="Higher goes first among one's own jobs.")
