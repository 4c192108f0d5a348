"""/v1/keys and /v1/audit: API keys and the record of administrative acts."""

from __future__ import annotations

import re
from typing import Annotated, Any

import sqlalchemy as sa
from fastapi import APIRouter, Path
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_schema.keys import Act, ActList, ApiKey, KeyList, KeyRequest, MadeKey
from vibroimpact_service import problems
from vibroimpact_service.access import records
from vibroimpact_service.api import answers, bodies
from vibroimpact_service.api.jobs import Cursor, Limit, utc
from vibroimpact_service.api.openapi import (
    BODY_FAILURES,
    READ_FAILURES,
    answer,
    failures,
    json_body,
)
from vibroimpact_service.api.route import ADMIN, FAILURES, caller, services
from vibroimpact_service.documents import parse
from vibroimpact_service.problems import ProblemError

router = APIRouter(tags=["administration"], responses=FAILURES, dependencies=[ADMIN])

_KEY = re.compile(r"[0-9a-f]{12}")
KeyId = Annotated[
    str,
    Path(
        description="Id of a key.",
        examples=["0" * 12],
        json_schema_extra={"pattern": f"^{_KEY.pattern}$"},
    ),
]


@router.get(
    "/v1/keys",
    operation_id="list_keys",
    summary="List API keys",
    description="Without their secrets, which are not stored.",
    responses={
        200: answer("All keys.", KeyList),
        **failures(404, 500, 503),
    },
)
async def list_keys(request: Request) -> Response:
    """List all keys."""
    rows = await services(request).authenticator.records.read(records.listed)
    return answers.document(KeyList(keys=[_document(row) for row in rows]))


@router.post(
    "/v1/keys",
    operation_id="make_key",
    status_code=201,
    summary="Make an API key",
    description="The key is shown in this answer only.",
    responses={
        201: answer("The key.", MadeKey, links={"revoke_key": {"key": "$response.body#/id"}}),
        **BODY_FAILURES,
        **failures(404),
    },
    openapi_extra={
        "requestBody": json_body(
            "KeyRequest",
            {
                "laptop": {
                    "summary": "A key for a year",
                    "value": {
                        "owner": "ann",
                        "label": "laptop",
                        "scopes": ["read", "submit"],
                        "days": 365,
                    },
                }
            },
        )
    },
)
async def make_key(request: Request) -> Response:
    """Make a key."""
    body = await bodies.read_json(request)
    new = parse.document(KeyRequest, parse.json(body))
    access = services(request).authenticator.records
    text, row = await access.write(records.create, caller(request).name, new)
    return answers.document(MadeKey(**_document(row).model_dump(), key=text), 201)


@router.delete(
    "/v1/keys/{key}",
    operation_id="revoke_key",
    summary="Revoke an API key",
    description="The key is refused from now on. Jobs and results of its owner remain.",
    responses={
        200: answer("The key.", ApiKey),
        **READ_FAILURES,
    },
)
async def revoke_key(request: Request, key: KeyId) -> Response:
    """Revoke a key."""
    row = None
    if _KEY.fullmatch(key):
        access = services(request).authenticator.records
        row = await access.write(records.revoke, caller(request).name, key)
    if row is None:
        raise ProblemError(problems.NOT_FOUND, "There is no such key.")
    return answers.document(_document(row))


@router.get(
    "/v1/audit",
    operation_id="list_acts",
    summary="Administrative acts",
    description="The audit log: keys made and revoked, jobs shared, newest first.",
    responses={
        200: answer("A page of acts.", ActList),
        **READ_FAILURES,
    },
)
async def list_acts(request: Request, cursor: Cursor = None, limit: Limit = 50) -> Response:
    """List administrative acts, newest first."""
    access = services(request).authenticator.records
    rows = await access.read(records.acts, cursor, limit + 1)
    page = rows[:limit]
    acts = [
        Act(time=utc(row.time), actor=row.actor, act=row.act, subject=row.subject, about=row.about)
        for row in page
    ]
    following = str(page[-1].seq) if len(rows) > limit else None
    return answers.document(ActList(acts=acts, next=following))


def _document(row: sa.Row[Any]) -> ApiKey:
    return ApiKey(
        id=row.id,
        owner=row.owner,
        label=row.label,
        scopes=row.scopes.split(),
        requests_per_minute=row.requests_per_minute,
        seconds_per_hour=row.seconds_per_hour,
        created=utc(row.created),
        expires=None if row.expires is None else utc(row.expires),
        revoked=None if row.revoked is None else utc(row.revoked),
        valid=row.valid,
    )
