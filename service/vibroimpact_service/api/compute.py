"""POST /v1/compute/{kind} and /v1/plan/{kind}, one pair of routes per kind; POST /v1/batch."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_schema import examples, plans
from vibroimpact_schema.results import BatchAnswers
from vibroimpact_service.api import answers, bodies, openapi, request_headers
from vibroimpact_service.api.bodies import while_connected
from vibroimpact_service.api.jobs import described, job_answer
from vibroimpact_service.api.results import OF_RESULT, result_answer
from vibroimpact_service.api.route import FAILURES, SUBMIT, PlainRoute, admission, owner, services
from vibroimpact_service.documents import parse, requests
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.kinds import KINDS, Kind
from vibroimpact_service.results.encoders import JSON
from vibroimpact_service.use_case import batches

Handler = Callable[[Request], Awaitable[Response]]

router = APIRouter(
    tags=["compute"], responses=FAILURES, dependencies=[SUBMIT], route_class=PlainRoute
)


def _add_compute(kind: Kind) -> None:
    @router.post(
        f"/v1/compute/{kind.name}",
        operation_id=f"compute_{kind.identifier}",
        summary=f"{kind.title}: compute",
        description="Answers with the result if it is stored or the planned work is small, "
        "otherwise with a job.",
        responses={
            200: result_answer(kind.result, links=OF_RESULT),
            202: job_answer("It became a job."),
            304: openapi.not_modified("If-None-Match names the result."),
            **openapi.BODY_FAILURES,
            **openapi.failures(406),
        },
        openapi_extra={
            "requestBody": _request_body(kind),
            "parameters": [
                openapi.request_header(
                    "Prefer",
                    "respond-async: answer with a job. wait=N: wait for the result N seconds "
                    f"first, at most {request_headers.LONGEST_PREFER_WAIT:g}.",
                    examples=["respond-async, wait=5"],
                ),
                *openapi.OF_RESULTS,
                openapi.IF_NONE_MATCH,
                openapi.IDEMPOTENCY_KEY,
            ],
        },
    )
    async def compute(request: Request) -> Response:
        media_type = request_headers.result_media_type(request)
        preference = request_headers.preference(request.headers.getlist("prefer"))
        key = request_headers.idempotency_key(request)
        body = await bodies.read_json(request)
        evaluation = services(request).evaluation
        computation = await _read(request, kind, body)
        computing = evaluation.compute(computation, preference, media_type, admission(request), key)
        outcome = await while_connected(request, computing)
        headers = request_headers.preference_applied(preference)
        if isinstance(outcome, JobRow):
            headers["Location"] = f"/v1/jobs/{outcome.id}"
            headers["Retry-After"] = "1"
            job = await described(evaluation.queue, outcome)
            return answers.document(job, 202, headers)
        headers["Cache-Status"] = f"vibroimpact; {outcome.cache}"
        if outcome.seconds:
            headers["Server-Timing"] = answers.server_timing(outcome.seconds)
        return await answers.result(request, computation.digest, outcome.representation, headers)


def _add_plan(kind: Kind) -> None:
    @router.post(
        f"/v1/plan/{kind.name}",
        operation_id=f"plan_{kind.identifier}",
        summary=f"{kind.title}: plan",
        description="States what would be computed, by which methods and why, what would be "
        "skipped, and the cost.",
        responses={
            200: openapi.answer("The plan.", plans.Plan),
            **openapi.BODY_FAILURES,
        },
        openapi_extra={"requestBody": _request_body(kind)},
    )
    async def plan(request: Request) -> Response:
        body = await bodies.read_json(request)
        computation = await _read(request, kind, body)
        planning = services(request).evaluation.plan(computation)
        return answers.document(await while_connected(request, planning))


async def _read(request: Request, kind: Kind, body: bytes) -> requests.Request:
    threads = services(request).evaluation.threads
    return await threads.parse(body, lambda: requests.read(owner(request), kind, parse.json(body)))


def _request_body(kind: Kind) -> dict[str, Any]:
    shown = {
        name: {"summary": example["summary"], "value": example["request"]}
        for name, example in examples.requests(kind.name).items()
    }
    return openapi.json_body(kind.request.__name__, shown)


for _kind in KINDS.values():
    _add_compute(_kind)
    _add_plan(_kind)


def _tiny(frequency: float) -> dict[str, Any]:
    limiter = {"dof": 5, "gap": 0.2}
    return {
        "system": {"preset": "chain", "n": 13, "constraints": [limiter]},
        "frequency": {"values": [frequency]},
        "outputs": ["impulse"],
    }


@router.post(
    "/v1/batch",
    operation_id="compute_batch",
    summary="Batch of tiny computations",
    description="Each request is answered by its result or its problem, in the same order. "
    "Nothing is stored; GET /v1/version states how many requests there may be, and larger work "
    "is submitted as a job.",
    responses={
        200: openapi.answer("The answers.", BatchAnswers),
        **openapi.BODY_FAILURES,
    },
    openapi_extra={
        "requestBody": openapi.json_body(
            "BatchRequest",
            {
                "impact-modes": {
                    "summary": "The same chain at two frequencies",
                    "value": {"kind": "impact-modes", "requests": [_tiny(1.0), _tiny(2.0)]},
                }
            },
        )
    },
)
async def batch(request: Request) -> Response:
    """Answer many tiny requests."""
    body = await bodies.read_json(request)
    evaluation, settings = services(request).evaluation, services(request).settings
    engine = evaluation.queue.engine
    content = await batches.answer(
        owner(request),
        body,
        admission(request),
        settings,
        evaluation.threads,
        engine,
        evaluation.warming.states,
    )
    return Response(content, media_type=JSON)
