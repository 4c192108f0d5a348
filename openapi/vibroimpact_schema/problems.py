"""The document that every error is answered with (RFC 9457)."""

from __future__ import annotations

from pydantic import ConfigDict, Field

from vibroimpact_schema.values import Document


class Fault(Document):
    """One fault of a request."""

    pointer: str = Field(
        description="JSON pointer (RFC 6901) of the faulty place in the request's body; "
        "empty for the whole body and for faults outside of it.",
        examples=["/system/K"],
    )
    parameter: str | None = Field(
        None, description="Name of the faulty header or of the path or query parameter."
    )
    code: str = Field(description="Stable short name.", examples=["not_symmetric"])
    message: str = Field(description="What is wrong and what would be right.")


class Problem(Document):
    """Description of an error (RFC 9457)."""

    # RFC 9457 lets problems grow new fields, which old clients must ignore.
    model_config = ConfigDict(extra="ignore")

    type: str = Field(description="Address of the page about this type of problem.")
    title: str = Field(description="The type in words.")
    status: int = Field(description="The HTTP status.", ge=400, le=599)
    detail: str = Field(description="Description of this occurrence.")
    instance: str = Field(description="Name of this occurrence.")
    request_id: str = Field(description="As in the header X-Request-ID.")
    code: str = Field(description="Stable short name of the type.", examples=["invalid_request"])
    retryable: bool = Field(description="Whether the same request can succeed later.")
    errors: list[Fault] = Field(description="The faults, where they can be located.")
