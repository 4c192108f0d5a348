"""POST /v1/compute/{kind} and /v1/plan/{kind}, one pair of routes per kind; POST /v1/batch."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_service import negotiate
from vibroimpact_service.api import contract, exchange, jobs
from vibroimpact_service.api.guard import Guarded
from vibroimpact_service.evaluate import Queued
from vibroimpact_service.kinds import KINDS, Kind

Handler = Callable[[Request], Awaitable[Response]]


def router() -> APIRouter:
    """Return the routes of all kinds."""
    found = APIRouter(tags=["compute"], route_class=Guarded)
    for kind in KINDS.values():
        found.add_api_route(
            f"/v1/compute/{kind.name}", _compute(kind), methods=["POST"],
            **contract.compute(kind),
        )  # fmt: skip
        found.add_api_route(
            f"/v1/plan/{kind.name}", _plan(kind), methods=["POST"], **contract.plan(kind)
        )
    found.add_api_route("/v1/batch", _batch, methods=["POST"], **contract.batch())
    return found


async def _batch(request: Request) -> Response:
    body = await exchange.read_json(request)
    owner, spend = exchange.owner(request), exchange.spending(request)
    answers = await exchange.evaluation(request).batch(owner, body, spend)
    return Response(answers, media_type=negotiate.JSON)


def _compute(kind: Kind) -> Handler:
    async def compute(request: Request) -> Response:
        media_type = exchange.wanted_representation(request)
        preference = negotiate.preference(request.headers.getlist("prefer"))
        key = exchange.idempotency_key(request)
        body = await exchange.read_json(request)
        use = exchange.evaluation(request)
        asked = await use.ask(exchange.owner(request), kind, body)
        spend = exchange.spending(request)
        outcome = await use.compute(asked, preference, media_type, spend, key)
        headers = {"Preference-Applied": preference.applied()} if preference.applied() else {}
        if isinstance(outcome, Queued):
            headers["Location"] = f"/v1/jobs/{outcome.job.id}"
            headers["Retry-After"] = "1"
            return exchange.document(await jobs.described(use.queue, outcome.job), 202, headers)
        headers["Cache-Status"] = f"vibroimpact; {outcome.cache}"
        if outcome.seconds:
            headers["Server-Timing"] = negotiate.server_timing(outcome.seconds)
        return await exchange.result(request, outcome.digest, outcome.representation, headers)

    return compute


def _plan(kind: Kind) -> Handler:
    async def plan(request: Request) -> Response:
        body = await exchange.read_json(request)
        use = exchange.evaluation(request)
        return exchange.document(await use.plan(await use.ask(exchange.owner(request), kind, body)))

    return plan
