"""The console, the page of the contract, and what they are made of."""

from __future__ import annotations

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_service import console, digest, negotiate, problems
from vibroimpact_service.api.guard import Guarded
from vibroimpact_service.problems import ProblemError

router = APIRouter(include_in_schema=False, route_class=Guarded)


@router.get("/")
async def index(request: Request) -> Response:
    """Return the console."""
    return _page(request, "index.html")


@router.get("/docs")
async def docs(request: Request) -> Response:
    """Return the page that shows the contract."""
    return _page(request, "docs.html")


@router.get("/console/{file}")
async def part(request: Request, file: str) -> Response:
    """Return a file of the pages."""
    return _page(request, file)


def _page(request: Request, name: str) -> Response:
    data = console.FILES.get(name)
    if data is None:
        raise ProblemError(problems.NOT_FOUND, "There is no such page.")
    etag = negotiate.entity_tag(digest.content(data))
    headers = {
        "ETag": etag,
        "Cache-Control": "no-cache",
        "Content-Security-Policy": console.POLICY,
    }
    known = request.headers.get("if-none-match")
    if known is not None and negotiate.names(known, etag):
        return Response(status_code=304, headers=headers)
    return Response(data, headers=headers, media_type=console.media_type(name))
