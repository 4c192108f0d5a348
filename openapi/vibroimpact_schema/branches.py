"""Documents of branches: periodic motions along one number of their request."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field

from vibroimpact_schema.requests import PeriodicMotionsRequest
from vibroimpact_schema.systems import AnySystem, SystemReference
from vibroimpact_schema.values import Document, Number, Positive

SpecialPointType = Literal["fold", "flip", "torus", "symmetry", "grazing", "end"]


class BranchesRequest(Document):
    """Branches of periodic motions over a range of one number of their request.

    Begun at all solutions at both ends of the range and between them, and followed through folds
    by pseudo-arclength. Special points are located and listed.
    """

    base: PeriodicMotionsRequest = Field(
        description="The request whose number varies; it has one frequency."
    )
    path: Annotated[str, Field(pattern=r"^[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*$", max_length=200)] = (
        Field(
            description="Path of that number: names of fields, keys and indices from 0, separated "
            "by dots.",
            examples=["frequency.values.0", "load.0.amplitude", "system.constraints.0.gap"],
        )
    )
    start: Number = Field(description="One end of the range.")
    stop: Number = Field(description="The other end.")
    switch: Annotated[int, Field(strict=True, ge=0, le=100)] = Field(
        0,
        description="Branches to follow that begin at flips and losses of symmetry of admissible "
        "motions, in their order.",
    )
    stop_at: Annotated[list[SpecialPointType], Field(max_length=6)] = Field(
        [], description="Special points at which a branch ends; absent: none."
    )
    points: Annotated[int, Field(strict=True, ge=2, le=100_000)] = Field(
        2000, description="Most points of a branch."
    )
    step: Positive = Field(
        0.02,
        description="Longest step: part of the range, change of a phase (rad) or of an "
        "impulse relative to the usual one of the range.",
    )

    @property
    def system(self) -> AnySystem | SystemReference:
        """The structure of the base."""
        return self.base.system

    def with_system(self, system: AnySystem) -> Self:
        """Return the same request about another structure."""
        return self.model_copy(update={"base": self.base.with_system(system)})
