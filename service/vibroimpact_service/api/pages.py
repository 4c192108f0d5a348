"""The console, the page that shows the OpenAPI document, and their files."""

from __future__ import annotations

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_service import console, problems
from vibroimpact_service.api import answers
from vibroimpact_service.problems import ProblemError

router = APIRouter(include_in_schema=False)


@router.get("/")
async def index(request: Request) -> Response:
    """Return the console."""
    return await _page(request, "index.html")


@router.get("/docs")
async def docs(request: Request) -> Response:
    """Return the page that shows the OpenAPI document."""
    return await _page(request, "docs.html")


@router.get("/console/{file:path}")
async def page_file(request: Request, file: str) -> Response:
    """Return a file of the pages."""
    return await _page(request, file)


async def _page(request: Request, name: str) -> Response:
    data = console.FILES.get(name)
    if data is None:
        raise ProblemError(problems.NOT_FOUND, "There is no such page.")
    headers = {"Cache-Control": "no-cache", "Content-Security-Policy": console.POLICY}
    return await answers.tagged(request, data, console.media_type(name), headers)
