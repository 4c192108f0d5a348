"""What the documents of all results share, and the answers of batches.

The fields of each kind are declared in the result class of its solver; the service makes the
documents from these declarations.
"""

from __future__ import annotations

from typing import Any

from pydantic import AwareDatetime, Field

from vibroimpact_schema.plans import Steps
from vibroimpact_schema.problems import Problem
from vibroimpact_schema.values import Digest, Document


class Provenance(Document):
    """Origin of a result."""

    created: AwareDatetime = Field(description="When it was computed.")
    solver_version: str


class Result(Document):
    """Fields of all results."""

    digest: Digest = Field(description="Name of the result.")
    neglected: list[str] | None = Field(
        None,
        description="What of the structure has no effect on the result, a sentence each; absent "
        "where all of it has.",
    )
    cautions: list[str] | None = Field(
        None,
        description="What of the structure is permitted but seldom meant, a sentence each, such "
        "as an indefinite K; natural frequencies tell it. Absent where there is nothing of that "
        "kind.",
    )
    plan: Steps
    provenance: Provenance


class BatchAnswer(Document):
    """The answer to one request of a batch: its result, or the problem with it."""

    result: dict[str, Any] | None = Field(
        None, description="As POST /v1/compute/{kind} answers the request."
    )
    problem: Problem | None = Field(None, description="Why there is no result.")


class BatchAnswers(Document):
    """The answers to the requests of a batch, in their order."""

    answers: list[BatchAnswer]
