"""GET /v1/results/{digest}: immutable results by name, whole or in part."""

from __future__ import annotations

import re

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_service import negotiate, problems
from vibroimpact_service.api import contract, exchange
from vibroimpact_service.negotiate import UnsatisfiableRangeError
from vibroimpact_service.problems import ProblemError

router = APIRouter(tags=["results"])

_DIGEST = re.compile(r"[0-9a-f]{64}")


@router.get("/v1/results/{digest}", **contract.result())
async def result(request: Request, digest: str) -> Response:
    """Return a result by its name."""
    media_type = exchange.wanted_representation(request)
    found = None
    if _DIGEST.fullmatch(digest):
        found = await exchange.evaluation(request).result(digest, media_type)
    if found is None:
        raise ProblemError(problems.NOT_FOUND, "There is no such result.")
    answer = exchange.result(request, digest, found, {"Cache-Status": "vibroimpact; hit"})
    if answer.status_code != 200 or not _range_applies(request, found.etag):
        return answer
    size = len(found.data)
    try:
        part = negotiate.byte_range(request.headers.get("range"), size)
    except UnsatisfiableRangeError:
        headers = {"Content-Range": f"bytes */{size}"}
        detail = f"The result has {size} bytes."
        raise ProblemError(problems.RANGE_NOT_SATISFIABLE, detail, headers=headers) from None
    if part is None:
        return answer
    first, stop = part
    headers = dict(answer.headers)
    del headers["content-length"]
    headers["Content-Range"] = f"bytes {first}-{stop - 1}/{size}"
    return Response(found.data[first:stop], 206, headers)


def _range_applies(request: Request, etag: str) -> bool:
    """Whether a range is asked of the representation that there is (RFC 9110, 13.1.5)."""
    condition = request.headers.get("if-range")
    return condition is None or condition.strip() == etag
