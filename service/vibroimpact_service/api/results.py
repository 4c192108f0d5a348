"""GET /v1/results/{digest}: immutable results by name, whole or in part."""

from __future__ import annotations

import re
from typing import Annotated, Any, Final, Union

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_service import problems
from vibroimpact_service.api import answers, openapi, request_headers, shared_results
from vibroimpact_service.api.route import FAILURES, READ, PlainRoute, services
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results.encoders import ENCODERS, JSON

router = APIRouter(tags=["results"], responses=FAILURES, route_class=PlainRoute)

_DIGEST = re.compile(r"[0-9a-f]{64}")
Digest = Annotated[str, openapi.path_id("Name of a result.", "0" * 64, _DIGEST)]

ANY_RESULT: Any = Union[tuple(kind.result for kind in KINDS.values())]  # noqa: UP007
"""Document of a result of any kind."""
OF_RESULT: Final = {"get_result": {"digest": "$response.body#/digest"}}
"""Link from a document that has the digest of a result."""


def result_answer(model: Any, **more: Any) -> openapi.Declaration:
    """Return the declaration of an answer that is a result; parameters as of `openapi.answer`."""
    headers = {
        "ETag": openapi.header("Strong entity tag: hash of the representation."),
        "Content-Location": openapi.header("Address of the result."),
        "Cache-Status": openapi.header("Whether anything was computed (RFC 9211)."),
        "Repr-Digest": openapi.header("SHA-256 of the representation (RFC 9530)."),
        "Server-Timing": openapi.header("Milliseconds for plan, solve and encode."),
    }
    content = {
        media_type: {"schema": openapi.BINARY if encoder.binary else {"type": "string"}}
        for media_type, encoder in ENCODERS.items()
        if media_type != JSON
    }
    return openapi.answer("The result.", model, headers=headers, content=content, **more)


@router.get(
    "/v1/results/{digest}",
    operation_id="get_result",
    summary="Result by name",
    dependencies=[READ],
    responses={
        200: result_answer(ANY_RESULT),
        206: openapi.answer(
            "The bytes of Range.",
            content={media: {"schema": openapi.BINARY} for media in ENCODERS},
        ),
        304: openapi.not_modified(),
        **openapi.READ_FAILURES,
        **openapi.failures(406, 416),
    },
    openapi_extra={
        "parameters": [
            *openapi.OF_RESULTS,
            openapi.IF_NONE_MATCH,
            openapi.request_header(
                "Range", "Part of the representation.", examples=["bytes=0-1023"]
            ),
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
