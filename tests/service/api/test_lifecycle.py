"""Routes on their way out say so, in every answer and in the contract."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import pytest
from fastapi import APIRouter, FastAPI
from starlette.requests import Request
from starlette.responses import Response
from starlette.testclient import TestClient

from vibroimpact_service.api import guard, lifecycle
from vibroimpact_service.api.guard import Guarded
from vibroimpact_service.api.lifecycle import Deprecation
from vibroimpact_service.app import create_app


def test_a_deprecated_route_says_so(
    settings: Any, queue: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    since, sunset = datetime(2026, 1, 1, tzinfo=UTC), datetime(2027, 1, 1, tzinfo=UTC)
    deprecation = Deprecation(since, "https://example.org/moving", sunset)
    monkeypatch.setitem(lifecycle.DEPRECATED, ("GET", "/v1/old"), deprecation)
    rules = {**guard.RULES, ("GET", "/v1/old"): None}
    monkeypatch.setattr(guard, "RULES", rules)
    router = APIRouter(route_class=Guarded)

    async def old(_: Request) -> Response:
        return Response("still here")

    router.add_api_route("/v1/old", old, methods=["GET"])
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
