"""Documents of the laws of stops: what a stop gives to the coordinate that it limits."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from vibroimpact_schema.values import Document, NonNegative, Number


class RigidLaw(Document):
    """A rigid stop: Newton's impact law."""

    type: Literal["rigid"]
    restitution: Annotated[Number, Field(ge=0, le=1)] = Field(
        1.0, description="Newton's coefficient of restitution; 1 is elastic."
    )


class LinearLaw(Document):
    """A spring and a dashpot that only push: the force is max(0, k d + c d′).

    d is the indentation. Give either the damping, or the restitution of a free mass that is as
    large as the effective mass of the coordinate.
    """

    type: Literal["linear"]
    stiffness: NonNegative = Field(description="k, force by length.")
    damping: NonNegative | None = Field(None, description="c, force by velocity; absent: none.")
    restitution: Annotated[Number, Field(gt=0, le=1)] | None = Field(
        None, description="Ratio of the speeds after and before a contact, instead of the damping."
    )

    @model_validator(mode="after")
    def _one_damping(self) -> Self:
        if self.damping is not None and self.restitution is not None:
            raise PydanticCustomError(
                "two_dampings", "a linear stop has either a damping or a restitution, not both"
            )
        return self


class HertzLaw(Document):
    """An elastic contact of curved surfaces: the force is k d^(3/2).

    d is the indentation.
    """

    type: Literal["hertz"]
    stiffness: NonNegative = Field(description="k, force by length^(3/2).")


class PowerLaw(Document):
    """An elastic stop whose force grows with a power of the indentation d: it is k d^n."""

    type: Literal["power"]
    stiffness: NonNegative = Field(description="k, force by length^n.")
    exponent: Annotated[Number, Field(ge=1, le=64)] = Field(
        description="n; 1 is a spring, 1.5 the law of Hertz."
    )


def _tag(value: Any) -> str | None:
    """Return the tag of a law, raw or validated."""
    given = value.get("type") if isinstance(value, dict) else getattr(value, "type", None)
    # Anything may be given there, also what has no hash.
    return f"@{given}" if given in ("rigid", "linear", "hertz", "power") else None


Law = Annotated[
    Annotated[RigidLaw, Tag("@rigid")]
    | Annotated[LinearLaw, Tag("@linear")]
    | Annotated[HertzLaw, Tag("@hertz")]
    | Annotated[PowerLaw, Tag("@power")],
    Discriminator(
        _tag,
        custom_error_type="law_type",
        custom_error_message='a law is an object with the type "rigid", "linear", "hertz" '
        'or "power"',
    ),
]
