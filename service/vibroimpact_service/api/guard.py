"""Which scope each route asks for, and the door that asks for it."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Coroutine, Mapping
from functools import cached_property
from typing import Any, Final

from fastapi.routing import APIRoute
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_service import problems
from vibroimpact_service.access.budget import Budget
from vibroimpact_service.access.caller import Caller, Scope
from vibroimpact_service.access.gate import Gate
from vibroimpact_service.api.lifecycle import DEPRECATED
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError

ANYBODY: Final = None

RULES: Final[Mapping[tuple[str, str], Scope | None]] = {
    **{("POST", f"/v1/compute/{kind}"): Scope.SUBMIT for kind in KINDS},
    ("POST", "/v1/batch"): Scope.SUBMIT,
    **{("POST", f"/v1/plan/{kind}"): Scope.SUBMIT for kind in KINDS},
    ("POST", "/v1/jobs"): Scope.SUBMIT,
    ("GET", "/v1/jobs"): Scope.READ,
    ("GET", "/v1/jobs/{job}"): Scope.READ,
    ("DELETE", "/v1/jobs/{job}"): Scope.SUBMIT,
    ("GET", "/v1/jobs/{job}/result"): Scope.READ,
    ("GET", "/v1/jobs/{job}/events"): Scope.READ,
    ("GET", "/v1/jobs/{job}/share"): Scope.READ,
    ("PUT", "/v1/jobs/{job}/share"): Scope.SUBMIT,
    ("DELETE", "/v1/jobs/{job}/share"): Scope.SUBMIT,
    ("GET", "/v1/results/{digest}"): Scope.READ,
    ("POST", "/v1/systems"): Scope.SUBMIT,
    ("GET", "/v1/systems/{system}"): Scope.READ,
    ("GET", "/v1/keys"): Scope.ADMIN,
    ("POST", "/v1/keys"): Scope.ADMIN,
    ("DELETE", "/v1/keys/{key}"): Scope.ADMIN,
    ("GET", "/v1/audit"): Scope.ADMIN,
    ("GET", "/metrics"): Scope.METRICS,
    # Load balancers, and people who have no key yet, ask these.
    ("GET", "/v1/health/live"): ANYBODY,
    ("GET", "/v1/health/ready"): ANYBODY,
    ("GET", "/v1/version"): ANYBODY,
    ("GET", "/openapi.json"): ANYBODY,
    ("GET", "/"): ANYBODY,
    ("GET", "/docs"): ANYBODY,
    ("GET", "/console/{file}"): ANYBODY,
    ("GET", problems.PAGES + "{code}"): ANYBODY,
}
"""(method, path) -> the scope that the caller must have."""

Handler = Callable[[Request], Coroutine[Any, Any, Response]]


class MissingRuleError(LookupError):
    """A route says not who may use it."""


def rule(method: str, path: str) -> Scope | None:
    """Return the scope that a route asks for.

    Raises
    ------
    MissingRuleError
        Where the table does not have it: such a route is not served.
    """
    try:
        return RULES[method, path]
    except KeyError:
        raise MissingRuleError(f"{method} {path} has no rule in {__name__}") from None


class Guarded(APIRoute):
    """A route that knows its callers before it looks at anything else of a request."""

    def get_route_handler(self) -> Handler:
        """Return the handler behind the door."""
        assert self.methods is not None
        (method,) = self.methods
        scope = rule(method, self.path)
        inner = self._answer if self.direct else super().get_route_handler()
        deprecation = DEPRECATED.get((method, self.path))
        if scope is None and deprecation is None:
            return inner

        async def guarded(request: Request) -> Response:
            if scope is not None:
                await enter(request, scope)
            if deprecation is not None:
                request.state.more_headers |= deprecation.headers()
            return await inner(request)

        return guarded

    @property
    def direct(self) -> bool:
        """Whether the handler wants the request and parts of its path alone."""
        return self._wanted == {"request", *self.param_convertors}

    @cached_property
    def _wanted(self) -> set[str]:
        return set(inspect.signature(self.endpoint).parameters)

    async def _answer(self, request: Request) -> Response:
        """Return what the handler answers.

        What the framework does to find out what else it could want, and for the answer of one
        that returns no response, takes longer than most of our handlers.
        """
        answer: Response = await self.endpoint(request=request, **request.path_params)
        return answer


async def enter(request: Request, scope: Scope) -> None:
    """Recognise the caller, check the scope and count the request.

    Raises
    ------
    ProblemError
        401, 403 or 429.
    """
    gate: Gate = request.app.state.gate
    budget: Budget = request.app.state.budget
    try:
        caller = await gate.caller(request.headers.get("authorization"))
    except ProblemError as error:
        if error.type is problems.UNAUTHENTICATED:
            await budget.failed(request.client.host if request.client else "")
        raise
    request.state.caller = caller
    request.state.more_headers |= await budget.ask(caller)
    if scope not in caller.scopes:
        raise ProblemError(problems.FORBIDDEN, f"This needs a key with the scope {scope.value}.")


def caller(request: Request) -> Caller:
    """Return who sent a request that came through the door."""
    found: Caller = request.state.caller
    return found
