"""The boundary of the service: request ids, security headers, errors, the access log."""

from __future__ import annotations

import asyncio
import re
import secrets
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from typing import Any, Final

import structlog
from fastapi.exceptions import RequestValidationError
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from vibroimpact_schema.problems import Fault
from vibroimpact_service import problems, validation
from vibroimpact_service.access.authenticator import loopback
from vibroimpact_service.api import request_headers
from vibroimpact_service.metrics import Metrics
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings

log = structlog.get_logger("vibroimpact.http")

_DEFAULTS: Final = (
    (b"cache-control", b"no-store"),
    (b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
)
"""Header fields of every answer that does not set them itself."""
EXPOSED: Final = (
    *("Cache-Status", "Content-Disposition", "Content-Location", "Content-Range", "ETag", "Link"),
    *("Location", "Preference-Applied", "RateLimit", "RateLimit-Policy", "Repr-Digest"),
    *("Retry-After", "Server-Timing", "X-Request-ID"),
)
"""Header fields that pages of other origins may read."""

_LOCAL_NAMES: Final = ("localhost", "127.0.0.1", "[::1]")
_CHANGING: Final = frozenset({"POST", "PUT", "DELETE"})
_METHODS: Final = frozenset({"GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS"})
_AT_ONCE: Final = 16
"""Requests that begin in one turn: each takes up to a millisecond or two of the loop."""
_PORT = re.compile(r":\d{1,5}$")
_REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")


class Pacing:
    """Lets a few requests begin in one turn of the event loop, the others later in their order.

    When hundreds of connections have a request at the same moment, the loop would serve all of
    them before it looks at its timers and at what else is ready: events, heartbeats, health. With
    400 connections that ask for stored results, on two busy cores, the loop stands still for 0.9 s;
    with pacing for 0.13 s.

    Parameters
    ----------
    at_once : int
        Requests that begin in one turn.
    """

    def __init__(self, at_once: int = _AT_ONCE) -> None:
        self._at_once = at_once
        self._left = at_once
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._loop: asyncio.AbstractEventLoop | None = None

    async def begin(self) -> None:
        """Wait for a turn in which another request may begin."""
        loop = asyncio.get_running_loop()
        if loop is not self._loop:  # one after the other may run the application, as tests do
            self._loop, self._left = loop, self._at_once
            self._waiting.clear()
        if self._left == self._at_once:
            loop.call_soon(self._next_turn, loop)
        if self._left > 0:
            self._left -= 1
            return
        turn = loop.create_future()
        self._waiting.append(turn)
        await turn

    def _next_turn(self, loop: asyncio.AbstractEventLoop) -> None:
        """Let the next requests begin."""
        self._left = self._at_once
        while self._waiting and self._left > 0:
            turn = self._waiting.popleft()
            if not turn.done():  # its request was not given up
                turn.set_result(None)
                self._left -= 1
        if self._left < self._at_once:
            loop.call_soon(self._next_turn, loop)


class Boundary:
    """The outermost middleware: every request and answer, and every exception, passes it.

    Parameters
    ----------
    app : ASGIApp
    metrics : Metrics
    host : str
        Address on which the service listens.
    names : collection of str
        Host names to which it answers; none: those of this machine where it listens on a
        loopback address and requires no keys, else any.
    keys_required : callable
        ``() -> bool``.
    """

    def __init__(
        self,
        app: ASGIApp,
        metrics: Metrics,
        host: str,
        names: Collection[str],
        keys_required: Callable[[], bool],
    ) -> None:
        self._app, self._metrics = app, metrics
        self._names, self._keys_required = names, keys_required
        self._loopback = loopback(host)
        self._pacing = Pacing()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        await self._pacing.begin()
        began = time.perf_counter()
        sent = Headers(scope=scope)
        given = sent.get("x-request-id")
        request_id = given if given and _REQUEST_ID.fullmatch(given) else secrets.token_hex(16)
        method, head = scope["method"], scope["method"] == "HEAD"
        more_headers: dict[str, str] = {}
        state = {
            **scope.get("state", {}),
            "request_id": request_id,
            "head": head,
            "more_headers": more_headers,
        }
        structlog.contextvars.bind_contextvars(request_id=request_id)
        inner = {**scope, "method": "GET" if head else method, "state": state}
        status = 0

        async def answer(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                _complete(message["headers"], request_id, state["more_headers"])
            elif head and message["type"] == "http.response.body":
                message = {**message, "body": b""}
            await send(message)

        try:
            self._check_host(sent.get("host", ""))
            if method in _CHANGING and not scope["path"].startswith("/v1/compute/"):
                request_headers.check_match(sent.get("if-match"), None)  # they have no entity tags
            await self._app(inner, receive, answer)
        except asyncio.CancelledError:
            if status:
                raise
            # The server cancels requests that outlast its stop, and so do threads that stop.
            await problem_answer(problems.stopping(), request_id)(inner, receive, answer)
        except ClientDisconnect:
            log.info("client disconnected")
        except Exception as error:
            problem = problems.of(error)
            if problem.type is problems.INTERNAL:
                log.exception("request failed", path=scope["path"][:200])
            if status:
                raise  # too late for another answer: the connection is cut
            await problem_answer(problem, request_id)(inner, receive, answer)
        finally:
            self._record(inner, method, status, time.perf_counter() - began)

    def _check_host(self, host: str) -> None:
        """Refuse host names that are not the service's.

        A page in a browser of this machine could reach a service without keys under a host name
        of its own that resolves to this machine; requiring ours keeps it out.
        """
        names = self._names
        if not names:
            if self._keys_required() or not self._loopback:
                return
            names = _LOCAL_NAMES
        name = host.rpartition(":")[0] if _PORT.search(host) else host
        if name.lower() not in names:
            raise ProblemError(problems.MISDIRECTED, problems.MISDIRECTED.about)

    def _record(self, scope: Scope, method: str, status: int, seconds: float) -> None:
        """Count and log a request, under its route: the addresses would be countless."""
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


def _complete(headers: list[tuple[bytes, bytes]], request_id: str, more: Mapping[str, str]) -> None:
    """Add the header fields that an answer lacks."""
    present = {name for name, _ in headers}
    headers.append((b"x-request-id", request_id.encode()))
    headers.extend(field for field in _DEFAULTS if field[0] not in present)
    for name, value in more.items():
        if (raw := name.lower().encode()) not in present:
            headers.append((raw, value.encode("latin-1")))


def cross_origin(settings: Settings) -> dict[str, Any]:
    """Return the CORS policy for the origins that the settings name."""
    return {
        "allow_origins": settings.cors_origins,
        "allow_methods": ["GET", "HEAD", "POST", "PUT", "DELETE"],
        "allow_headers": ["*", "Authorization"],
        "expose_headers": list(EXPOSED),
        "max_age": 600,
    }


def problem_answer(problem: ProblemError, request_id: str) -> Response:
    """Return the answer with a problem document."""
    return Response(
        problem.document(request_id).model_dump_json(),
        status_code=problem.type.status,
        headers=problem.headers,
        media_type=problems.MEDIA_TYPE,
    )


_NO_OTHER_ORIGINS: Final = (
    "Pages of other origins may not read answers of this service: its setting "
    "VIBROIMPACT_CORS_ORIGINS lists those that may, and is empty."
)


async def http_error(request: Request, error: Exception) -> Response:
    """Answer what the framework refuses by itself: unknown address, method and the like."""
    assert isinstance(error, HTTPException)
    type_ = problems.of_status(error.status_code)
    headers = dict(error.headers or {})
    if type_ is problems.METHOD_NOT_ALLOWED:
        headers["Allow"] = ", ".join(_allowed(request))
    # A browser asks so before it sends what a page of another origin wants to send.
    asked = request.method == "OPTIONS" and "origin" in request.headers
    detail = _NO_OTHER_ORIGINS if asked else type_.about
    problem = ProblemError(type_, detail, headers=headers)
    return problem_answer(problem, request.state.request_id)


def _allowed(request: Request) -> list[str]:
    """Return the methods of an address; the framework knows only those of one of its routes."""
    path = request.scope["path"]
    methods = {m for r in request.app.routes if r.path_regex.match(path) for m in r.methods}
    return sorted(methods | {"HEAD"} if "GET" in methods else methods)


async def parameter_error(request: Request, error: Exception) -> Response:
    """Answer a wrong path, query or header parameter; never with what was sent."""
    assert isinstance(error, RequestValidationError)
    faults = [_fault(item) for item in error.errors()]
    detail = f"{faults[0].parameter}: {faults[0].message}"
    problem = ProblemError(problems.INVALID, detail, faults)
    return problem_answer(problem, request.state.request_id)


def _fault(item: Mapping[str, Any]) -> Fault:
    name = str(item["loc"][-1])
    message = validation.sentence(item["type"], item["msg"], item.get("ctx", {}))
    return Fault(pointer="", parameter=name, code="wrong_parameter", message=message)
