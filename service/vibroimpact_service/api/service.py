"""Health, version, metrics, the OpenAPI document, and the pages about problem types."""

from __future__ import annotations

import asyncio
import html
from importlib.metadata import version

import orjson
from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_schema.service import Health, ServiceLimits, Version
from vibroimpact_service import problems
from vibroimpact_service.api import answers, openapi, request_headers
from vibroimpact_service.api.jobs import LONGEST_POLL
from vibroimpact_service.api.route import FAILURES, METRICS, services
from vibroimpact_service.documents import stored_systems
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.metrics import MEDIA_TYPE, Present
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results.encoders import ENCODERS, JSON
from vibroimpact_service.results.representations import CODINGS

router = APIRouter(tags=["service"])


@router.get(
    "/v1/health/live",
    operation_id="health_live",
    summary="Liveness",
    responses={
        200: openapi.answer("The process answers.", Health, rated=False),
        **openapi.failures(500),
    },
)
async def health_live() -> Response:
    """Whether the process answers."""
    return answers.document(Health(status="ok", checks={}))


@router.get(
    "/v1/health/ready",
    operation_id="health_ready",
    summary="Readiness",
    responses={
        200: openapi.answer("The service accepts work.", Health, rated=False),
        **openapi.failures(500, 503),
    },
)
async def health_ready(request: Request) -> Response:
    """Whether records, store and workers accept work; what needs cold kernels becomes a job."""
    checks = await _checks(request)
    faults = [f"{part}: {state}" for part, state in checks.items() if state != "ok"]
    if faults:
        detail = "; ".join(faults)
        raise ProblemError(problems.UNAVAILABLE, detail, headers={"Retry-After": "1"})
    kernels = services(request).evaluation.warming.summary
    return answers.document(Health(status="ok", checks=checks, kernels=kernels))


async def _checks(request: Request) -> dict[str, str]:
    """Return what is wrong with each part of the service, or ``ok``."""
    state = _state(request)
    if state == "stopping":
        return {"service": state}
    return {**await services(request).evaluation.queue.checks(), "service": state}


def _state(request: Request) -> str:
    if services(request).drain.is_set():
        return "stopping"
    return "overloaded" if services(request).evaluation.threads.saturated else "ok"


@router.get(
    "/v1/version",
    operation_id="version",
    summary="Version",
    responses={
        200: openapi.answer("Versions, kinds and limits.", Version, rated=False),
        **openapi.failures(500),
    },
)
async def get_version(request: Request) -> Response:
    """Version, kinds, media types, capabilities and limits of the service."""
    settings = services(request).settings
    number = version("vibroimpact")
    keys_required = services(request).authenticator.keys_required
    capabilities = ["console", "events", "idempotency", "ranges", "uploads"]
    capabilities += ["keys"] * keys_required + ["oidc"] * (
        keys_required and settings.oidc_issuer is not None
    )
    limits = ServiceLimits(
        body_bytes=settings.max_body_bytes,
        header_bytes=settings.max_header_bytes,
        points=settings.max_points,
        job_seconds=settings.max_job_seconds,
        unfinished_jobs=settings.max_unfinished_jobs,
        requests_per_minute=settings.requests_per_minute if keys_required else None,
        seconds_per_hour=settings.seconds_per_hour if keys_required else None,
        dofs=settings.max_dofs,
        result_bytes=settings.max_result_bytes,
        inline_seconds=settings.inline_seconds,
        batch_requests=settings.batch_requests,
        batch_seconds=settings.batch_seconds,
        wait_seconds=request_headers.LONGEST_PREFER_WAIT,
        poll_seconds=LONGEST_POLL,
    )
    return answers.document(
        Version(
            service=number,
            solvers=number,
            api="v1",
            kinds=list(KINDS),
            representations=list(ENCODERS),
            codings=list(CODINGS),
            system_types=list(stored_systems.MEDIA_TYPES),
            capabilities=sorted(capabilities),
            limits=limits,
        )
    )


@router.get(
    "/metrics",
    operation_id="metrics",
    summary="Metrics",
    dependencies=[METRICS],
    responses={
        **FAILURES,
        200: openapi.answer("The metrics.", content={"text/plain": {"schema": {"type": "string"}}}),
        **openapi.failures(500, 503),
    },
)
async def get_metrics(request: Request) -> Response:
    """Return requests, queue, workers, cache and solve times, in the format of Prometheus."""
    # This is answered as well while records and store are not: it is needed most then.
    metrics, evaluation = services(request).metrics, services(request).evaluation
    queue = evaluation.queue
    checks, observed = await asyncio.gather(_checks(request), queue.observe())
    text = metrics.text(
        Present(
            checks,
            queue.engine.workers,
            evaluation.warming.states,
            observed.backlog,
            observed.room,
            observed.expiry,
        )
    )
    return Response(text, media_type=MEDIA_TYPE)


@router.get("/openapi.json", include_in_schema=False)
async def get_openapi(request: Request) -> Response:
    """Return the OpenAPI document."""
    headers = {"Cache-Control": "no-cache"}
    state = request.app.state
    content = getattr(state, "contract", None)
    if content is None:
        content = state.contract = orjson.dumps(openapi.document(request.app))
    return await answers.tagged(request, content, JSON, headers)


@router.get(problems.PAGES + "{code}", include_in_schema=False)
async def page(code: str) -> Response:
    """Return the page about a problem type."""
    problem = problems.TYPES.get(code)
    if problem is None:
        raise ProblemError(problems.NOT_FOUND, "There is no such problem type.")
    title, about = html.escape(problem.title), html.escape(problem.about)
    retry = "can succeed later" if problem.retryable else "will not succeed unchanged"
    text = (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
        f"<h1>{title}</h1><p>{about}</p>"
        f"<p>Code <code>{problem.code}</code>, HTTP status {problem.status}. "
        f"The same request {retry}.</p></html>"
    )
    headers = {"Cache-Control": "public, max-age=3600"}
    return Response(text, headers=headers, media_type="text/html")
