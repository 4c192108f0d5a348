"""/v1/keys and /v1/audit: what administrators do, and what they did."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_schema.keys import Act, ActList, ApiKey, KeyList, KeyRequest, MadeKey
from vibroimpact_service import intake, problems
from vibroimpact_service.access import records
from vibroimpact_service.access.caller import Allowance, Scope
from vibroimpact_service.access.gate import Gate
from vibroimpact_service.api import contract, exchange, guard
from vibroimpact_service.api.guard import Guarded
from vibroimpact_service.problems import ProblemError

router = APIRouter(tags=["administration"], route_class=Guarded)

_KEY = re.compile(r"[0-9a-f]{12}")


def _gate(request: Request) -> Gate:
    found: Gate = request.app.state.gate
    return found


@router.get("/v1/keys", **contract.key_list())
async def listed(request: Request) -> Response:
    """List all keys."""
    rows = await _gate(request).read(records.listed)
    return exchange.document(KeyList(keys=[_document(row) for row in rows]))


@router.post("/v1/keys", **contract.make_key())
async def made(request: Request) -> Response:
    """Make a key."""
    body = await exchange.read_json(request)
    asked = intake.document(KeyRequest, intake.parse(body))
    new = records.NewKey(
        asked.owner,
        asked.label,
        frozenset(Scope(name) for name in asked.scopes),
        Allowance(asked.requests_per_minute, asked.seconds_per_hour),
        asked.days,
    )
    actor = guard.caller(request).name
    text, row = await _gate(request).write(lambda c: records.create(c, actor, new))
    shown = MadeKey(**_document(row).model_dump(), key=text)
    return exchange.document(shown, 201)


@router.delete("/v1/keys/{key}", **contract.revoke_key())
async def revoked(request: Request, key: str) -> Response:
    """Revoke a key."""
    actor = guard.caller(request).name
    row = None
    if _KEY.fullmatch(key):
        row = await _gate(request).write(lambda c: records.revoke(c, actor, key))
    if row is None:
        raise ProblemError(problems.NOT_FOUND, "There is no such key.")
    return exchange.document(_document(row))


@router.get("/v1/audit", **contract.audit())
async def audited(
    request: Request,
    cursor: Annotated[
        int | None, Query(ge=1, le=2**53, description="Where the last page ended.")
    ] = None,
    limit: Annotated[int, Query(ge=1, le=500, description="Most acts of the page.")] = 50,
) -> Response:
    """List administrative acts, newest first."""
    rows = await _gate(request).read(lambda c: records.acts(c, cursor, limit + 1))
    page = rows[:limit]
    acts = [
        Act(
            time=_time(row.time), actor=row.actor, act=row.act, subject=row.subject, about=row.about
        )
        for row in page
    ]
    following = str(page[-1].seq) if len(rows) > limit else None
    return exchange.document(ActList(acts=acts, next=following))


def _document(row: records.KeyRow) -> ApiKey:
    return ApiKey(
        id=row.id,
        owner=row.owner,
        label=row.label,
        scopes=sorted(scope.value for scope in row.scopes),
        requests_per_minute=row.allowance.requests_per_minute,
        seconds_per_hour=row.allowance.seconds_per_hour,
        created=_time(row.created),
        expires=None if row.expires is None else _time(row.expires),
        revoked=None if row.revoked is None else _time(row.revoked),
        valid=row.valid,
    )


def _time(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC)
