"""GET /v1/results/{digest}: immutable results by name, whole or in part."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, Final, Union

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_service import problems
from vibroimpact_service.api import answers, request_headers, shared_results
from vibroimpact_service.api.authentication import FAILURES, READ
from vibroimpact_service.api.dependencies import services
from vibroimpact_service.api.openapi import (
    BINARY,
    IF_NONE_MATCH,
    READ_FAILURES,
    Declaration,
    answer,
    failures,
    header,
    not_modified,
    path_id,
    request_header,
)
from vibroimpact_service.api.plain_route import PlainRoute
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results import representations

router = APIRouter(tags=["results"], responses=FAILURES, route_class=PlainRoute)

_DIGEST = re.compile(r"[0-9a-f]{64}")
Digest = Annotated[str, path_id("Name of a result.", "0" * 64, _DIGEST)]

ANY_RESULT: Any = Union[tuple(kind.result for kind in KINDS.values())]  # noqa: UP007
"""Document of a result of any kind."""
OF_RESULT: Final = {"get_result": {"digest": "$response.body#/digest"}}
"""Link from a document that has the digest of a result."""


def result_answer(model: Any, links: Mapping[str, Mapping[str, str]] | None = None) -> Declaration:
    """Return the declaration of an answer that is a result: a document, or one of several."""
    headers = {
        "ETag": header("Strong entity tag: hash of the representation."),
        "Content-Location": header("Address of the result."),
        "Cache-Status": header("Whether anything was computed (RFC 9211)."),
        "Repr-Digest": header("SHA-256 of the representation (RFC 9530)."),
        "Server-Timing": header("Milliseconds for plan, solve and encode."),
    }
    content = {representations.HDF5: {"schema": BINARY}}
    return answer("The result.", model, headers=headers, links=links, content=content)


@router.get(
    "/v1/results/{digest}",
    operation_id="get_result",
    summary="Result by name",
    dependencies=[READ],
    responses={
        200: result_answer(ANY_RESULT),
        206: answer(
            "The bytes of Range.",
            content={media: {"schema": BINARY} for media in representations.SUFFIXES},
        ),
        304: not_modified(),
        **READ_FAILURES,
        **failures(406, 416),
    },
    openapi_extra={
        "parameters": [
            IF_NONE_MATCH,
            request_header("Range", "Part of the representation.", examples=["bytes=0-1023"]),
        ]
    },
)
async def result(request: Request, digest: Digest) -> Response:
    """Results never change: the name is a hash of the request and the solver version."""
    media_type = request_headers.result_media_type(request)
    stored = None
    if _DIGEST.fullmatch(digest) and await shared_results.result_is_visible(request, digest):
        stored = await services(request).evaluation.results.get(digest, media_type)
    if stored is None:
        raise ProblemError(problems.NOT_FOUND, "There is no such result.")
    return await answers.result(request, digest, stored, {"Cache-Status": "vibroimpact; hit"})
