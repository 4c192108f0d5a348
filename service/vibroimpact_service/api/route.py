"""What all routes have: the parts of the application, a caller with its rights, and charges."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any, Final, cast

from fastapi import Security
from fastapi.openapi.models import HTTPBearer
from fastapi.routing import APIRoute
from fastapi.security.base import SecurityBase
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_service import problems
from vibroimpact_service.access.authenticator import Authenticator
from vibroimpact_service.access.budget import Budget
from vibroimpact_service.access.caller import LOCAL, Caller, Scope
from vibroimpact_service.api.openapi import failures
from vibroimpact_service.metrics import Metrics
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_service.use_case.charges import Admission
from vibroimpact_service.use_case.evaluation import Evaluation
from vibroimpact_solvers.plan import Plan

FAILURES: Final = failures(401, 403, 412, 421, 429)
"""Problems of every route that needs a key."""


@dataclass(slots=True)
class Services:
    """The parts of one application."""

    settings: Settings
    authenticator: Authenticator
    budget: Budget
    metrics: Metrics
    evaluation: Evaluation
    body_bytes_left: int
    """Bytes of request bodies that may still be in memory, those of all requests together."""
    drain: asyncio.Event = field(default_factory=asyncio.Event)
    """Set when the service is told to stop."""


def services(request: Request) -> Services:
    """Return the parts of the application that serves a request."""
    parts: Services = request.app.state.services
    return parts


class Authentication(SecurityBase):
    """Recognises the caller, checks the scope and counts the request.

    Parameters
    ----------
    scope : Scope
        What the key or token must permit.
    """

    def __init__(self, scope: Scope) -> None:
        self.scope = scope
        self.scheme_name = "key"
        self.model = HTTPBearer(
            description="An API key (vik_…) or a token of the OpenID Connect issuer that the "
            "service trusts. A service on a loopback address without keys needs none."
        )

    async def __call__(self, request: Request) -> Caller:
        """Return the caller.

        Raises
        ------
        ProblemError
            401, 403 or 429.
        """
        parts, state = services(request), request.state
        if not parts.authenticator.keys_required:
            state.caller = LOCAL
            return LOCAL
        try:
            caller = await parts.authenticator.caller(request.headers.get("authorization"))
        except ProblemError as error:
            if error.type is problems.UNAUTHENTICATED:
                await parts.budget.count_failed_key(request.client.host if request.client else "")
            raise
        state.caller = caller
        state.more_headers |= await parts.budget.count(caller)
        if self.scope not in caller.scopes:
            detail = f"This needs a key with the scope {self.scope.value}."
            raise ProblemError(problems.FORBIDDEN, detail)
        return caller


def _requires(scope: Scope) -> Any:
    return Security(Authentication(scope), scopes=[scope.value])


READ: Final = _requires(Scope.READ)
SUBMIT: Final = _requires(Scope.SUBMIT)
METRICS: Final = _requires(Scope.METRICS)
ADMIN: Final = _requires(Scope.ADMIN)


def caller(request: Request) -> Caller:
    """Return the caller of a request whose route requires a scope."""
    known: Caller = request.state.caller
    return known


def owner(request: Request) -> str:
    """Return the owner of the jobs, results and systems that a request may use."""
    return caller(request).owner


def admission(request: Request) -> Admission:
    """Return what charges a computation to the caller of a request."""
    parts, payer = services(request), caller(request)
    account = None if payer.seconds_per_hour is None else payer.name

    async def charge(plan: Plan, seconds: float) -> None:
        left = await parts.budget.spend(payer, plan, seconds)
        more: dict[str, str] = request.state.more_headers
        for name, value in left.items():
            more[name] = f"{more[name]}, {value}" if name in more else value

    async def settle(held: float, used: float) -> None:
        if account is not None:
            await parts.budget.settle(account, held, used)

    free = account is None and parts.settings.inline_seconds <= parts.settings.max_job_seconds
    return Admission(charge, free, settle, account)


Handler = Callable[[Request], Coroutine[Any, Any, Response]]


class PlainRoute(APIRoute):
    """A route for handlers that take the request and the strings of their path alone.

    FastAPI's search for parameters and its conversion of what is returned are left out: with them
    a cached answer takes 0.17 ms of processor time, without 0.13 ms. The dependencies of the route
    are called first, in their order, with the request; then the handler, with the request and the
    parts of the path. OpenAPI is generated as for any other route.
    """

    def get_route_handler(self) -> Handler:
        """Return the function that answers a request.

        Raises
        ------
        TypeError
            Where the handler takes anything else.
        """
        endpoint = self.endpoint
        if set(inspect.signature(endpoint).parameters) != {"request", *self.param_convertors}:
            raise TypeError(f"{self.path}: the handler must take request and the path alone")
        checks = [
            cast("Callable[[Request], Awaitable[object]]", dependency.dependency)
            for dependency in self.dependencies
        ]

        async def handle(request: Request) -> Response:
            for check in checks:
                await check(request)
            answer: Response = await endpoint(request=request, **request.path_params)
            return answer

        return handle
