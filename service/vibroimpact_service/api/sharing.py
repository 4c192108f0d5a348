"""/v1/jobs/{job}/share: whom else an owner lets see a job; and what others let a caller see."""

from __future__ import annotations

import re

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_schema.jobs import Share, ShareRequest
from vibroimpact_service import digest, intake, problems
from vibroimpact_service.access import shares
from vibroimpact_service.access.gate import Gate
from vibroimpact_service.api import contract, exchange, guard
from vibroimpact_service.api.guard import Guarded
from vibroimpact_service.jobs.records import JobRow
from vibroimpact_service.problems import ProblemError

router = APIRouter(tags=["jobs"], route_class=Guarded)

_JOB = re.compile(r"job_[0-9a-f]{32}")


async def job(request: Request, name: str) -> JobRow:
    """Return a job that the caller owns or was let see.

    Raises
    ------
    ProblemError
        404 where there is no such job, for the caller.
    """
    queue, caller = exchange.evaluation(request).queue, exchange.owner(request)
    row = await queue.get(caller, name) if _JOB.fullmatch(name) else None
    gate: Gate = request.app.state.gate
    if row is None and gate.closed and _JOB.fullmatch(name):
        owner = await gate.read(shares.owner_of(name, caller))
        row = None if owner is None else await queue.get(owner, name)
    if row is None:
        raise ProblemError(problems.NOT_FOUND, "There is no such job.")
    return row


async def own_job(request: Request, name: str) -> JobRow:
    """Return a job of the caller's.

    Raises
    ------
    ProblemError
        404 where there is none; 403 where the caller may only see it.
    """
    row = await job(request, name)
    if row.owner != exchange.owner(request):
        raise ProblemError(problems.FORBIDDEN, "Only the owner of the job may do this.")
    return row


async def still_shown(request: Request, row: JobRow) -> bool:
    """Whether the caller may go on to see a job; its owner always may."""
    caller = exchange.owner(request)
    if row.owner == caller:
        return True
    gate: Gate = request.app.state.gate
    return await gate.read(shares.owner_of(row.id, caller)) == row.owner


async def shows_result(request: Request, name: str) -> bool:
    """Whether the caller owns a result or was let see it."""
    caller = exchange.owner(request)
    if digest.owned(caller, name):
        return True
    gate: Gate = request.app.state.gate
    return gate.closed and await gate.read(shares.shows(name, caller))


@router.get("/v1/jobs/{job}/share", **contract.share())
async def shown(request: Request, job: str) -> Response:
    """Say who else may see a job."""
    row = await own_job(request, job)
    return await _document(request, row)


@router.put("/v1/jobs/{job}/share", **contract.set_share())
async def shared(request: Request, job: str) -> Response:
    """Let others see a job and its result."""
    body = await exchange.read_json(request)
    asked = intake.document(ShareRequest, intake.parse(body))
    return await _set(request, job, asked.readers)


@router.delete("/v1/jobs/{job}/share", **contract.end_share())
async def ended(request: Request, job: str) -> Response:
    """Let nobody else see a job any more."""
    return await _set(request, job, [])


async def _set(request: Request, name: str, readers: list[str]) -> Response:
    row = await own_job(request, name)
    caller, gate = guard.caller(request), request.app.state.gate
    others = set(readers) - {row.owner}
    await gate.write(shares.share(caller.name, row.owner, row.id, row.result, others))
    return await _document(request, row)


async def _document(request: Request, row: JobRow) -> Response:
    gate: Gate = request.app.state.gate
    readers = await gate.read(shares.readers_of(row.owner, row.id))
    return exchange.document(Share(job=row.id, owner=row.owner, readers=readers))
