"""What surrounds every exchange: request id, security headers, HEAD, and errors as problems."""

from __future__ import annotations

import re
import uuid
from collections.abc import Mapping
from typing import Any, Final

import structlog
from fastapi.exceptions import RequestValidationError
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from vibroimpact_schema.problems import Fault
from vibroimpact_service import problems
from vibroimpact_service.problems import ProblemError

log = structlog.get_logger("vibroimpact.http")

SECURITY: Final[Mapping[str, str]] = {
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
_REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")


class Shell:
    """The outermost layer: nothing leaves without it, and no exception gets past it."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        given = Headers(scope=scope).get("x-request-id", "")
        request_id = given if _REQUEST_ID.fullmatch(given) else uuid.uuid4().hex
        head = scope["method"] == "HEAD"
        state = {**scope.get("state", {}), "request_id": request_id, "head": head}
        inner = {**scope, "state": state}
        if head:
            inner["method"] = "GET"
        started = False

        async def outward(message: Message) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                headers = MutableHeaders(scope=message)
                headers["X-Request-ID"] = request_id
                headers.setdefault("Cache-Control", "no-store")
                for name, value in SECURITY.items():
                    headers.setdefault(name, value)
            elif head and message["type"] == "http.response.body":
                message = {**message, "body": b""}
            await send(message)

        try:
            await self._app(inner, receive, outward)
        except ClientDisconnect:
            log.info("caller went away", request_id=request_id)
        except Exception as error:
            problem = problems.of(error)
            if problem.type is problems.INTERNAL:
                log.exception("request failed", request_id=request_id, path=scope["path"][:200])
            if started:
                raise  # too late for another answer: the connection is cut
            await answer(problem, request_id)(inner, receive, outward)


def answer(problem: ProblemError, request_id: str) -> Response:
    """Return the answer that a problem is."""
    return Response(
        problem.document(request_id).model_dump_json(),
        status_code=problem.type.status,
        headers=problem.headers,
        media_type=problems.MEDIA_TYPE,
    )


async def http_error(request: Request, error: Exception) -> Response:
    """Answer what the framework refuses by itself: unknown address, method and the like."""
    assert isinstance(error, HTTPException)
    type_ = problems.of_status(error.status_code)
    headers = dict(error.headers or {})
    if type_ is problems.METHOD_NOT_ALLOWED:
        headers["Allow"] = ", ".join(_allowed(request))
    problem = ProblemError(type_, type_.about, headers=headers)
    return answer(problem, request.state.request_id)


def _allowed(request: Request) -> list[str]:
    """Return the methods of an address; the framework knows only those of one of its routes."""
    path = request.scope["path"]
    routes = (route for router in request.app.state.routers for route in router.routes)
    methods = {m for route in routes if route.path_regex.match(path) for m in route.methods}
    return sorted(methods | {"HEAD"} if "GET" in methods else methods)


async def parameter_error(request: Request, error: Exception) -> Response:
    """Answer a wrong path, query or header parameter; never with what was sent."""
    assert isinstance(error, RequestValidationError)
    faults = [_fault(item) for item in error.errors()]
    detail = f"{faults[0].parameter}: {faults[0].message}"
    problem = ProblemError(problems.INVALID, detail, faults)
    return answer(problem, request.state.request_id)


def _fault(item: Mapping[str, Any]) -> Fault:
    name = str(item["loc"][-1])
    message = problems.sentence(item["type"], item["msg"], item.get("ctx", {}))
    return Fault(pointer="", parameter=name, code="wrong_parameter", message=message)
