"""The short way answers as the framework does, and leaves to it what it does not know."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from vibroimpact_service.api.direct import Direct
from vibroimpact_service.api.guard import Guarded

router, plain = APIRouter(route_class=Guarded), APIRouter()


@router.get("/v1/version")
async def version(request: Request) -> Response:
    return Response("version")


@router.get("/console/{file}")
async def part(request: Request, file: str) -> Response:
    return Response(f"part {file} {request.path_params}")


@plain.get("/console/own")
async def own(verbose: bool = False) -> Response:
    return Response("own")


@router.get("/v1/health/live")
async def live(verbose: bool = False) -> Response:
    return Response("live")


async def _framework(scope: Scope, receive: Receive, send: Send) -> None:
    await Response("framework")(scope, receive, send)


def _ask(method: str, path: str, **more: Any) -> str:
    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        return {"type": "http.request"}

    scope = {"type": "http", "method": method, "path": path, "headers": [], "state": {}} | more
    asyncio.run(Direct(_framework, [router, plain])(scope, receive, send))
    return b"".join(each.get("body", b"") for each in sent).decode()


def test_known_addresses_take_the_short_way() -> None:
    assert _ask("GET", "/v1/version") == "version"
    assert _ask("GET", "/console/a b.js") == "part a b.js {'file': 'a b.js'}"


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("POST", "/v1/version"),
        ("GET", "/v1/version/"),
        ("GET", "/v1/version/x"),
        ("GET", "/console/"),
        ("GET", "/console/a/b"),
        ("GET", "/console"),
        ("GET", "/console/own"),  # no part, but an address of its own
        ("GET", "/other"),
        ("GET", "/"),
        ("GET", ""),
        ("GET", "/v1/health/live"),  # it has a parameter that is to be checked
    ],
)
def test_all_else_is_left_to_the_framework(method: str, path: str) -> None:
    assert _ask(method, path) == "framework"


def test_prefixes_of_proxies_are_left_to_the_framework() -> None:
    assert _ask("GET", "/v1/version", root_path="/here") == "framework"
