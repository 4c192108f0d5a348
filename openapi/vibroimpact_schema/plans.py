"""Documents of plans: the steps of a computation before it is done, and what it skips."""

from __future__ import annotations

from pydantic import Field

from vibroimpact_schema.values import Count, Digest, Document, NonNegative


class PlanStep(Document):
    """A step of a computation."""

    stage: str = Field(description="Quantity that it computes.", examples=["spectrum"])
    method: str = Field(description="The method chosen.", examples=["closed form"])
    reason: str = Field(description="Why this method.")
    flops: NonNegative = Field(description="Estimated floating-point operations.")
    bytes: NonNegative = Field(description="Estimated memory written.")
    count: Count = Field(1, description="Number of times it is done in a sweep or an ensemble.")
    bounded: bool = Field(False, description="Whether flops and bytes are upper bounds.")


class PlanSkip(Document):
    """Something that is not computed."""

    what: str = Field(examples=["waveform"])
    why: str = Field(examples=["not asked"])


class Steps(Document):
    """The steps of a computation, and what it skips."""

    steps: list[PlanStep]
    skips: list[PlanSkip]
    flops: NonNegative = Field(description="Estimated floating-point operations of all steps.")
    bytes: NonNegative = Field(description="Estimated memory written by all steps.")
    bounded: bool = Field(
        False,
        description="Whether the price is an upper bound; false where it has none, as it goes with "
        "numbers, such as that of the impacts, which only the computation tells.",
    )


class Plan(Steps):
    """The answer of POST /v1/plan/{kind}."""

    kind: str = Field(examples=["impact-modes"])
    digest: Digest = Field(description="Name that the result has or will have.")
    seconds: NonNegative = Field(description="Estimated time on this machine.")
    cached: bool = Field(description="Whether the result is known.")
    inline: bool = Field(description="Whether POST /v1/compute would answer at once.")
