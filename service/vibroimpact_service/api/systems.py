"""/v1/systems: systems by content, so that a large matrix is sent once."""

from __future__ import annotations

import re

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_service import digest, negotiate, problems
from vibroimpact_service.api import contract, exchange
from vibroimpact_service.api.guard import Guarded
from vibroimpact_service.evaluate import SYSTEM_TYPES
from vibroimpact_service.problems import ProblemError

router = APIRouter(tags=["systems"], route_class=Guarded)

_SYSTEM = re.compile(r"sys_[0-9a-f]{64}")


@router.post("/v1/systems", **contract.store_system())
async def store(request: Request) -> Response:
    """Store a system."""
    media_type, body = await exchange.read_body(request, SYSTEM_TYPES)
    use = exchange.evaluation(request)
    stored, new = await use.store_system(exchange.owner(request), media_type, body)
    headers = {"Location": f"/v1/systems/{stored.id}"}
    return exchange.document(stored, 201 if new else 200, headers)


@router.get("/v1/systems/{system}", **contract.system())
async def system(request: Request, system: str) -> Response:
    """Return a stored system."""
    data = None
    if _SYSTEM.fullmatch(system) and digest.owned(exchange.owner(request), system):
        data = await exchange.evaluation(request).system(system)
    if data is None:
        raise ProblemError(problems.NOT_FOUND, "There is no such system.")
    etag = negotiate.entity_tag(digest.content(data))
    headers = {"ETag": etag, "Cache-Control": exchange.IMMUTABLE}
    known = request.headers.get("if-none-match")
    if known is not None and negotiate.names(known, etag):
        return Response(status_code=304, headers=headers)
    return Response(data, headers=headers, media_type=negotiate.JSON)
