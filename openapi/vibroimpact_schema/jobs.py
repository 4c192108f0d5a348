"""Documents about queued computations."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AwareDatetime, Field

from vibroimpact_schema.problems import Problem
from vibroimpact_schema.values import Digest, Document, Index, NonNegative

Reader = Annotated[str, Field(pattern=r"^([A-Za-z0-9][A-Za-z0-9._@-]{0,79}|\*)$")]
State = Literal["queued", "running", "succeeded", "failed", "cancelled"]


class Progress(Document):
    """Progress of a job; the unit depends on the kind."""

    done: Index
    total: Index
    kept: Index = Field(0, description="How many of those done were known before.")


class Attempt(Document):
    """An attempt at a job, or at a part of it."""

    worker: str = Field(
        description="Process that ran the job, or worker process that was lost while it computed "
        "a part of it."
    )
    began: AwareDatetime
    ended: AwareDatetime | None = Field(description="Null while it goes on.")
    why: str | None = Field(description="Why it ended.")


class Job(Document):
    """A queued computation."""

    id: str
    version: Index = Field(description="Number of the last change; also the id of its event.")
    kind: str = Field(examples=["impact-modes"])
    name: str | None = Field(None, description="What it was called when it was queued.")
    state: State
    final: bool = Field(description="Whether the state will not change any more.")
    phase: str = Field(description="Activity within the state.")
    waiting_reason: str | None = Field(description="Why it is not running yet.")
    queue_position: Index | None = Field(description="Number of jobs before it; null once it runs.")
    progress: Progress
    priority: int
    created: AwareDatetime
    started: AwareDatetime | None
    finished: AwareDatetime | None
    deadline: AwareDatetime | None = Field(
        None, description="Time at which it fails if it is not done."
    )
    attempts: Index = Field(description="Number of times it was started.")
    history: list[Attempt] | None = Field(
        None, description="The attempts at it, the earliest first; null in lists and events."
    )
    estimate: NonNegative | None = Field(description="Planned seconds of computing.")
    reused: bool = Field(description="Whether the result was known before.")
    digest: Digest = Field(description="Name that the result has or will have.")
    result: str | None = Field(description="Address of the result, once there is one.")
    error: Problem | None = Field(description="Why it failed.")


class RetryRequest(Document):
    """Failed jobs that are to be queued again: those that meet all conditions."""

    jobs: Annotated[list[str], Field(max_length=1000, fail_fast=True)] | None = Field(
        None, description="Ids of jobs; absent: all."
    )
    kind: str | None = Field(None, description="Kind of computation; absent: all.", max_length=40)


class Retried(Document):
    """Failed jobs that were queued again."""

    jobs: list[str] = Field(description="Their ids, the oldest first; at most 1000.")


class ShareRequest(Document):
    """Further users who may see a job and its result."""

    readers: Annotated[list[Reader], Field(min_length=1, max_length=100, fail_fast=True)] = Field(
        description="Owners of keys; * stands for all keys with permission to read.",
        examples=[["bob"]],
    )


class Share(Document):
    """Users who may see a job and its result."""

    job: str
    owner: str = Field(description="Owner of the job, by the name used among readers.")
    readers: list[str] = Field(description="Further users; empty: none.")


class JobList(Document):
    """A page of jobs, newest first; the header Link names the next page."""

    jobs: list[Job]
    next: str | None = Field(description="Cursor of the next page; null on the last one.")
