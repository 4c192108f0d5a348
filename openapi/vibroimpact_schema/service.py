"""Documents about the service itself."""

from __future__ import annotations

from pydantic import Field

from vibroimpact_schema.values import Count, Document, NonNegative


class Health(Document):
    """Whether the service is well."""

    status: str = Field(examples=["ok"])
    checks: dict[str, str] = Field(description="Part of the service -> ok, or what is wrong.")
    kernels: str | None = Field(
        None,
        description="Whether all compiled code is there: warm, warming (computations whose code "
        "is missing become jobs), or failed and for which kinds.",
        examples=["warm"],
    )


class ServiceLimits(Document):
    """What the service accepts."""

    body_bytes: Count
    header_bytes: Count = Field(description="Address and header fields together.")
    points: Count = Field(description="Points of a grid.")
    job_seconds: NonNegative = Field(description="Planned computing time of one request.")
    unfinished_jobs: Count = Field(description="Unfinished jobs of one owner.")
    requests_per_minute: Count | None = Field(
        description="Of a key that has no number of its own; null where no keys are needed."
    )
    seconds_per_hour: NonNegative | None = Field(
        description="Planned computing time of such a key; null where no keys are needed."
    )
    dofs: Count = Field(description="Degrees of freedom of a system.")
    result_bytes: Count = Field(description="Largest result, by the numbers it would hold.")
    inline_seconds: NonNegative = Field(description="Planned work above it becomes a job.")
    batch_requests: Count = Field(description="Most requests of one batch.")
    batch_seconds: NonNegative = Field(description="Most planned work of one of them.")
    wait_seconds: NonNegative = Field(description="Longest wait of Prefer: wait.")
    poll_seconds: NonNegative = Field(description="Longest wait of GET /v1/jobs/{id}?wait=.")


class Version(Document):
    """Version and capabilities of the service."""

    service: str
    solvers: str
    api: str
    kinds: list[str]
    representations: list[str] = Field(description="Media types of results.")
    codings: list[str] = Field(description="Content codings of answers.")
    system_types: list[str] = Field(description="Media types in which systems are taken.")
    capabilities: list[str] = Field(
        description="Further capabilities: keys, oidc, events, ranges, idempotency, …"
    )
    limits: ServiceLimits


class StoredSystem(Document):
    """A stored system."""

    id: str = Field(examples=["sys_" + "0" * 64])
    n: Count = Field(description="Degrees of freedom.")
    constraints: int = Field(ge=0, description="Number of constraints.")
    unused: list[str] = Field(
        default_factory=list,
        description="Names of what the files have and the system does not use, at most 100.",
    )
