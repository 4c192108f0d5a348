"""Plain routes answer as FastAPI's own do, with their dependencies first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import pytest
from fastapi import APIRouter, Depends, FastAPI, HTTPException, Path
from starlette.requests import Request
from starlette.responses import Response
from starlette.testclient import TestClient

from vibroimpact_service.api.route import PlainRoute

Name = Annotated[str, Path(description="Its name.")]


async def first(request: Request) -> None:
    request.state.order = ["first"]


async def second(request: Request) -> None:
    request.state.order.append("second")
    if "refuse" in request.url.path:
        raise HTTPException(403)


@pytest.fixture(params=[PlainRoute, None], ids=["plain", "fastapi"])
def http(request: pytest.FixtureRequest) -> Iterator[TestClient]:
    route_class = {"route_class": request.param} if request.param else {}
    router = APIRouter(dependencies=[Depends(first)], **route_class)

    @router.get("/things/{name}", dependencies=[Depends(second)])
    async def thing(request: Request, name: Name) -> Response:
        return Response(f"{name} {request.state.order}")

    @router.post("/things", dependencies=[Depends(second)])
    async def new(request: Request) -> Response:
        return Response(await request.body())

    app = FastAPI(routes=router.routes, redirect_slashes=False)
    with TestClient(app) as client:
        yield client


@pytest.mark.parametrize(
    ("method", "path", "status", "text"),
    [
        ("GET", "/things/a%20b.js", 200, "a b.js ['first', 'second']"),
        ("POST", "/things", 200, "body"),
        ("GET", "/things/refuse", 403, None),
        ("GET", "/things", 405, None),
        ("POST", "/things/a", 405, None),
        ("GET", "/things/", 404, None),
        ("GET", "/things/a/b", 404, None),
        ("GET", "/other", 404, None),
    ],
)
def test_a_plain_route_answers_as_that_of_the_framework(
    http: TestClient, method: str, path: str, status: int, text: str | None
) -> None:
    answer = http.request(method, path, content=b"body" if method == "POST" else None)
    assert answer.status_code == status
    assert text is None or answer.text == text


def test_the_path_behind_the_prefix_of_a_proxy_is_matched(http: TestClient) -> None:
    client = TestClient(http.app, root_path="/here")
    assert client.get("/here/things/a").text == "a ['first', 'second']"


def test_openapi_is_generated_as_for_any_other_route(http: TestClient) -> None:
    (parameter,) = http.get("/openapi.json").json()["paths"]["/things/{name}"]["get"]["parameters"]
    assert (parameter["name"], parameter["description"]) == ("name", "Its name.")


def test_handlers_that_take_more_are_refused() -> None:
    router = APIRouter(route_class=PlainRoute)

    async def verbose(request: Request, verbose: bool = False) -> Response:
        return Response()

    with pytest.raises(TypeError, match="/things: the handler must take request and the path"):
        router.add_api_route("/things", verbose)
