"""Requests of slow flows."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from vibroimpact_schema.grids import TimeGrid
from vibroimpact_schema.requests import ComputationRequest
from vibroimpact_schema.values import Document, Index, Number, Positive

SlowFlowModel = Literal["damped", "two_oscillator", "restitution", "bouncing_ball", "oscillator"]
SlowFlowVariant = Literal[
    "exact",
    "transformed",
    "averaged",
    "truncated",
    "leading",
    "soft_wall",
    "corrected",
    "second_order",
    "printed",
    "high_energy",
    "high_energy_printed",
    "grazing",
    "grazing_printed",
    "nstt",
    "nsct",
    "family",
]
SlowFlowOutput = Literal["state", "x", "v", "impulse", "error"]


class SlowFlowInitial(Document):
    """Initial state of a slow flow, at t = 0; each model uses some of the fields."""

    gamma: Positive | None = Field(
        None,
        description="Frequency ratio Omega0/omega (lambda of eq. 10.110); damped, "
        "two_oscillator, restitution, oscillator.",
    )
    phi: Number | None = Field(
        None,
        description="Phase of the triangle wave, absent: 0; damped, two_oscillator, oscillator.",
    )
    A: Number | None = Field(
        None, description="Sine amplitude of the second mass, absent: 0; two_oscillator."
    )
    B: Number | None = Field(
        None, description="Cosine amplitude of the second mass, absent: 0; two_oscillator."
    )
    omega: Positive | None = Field(
        None, description="Triangle-wave frequency in place of gamma; restitution."
    )
    energy: Positive | None = Field(
        None, description="Total energy in place of gamma (eq. 10.10); oscillator."
    )
    root: Index | None = Field(
        None,
        description="Index of gamma among those of that energy, ascending, absent: 0; oscillator.",
    )
    x: Number | None = Field(
        None,
        description="Displacement, with v in place of omega: restitution; height of release: "
        "bouncing_ball.",
    )
    v: Number | None = Field(None, description="Velocity; restitution.")


class SlowFlowRequest(ComputationRequest):
    """Slow flow: a motion with impacts whose amplitude or frequency changes slowly.

    Each model has its system: `damped`: an oscillator with viscous damping
    between elastic walls; `two_oscillator`: the same with a second mass coupled to it;
    `restitution`: an oscillator between lossy walls; `bouncing_ball`: a mass under a constant
    load over a lossy floor; `oscillator`: an undamped one between elastic walls, or below one.
    """

    model: SlowFlowModel
    variant: SlowFlowVariant = Field(
        description="Description of the motion: exact, of every model; "
        "transformed, averaged, truncated, leading of damped; "
        "transformed, averaged, truncated, soft_wall of two_oscillator; "
        "corrected, second_order, printed, high_energy, grazing and the last two as printed, of "
        "restitution; nstt and nsct of bouncing_ball; family of oscillator."
    )
    initial: SlowFlowInitial
    t: TimeGrid
    outputs: Annotated[list[SlowFlowOutput], Field(min_length=1, fail_fast=True)] = Field(
        ["state", "x", "v", "error"],
        description="Outputs; only these are computed. "
        "state: gamma, omega, phi, A, B as far as the model has them [time]; "
        "x, v: displacement and velocity [time, dof] (length, length / time); "
        "impulse: the impulse parameter p (mass length / time²) and the momentum exchanged at an "
        "impact, 2 p/omega (mass length / time) [time]; "
        "error: differences from the exact motion, and its impacts.",
    )
