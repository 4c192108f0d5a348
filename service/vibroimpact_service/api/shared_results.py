"""/v1/jobs/{job}/share, and which jobs and results a caller may see."""

from __future__ import annotations

import re
from typing import Annotated

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_schema.jobs import Share, ShareRequest
from vibroimpact_service import problems
from vibroimpact_service.access import shared_results
from vibroimpact_service.api import answers, bodies, openapi
from vibroimpact_service.api.route import FAILURES, READ, SUBMIT, caller, owner, services
from vibroimpact_service.documents import digest, parse
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.problems import ProblemError

router = APIRouter(tags=["jobs"], responses=FAILURES)

_JOB = re.compile(r"job_[0-9a-f]{32}")
JobId = Annotated[str, openapi.path_id("Id of a job.", "job_" + "0" * 32, _JOB)]


async def visible_job(request: Request, name: str) -> JobRow:
    """Return a job that the caller owns or that is shared with the caller.

    Raises
    ------
    ProblemError
        404 where the caller may see no such job.
    """
    parts, reader = services(request), owner(request)
    if _JOB.fullmatch(name):
        row = await parts.evaluation.queue.get(reader, name)
        if row is None and parts.authenticator.keys_required:
            sharer = await parts.authenticator.records.read(shared_results.owner_of, name, reader)
            row = None if sharer is None else await parts.evaluation.queue.get(sharer, name)
        if row is not None:
            return row
    raise ProblemError(problems.NOT_FOUND, "There is no such job.")


async def own_job(request: Request, name: str) -> JobRow:
    """Return a job of the caller's.

    Raises
    ------
    ProblemError
        404 where there is none; 403 where the caller may only see it.
    """
    row = await visible_job(request, name)
    if row.owner != owner(request):
        raise ProblemError(problems.FORBIDDEN, "Only the owner of the job may do this.")
    return row


async def still_visible(request: Request, row: JobRow) -> bool:
    """Whether the caller may still see a job; its owner always may."""
    reader = owner(request)
    if row.owner == reader:
        return True
    access = services(request).authenticator.records
    return await access.read(shared_results.owner_of, row.id, reader) == row.owner


async def result_is_visible(request: Request, name: str) -> bool:
    """Whether the caller owns a result or a job with it is shared with the caller."""
    reader = owner(request)
    if digest.owned(reader, name):
        return True
    authenticator = services(request).authenticator
    if not authenticator.keys_required:
        return False
    return await authenticator.records.read(shared_results.shows, name, reader)


@router.get(
    "/v1/jobs/{job}/share",
    operation_id="get_share",
    summary="Readers of a job",
    dependencies=[READ],
    responses={
        200: openapi.answer("Its readers.", Share),
        **openapi.READ_FAILURES,
    },
)
async def get_share(request: Request, job: JobId) -> Response:
    """Those with whom its owner shares the job. Only the owner may ask."""
    return await _document(request, await own_job(request, job))


@router.put(
    "/v1/jobs/{job}/share",
    operation_id="share_job",
    summary="Share a job",
    description="From now on exactly these readers may read the job, follow it and fetch its "
    "result; only its owner may cancel or share it. Recorded in the audit log.",
    dependencies=[SUBMIT],
    responses={
        200: openapi.answer("Its readers.", Share),
        **openapi.BODY_FAILURES,
        **openapi.failures(404),
    },
    openapi_extra={
        "requestBody": openapi.json_body(
            "ShareRequest", {"bob": {"summary": "A colleague", "value": {"readers": ["carol"]}}}
        )
    },
)
async def share_job(request: Request, job: JobId) -> Response:
    """Share a job and its result."""
    body = await bodies.read_json(request)
    share = parse.document(ShareRequest, parse.json(body))
    return await _set(request, job, share.readers)


@router.delete(
    "/v1/jobs/{job}/share",
    operation_id="unshare_job",
    summary="Stop sharing a job",
    dependencies=[SUBMIT],
    responses={
        200: openapi.answer("Its readers: none.", Share),
        **openapi.READ_FAILURES,
    },
)
async def unshare_job(request: Request, job: JobId) -> Response:
    """From now on only its owner may see it."""
    return await _set(request, job, [])


async def _set(request: Request, name: str, readers: list[str]) -> Response:
    row = await own_job(request, name)
    actor, others = caller(request).name, set(readers) - {row.owner}
    access = services(request).authenticator.records
    await access.write(shared_results.share, actor, row.owner, row.id, row.result, others)
    return await _document(request, row)


async def _document(request: Request, row: JobRow) -> Response:
    access = services(request).authenticator.records
    readers = await access.read(shared_results.readers_of, row.owner, row.id)
    return answers.document(Share(job=row.id, owner=row.owner, readers=readers))
