"""/v1/jobs: retry, hold and release jobs."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Final

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_schema.jobs import Job, Retried, RetryRequest
from vibroimpact_service.api import answers, bodies, openapi
from vibroimpact_service.api.jobs import with_history
from vibroimpact_service.api.route import FAILURES, SUBMIT, owner, services
from vibroimpact_service.api.shared_results import JobId, own_job
from vibroimpact_service.documents import parse
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.tables import JobRow

router = APIRouter(tags=["jobs"], responses=FAILURES)

_MOST: Final = 1000
_RESPONSES: Final = {200: openapi.answer("The job.", Job), **openapi.READ_FAILURES}


@router.post(
    "/v1/retry",
    operation_id="retry_jobs",
    summary="Retry failed jobs",
    description="The caller's failed jobs that meet the conditions are queued again, at most "
    "1000; what they had computed is kept.",
    dependencies=[SUBMIT],
    responses={200: openapi.answer("The jobs.", Retried), **openapi.BODY_FAILURES},
    openapi_extra={
        "requestBody": openapi.json_body(
            "RetryRequest", {"kind": {"summary": "All sweeps", "value": {"kind": "sweep"}}}
        )
    },
)
async def retry_jobs(request: Request) -> Response:
    """Queue failed jobs again."""
    body = await bodies.read_json(request)
    wanted = parse.document(RetryRequest, parse.json(body))
    evaluation = services(request).evaluation
    room = await evaluation.room_for_jobs(owner(request))
    most = min(_MOST, room)
    jobs = await evaluation.queue.retry_all(owner(request), wanted.jobs, wanted.kind, most)
    return answers.document(Retried(jobs=list(jobs)))


@router.post(
    "/v1/jobs/{job}/retry",
    operation_id="retry_job",
    summary="Retry a failed job",
    description="It is queued again and keeps what it had computed. A job that did not fail does "
    "not change.",
    dependencies=[SUBMIT],
    responses=_RESPONSES,
)
async def retry_job(request: Request, job: JobId) -> Response:
    """Queue a failed job again."""
    await services(request).evaluation.room_for_jobs(owner(request))
    return await _changed(request, job, lambda queue: queue.retry)


@router.post(
    "/v1/jobs/{job}/hold",
    operation_id="hold_job",
    summary="Hold a job",
    description="It does not run until it is released; one that runs is stopped and keeps what it "
    "has computed. Its deadline stays. A final job does not change.",
    dependencies=[SUBMIT],
    responses=_RESPONSES,
)
async def hold_job(request: Request, job: JobId) -> Response:
    """Keep a job from running."""
    return await _changed(request, job, lambda queue: queue.hold)


@router.post(
    "/v1/jobs/{job}/release",
    operation_id="release_job",
    summary="Release a held job",
    description="A job that is not held does not change.",
    dependencies=[SUBMIT],
    responses=_RESPONSES,
)
async def release_job(request: Request, job: JobId) -> Response:
    """Let a held job run."""
    return await _changed(request, job, lambda queue: queue.release)


async def _changed(
    request: Request,
    job: str,
    operation: Callable[[JobQueue], Callable[[str, str], Awaitable[JobRow | None]]],
) -> Response:
    queue = services(request).evaluation.queue
    row = await own_job(request, job)
    changed = await operation(queue)(row.owner, job)
    assert changed is not None
    return answers.document(await with_history(queue, changed))
