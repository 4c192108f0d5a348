"""GET /v1/results/{digest}: immutable results by name, whole or in part."""

from __future__ import annotations

import re

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_service import problems
from vibroimpact_service.api import contract, exchange, sharing
from vibroimpact_service.api.guard import Guarded
from vibroimpact_service.problems import ProblemError

router = APIRouter(tags=["results"], route_class=Guarded)

_DIGEST = re.compile(r"[0-9a-f]{64}")


@router.get("/v1/results/{digest}", **contract.result())
async def result(request: Request, digest: str) -> Response:
    """Return a result by its name."""
    media_type = exchange.wanted_representation(request)
    found = None
    if _DIGEST.fullmatch(digest) and await sharing.shows_result(request, digest):
        found = await exchange.evaluation(request).result(digest, media_type)
    if found is None:
        raise ProblemError(problems.NOT_FOUND, "There is no such result.")
    return await exchange.result(request, digest, found, {"Cache-Status": "vibroimpact; hit"})
