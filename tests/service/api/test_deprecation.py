"""Deprecated routes say so, in every answer and in OpenAPI."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from fastapi import APIRouter, Depends, FastAPI
from starlette.requests import Request
from starlette.responses import Response
from starlette.testclient import TestClient

from vibroimpact_service.api import openapi
from vibroimpact_service.api.deprecation import Deprecation
from vibroimpact_service.app import create_app


def test_a_deprecated_route_says_so(settings: Any, queue: Any) -> None:
    since, sunset = datetime(2026, 1, 1, tzinfo=UTC), datetime(2027, 1, 1, tzinfo=UTC)
    deprecation = Deprecation(since, "https://example.org/moving", sunset)
    router = APIRouter()

    @router.get("/v1/old", deprecated=True, dependencies=[Depends(deprecation)])
    async def old(_: Request) -> Response:
        return Response("still here")

    app: FastAPI = create_app(settings, queue)
    app.include_router(router)
    with TestClient(app) as http:
        answer = http.get("/v1/old")
        other = http.get("/v1/version")
    assert answer.text == "still here"
    assert answer.headers["deprecation"] == "@1767225600"
    assert answer.headers["sunset"] == "Fri, 01 Jan 2027 00:00:00 GMT"
    assert answer.headers["link"] == '<https://example.org/moving>; rel="deprecation"'
    assert "deprecation" not in other.headers
    paths = openapi.document(app)["paths"]
    assert paths["/v1/old"]["get"]["deprecated"] is True
    assert "deprecated" not in paths["/v1/version"]["get"]
