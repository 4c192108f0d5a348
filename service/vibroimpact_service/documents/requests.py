"""Requests for computations: checked, in canonical form, with the digest of their result."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

from vibroimpact_schema.submissions import JobRequest
from vibroimpact_schema.systems import SystemReference
from vibroimpact_service import kinds, problems
from vibroimpact_service.documents import digest, parse, stored_systems
from vibroimpact_service.jobs import webhooks
from vibroimpact_service.kinds import Kind
from vibroimpact_service.settings import Settings


@dataclass(frozen=True, slots=True)
class Request:
    """A checked request: a document of its kind's model, and its canonical form."""

    owner: str
    kind: Kind
    document: Any
    canonical: bytes
    digest: str
    """Name that its result has or will have."""


@dataclass(frozen=True, slots=True)
class JobOptions:
    """How a job is queued."""

    priority: int = 0
    deadline: float | None = None
    """Seconds in which it must be done."""
    webhook: tuple[str, str] | None = None
    """Address to which a message goes when the job ends, and the secret that signs it."""
    name: str | None = None
    """What its owner calls it."""

    def fingerprint(self, result: str) -> str:
        """Return what an idempotency key stands for: the result, and how its job is queued.

        Without options it is the result alone, as where the key is used at compute.
        """
        options = self.priority, self.deadline, self.webhook
        if options == (0, None, None):
            return result
        return digest.content(f"{result} {options!r}".encode())


def read(owner: str, kind: Kind, content: Any, *prefix: str) -> Request:
    """Return the checked request in some JSON content; `prefix` is the path to the content.

    Raises
    ------
    ProblemError
        422 with a pointer to each faulty field.
    """
    document: Any = parse.document(kind.request, content, *prefix)
    canonical = digest.canonical(document)
    if isinstance(document.system, SystemReference):
        stored_systems.check_owner(owner, document.system, *prefix, *kind.structure)
    name = digest.name(owner, kind.name, digest.solver_name(), canonical)
    return Request(owner, kind, document, canonical, name)


def read_job(owner: str, body: bytes, settings: Settings) -> tuple[Request, JobOptions]:
    """Return the request in the body of POST /v1/jobs, and how its job is queued.

    Raises
    ------
    ProblemError
        400 or 422; see `parse.json` and `read`.
    """
    job = parse.document(JobRequest, parse.json(body))
    kind = kinds.named(job.kind, "kind")
    options = JobOptions(job.priority, job.deadline_seconds, _webhook(job, settings), job.name)
    return read(owner, kind, job.request, "request"), options


def _webhook(job: JobRequest, settings: Settings) -> tuple[str, str] | None:
    if job.webhook is None:
        return None
    try:
        webhooks.check(job.webhook.url, private=settings.webhook_private)
    except webhooks.RefusedError as error:
        where = problems.pointer(("webhook", "url"))
        raise problems.invalid(where, "refused_address", str(error)) from None
    try:
        base64.b64decode(job.webhook.secret.removeprefix("whsec_"), validate=True)
    except ValueError:
        where = problems.pointer(("webhook", "secret"))
        raise problems.invalid(where, "wrong_format", "it is not base64") from None
    return job.webhook.url, job.webhook.secret


def stored_form(owner: str, canonical: bytes) -> bytes:
    """Return what is stored of a request for workers: whose it is, and its canonical form."""
    return digest.content(owner.encode()).encode() + b"\n" + canonical
