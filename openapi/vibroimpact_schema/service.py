"""Documents about the service itself."""

from __future__ import annotations

from pydantic import Field

from vibroimpact_schema.values import Count, Document, NonNegative


class Health(Document):
    """Whether the service is well."""

    status: str = Field(examples=["ok"])
    checks: dict[str, str] = Field(description="Part of the service -> ok, or what is amiss.")


class ServiceLimits(Document):
    """What the service accepts."""

    body_bytes: Count
    dofs: Count = Field(description="Degrees of freedom of a system.")
    result_bytes: Count = Field(description="Largest result, by the numbers it would hold.")
    inline_seconds: NonNegative = Field(description="Planned work above it becomes a job.")
    wait_seconds: NonNegative = Field(description="Longest wait of Prefer: wait.")
    poll_seconds: NonNegative = Field(description="Longest wait of GET /v1/jobs/{id}?wait=.")


class Version(Document):
    """What the service is and can."""

    service: str
    solvers: str
    api: str
    kinds: list[str]
    representations: list[str] = Field(description="Media types of results.")
    limits: ServiceLimits


class StoredSystem(Document):
    """A system that stands in the store."""

    id: str = Field(examples=["sys_" + "0" * 64])
    n: Count = Field(description="Degrees of freedom.")
    constraints: int = Field(ge=0, description="How many constraints it carries.")
