"""Health, version, the contract, and the pages about problems."""

from __future__ import annotations

import html
from importlib.metadata import version

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_schema.service import Health, ServiceLimits, Version
from vibroimpact_service import negotiate, problems
from vibroimpact_service.access.gate import Gate
from vibroimpact_service.api import contract, exchange
from vibroimpact_service.api.guard import Guarded
from vibroimpact_service.api.jobs import LONGEST_POLL
from vibroimpact_service.evaluate import SYSTEM_TYPES
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.metrics import MEDIA_TYPE, Metrics
from vibroimpact_service.problems import ProblemError

router = APIRouter(tags=["service"], route_class=Guarded)


@router.get("/v1/health/live", **contract.live())
async def live() -> Response:
    """Say that the process answers."""
    return exchange.document(Health(status="ok", checks={}))


@router.get("/v1/health/ready", **contract.ready())
async def ready(request: Request) -> Response:
    """Say whether work can be taken now."""
    queue = exchange.evaluation(request).queue
    checks = {
        "records": "ok" if queue.healthy else "the job queue has stopped",
        "workers": "ok" if queue.engine.ready else queue.engine.failure or "starting",
        "service": "stopping" if request.app.state.drain.is_set() else "ok",
    }
    amiss = [f"{part}: {what}" for part, what in checks.items() if what != "ok"]
    if amiss:
        detail = "; ".join(amiss)
        raise ProblemError(problems.UNAVAILABLE, detail, headers={"Retry-After": "1"})
    return exchange.document(Health(status="ok", checks=checks))


@router.get("/v1/version", **contract.version())
async def about(request: Request) -> Response:
    """Say what the service is, what it can and what it accepts."""
    settings = exchange.settings(request)
    number = version("vibroimpact")
    gate: Gate = request.app.state.gate
    closed = gate.closed
    capabilities = ["console", "events", "idempotency", "ranges", "uploads"]
    capabilities += ["keys"] * closed + ["oidc"] * (closed and settings.oidc_issuer is not None)
    limits = ServiceLimits(
        body_bytes=settings.max_body_bytes,
        header_bytes=settings.max_header_bytes,
        points=settings.max_points,
        job_seconds=settings.max_job_seconds,
        unfinished_jobs=settings.max_unfinished_jobs,
        requests_per_minute=settings.requests_per_minute if closed else None,
        seconds_per_hour=settings.seconds_per_hour if closed else None,
        dofs=settings.max_dofs,
        result_bytes=settings.max_result_bytes,
        inline_seconds=settings.inline_seconds,
        batch_requests=settings.batch_requests,
        batch_seconds=settings.batch_seconds,
        wait_seconds=negotiate.LONGEST_WAIT,
        poll_seconds=LONGEST_POLL,
    )
    return exchange.document(
        Version(
            service=number,
            solvers=number,
            api="v1",
            kinds=list(KINDS),
            representations=list(negotiate.REPRESENTATIONS),
            codings=list(negotiate.CODINGS),
            system_types=list(SYSTEM_TYPES),
            capabilities=sorted(capabilities),
            limits=limits,
        )
    )


@router.get("/metrics", **contract.metrics())
async def metrics(request: Request) -> Response:
    """Return the service's own figures."""
    queue = exchange.evaluation(request).queue
    found: Metrics = request.app.state.metrics
    text = found.text(await queue.waiting(), queue.engine.slots, queue.engine.ready)
    return Response(text, media_type=MEDIA_TYPE)


@router.get("/openapi.json", include_in_schema=False)
async def openapi(request: Request) -> Response:
    """Return the contract."""
    headers = {"Cache-Control": "no-cache"}
    return Response(contract.text(request.app), headers=headers, media_type=negotiate.JSON)


@router.get(problems.PAGES + "{code}", include_in_schema=False)
async def page(code: str) -> Response:
    """Return the page about a type of problem."""
    found = problems.TYPES.get(code)
    if found is None:
        raise ProblemError(problems.NOT_FOUND, "There is no such type of problem.")
    title, about = html.escape(found.title), html.escape(found.about)
    retry = "can succeed later" if found.retryable else "will not succeed unchanged"
    text = (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
        f"<h1>{title}</h1><p>{about}</p>"
        f"<p>Code <code>{found.code}</code>, HTTP status {found.status}. "
        f"The same request {retry}.</p></html>"
    )
    headers = {"Cache-Control": "public, max-age=3600"}
    return Response(text, headers=headers, media_type="text/html")
