"""What surrounds every exchange: request id, security headers, HEAD, and errors as problems."""

from __future__ import annotations

import re
import time
import uuid
from collections.abc import Collection, Mapping
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
from vibroimpact_service.access.gate import Gate, loopback
from vibroimpact_service.metrics import Metrics
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings

log = structlog.get_logger("vibroimpact.http")

SECURITY: Final[Mapping[str, str]] = {
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
EXPOSED: Final = (
    *("Cache-Status", "Content-Disposition", "Content-Location", "Content-Range", "ETag", "Link"),
    *("Location", "Preference-Applied", "RateLimit", "RateLimit-Policy", "Repr-Digest"),
    *("Retry-After", "Server-Timing", "X-Request-ID"),
)
"""Header fields that pages of other origins may read."""

_LOCAL_NAMES: Final = ("localhost", "127.0.0.1", "[::1]")
_METHODS: Final = frozenset({"GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS"})
_PORT = re.compile(r":\d{1,5}$")
_REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")


class Shell:
    """The outermost layer: nothing leaves without it, and no exception gets past it."""

    def __init__(self, app: ASGIApp, settings: Settings, metrics: Metrics, gate: Gate) -> None:
        self._app, self._settings, self._metrics, self._gate = app, settings, metrics, gate
        self._loopback = loopback(settings.host)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began = time.perf_counter()
        sent = Headers(scope=scope)
        given = sent.get("x-request-id", "")
        request_id = given if _REQUEST_ID.fullmatch(given) else uuid.uuid4().hex
        head = scope["method"] == "HEAD"
        more_headers: dict[str, str] = {}
        state = {
            **scope.get("state", {}),
            "request_id": request_id,
            "head": head,
            "more_headers": more_headers,
        }
        structlog.contextvars.bind_contextvars(request_id=request_id)
        inner = {**scope, "state": state}
        if head:
            inner["method"] = "GET"
        started = False
        status = 0

        async def outward(message: Message) -> None:
            nonlocal started, status
            if message["type"] == "http.response.start":
                started, status = True, message["status"]
                headers = MutableHeaders(scope=message)
                for name, value in state["more_headers"].items():
                    headers.setdefault(name, value)
                headers["X-Request-ID"] = request_id
                headers.setdefault("Cache-Control", "no-store")
                for name, value in SECURITY.items():
                    headers.setdefault(name, value)
            elif head and message["type"] == "http.response.body":
                message = {**message, "body": b""}
            await send(message)

        try:
            self._check_host(sent.get("host", ""))
            await self._app(inner, receive, outward)
        except ClientDisconnect:
            log.info("caller went away")
        except Exception as error:
            problem = problems.of(error)
            if problem.type is problems.INTERNAL:
                log.exception("request failed", path=scope["path"][:200])
            if started:
                raise  # too late for another answer: the connection is cut
            await answer(problem, request_id)(inner, receive, outward)
        finally:
            self._note(inner, scope["method"], status, time.perf_counter() - began)

    def _check_host(self, host: str) -> None:
        """Refuse names that the service does not go by.

        A page in a browser of this machine could reach a service without keys under a name of
        its own that it lets point here; asking for ours keeps it out.
        """
        names: Collection[str] = self._settings.hosts
        if not names:
            if self._gate.closed or not self._loopback:
                return
            names = _LOCAL_NAMES
        name = host.rpartition(":")[0] if _PORT.search(host) else host
        if name.lower() not in names:
            raise ProblemError(problems.MISDIRECTED, problems.MISDIRECTED.about)

    def _note(self, scope: Scope, method: str, status: int, seconds: float) -> None:
        """Count and log an exchange, under its route: addresses would be countless."""
        route = getattr(scope.get("route"), "path", "")
        shown = method if method in _METHODS else "other"
        self._metrics.answered(shown, route, status, seconds)
        caller = scope["state"].get("caller")
        log.info(
            "request",
            method=shown,
            path=scope["path"][:200],
            status=status,
            ms=round(1e3 * seconds, 2),
            caller=None if caller is None else caller.name,
        )


def cross_origin(settings: Settings) -> dict[str, Any]:
    """Return what pages of other origins may do, where the settings name any."""
    return {
        "allow_origins": settings.cors_origins,
        "allow_methods": ["GET", "HEAD", "POST", "PUT", "DELETE"],
        "allow_headers": ["*", "Authorization"],
        "expose_headers": list(EXPOSED),
        "max_age": 600,
    }


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
