"""What is sent beside the request of a computation: jobs, batches, and where messages go."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from vibroimpact_schema.values import Document

Priority = Annotated[int, Field(strict=True, ge=-10, le=10)]


class Webhook(Document):
    """A server to which a message is sent when a job ends, signed by Standard Webhooks."""

    url: Annotated[str, Field(max_length=2000, pattern="^https://[!-~]+$")] = Field(
        description="Address; https, and not in a private network.",
        examples=["https://example.org/hooks/vibroimpact"],
    )
    secret: Annotated[str, Field(pattern="^whsec_[A-Za-z0-9+/]{32,88}={0,2}$")] = Field(
        description="Signs the message: whsec_ and 24 to 64 bytes in base64.",
        examples=["whsec_" + "MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"],
    )


class BatchRequest(Document):
    """Many small computations of one kind, answered at once and not stored."""

    kind: Annotated[str, Field(max_length=40)] = Field(
        description="Kind of computation.", examples=["impact-modes"]
    )
    requests: list[dict[str, Any]] = Field(
        min_length=1, description="The requests, each as POST /v1/compute/{kind} takes it."
    )


class JobRequest(Document):
    """A computation to be done as a job."""

    kind: Annotated[str, Field(max_length=40)] = Field(
        description="Kind of computation.", examples=["impact-modes"]
    )
    request: dict[str, Any] = Field(description="The request, as POST /v1/compute/{kind} takes it.")
    name: Annotated[str, Field(max_length=120, pattern=r"^[^\x00-\x1f\x7f]*$")] | None = Field(
        None, description="What to call the job in lists.", examples=["tube, gap 0.2 mm"]
    )
    priority: Priority = Field(0, description="Higher runs first among the jobs of one owner.")
    deadline_seconds: Annotated[float, Field(strict=True, gt=0, le=3.2e7)] | None = Field(
        None, description="The job fails if it is not done this many seconds after the request."
    )
    webhook: Webhook | None = Field(None, description="Receives a message when the job ends.")
