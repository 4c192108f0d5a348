"""The contract of the routes: what each takes and answers, as OpenAPI 3.1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import orjson
from fastapi import FastAPI
from pydantic import BaseModel, TypeAdapter
from pydantic.json_schema import models_json_schema
from starlette.responses import JSONResponse

from vibroimpact_schema import examples, plans
from vibroimpact_schema import jobs as job_documents
from vibroimpact_schema import service as service_documents
from vibroimpact_schema.problems import Problem
from vibroimpact_schema.requests import JobRequest
from vibroimpact_schema.systems import System
from vibroimpact_service import negotiate, problems
from vibroimpact_service.kinds import KINDS, Kind

TITLE: Final = "Vibroimpact"
SUMMARY: Final = "Impact modes and motions of structures with rigid amplitude limiters."
DESCRIPTION: Final = (
    "Indices count from 0. Frequencies are Omega, the fundamental angular frequency "
    "Omega = (pi/2) omega, unless a field says omega. Numbers are in any consistent set of "
    "units; JSON and HDF5 hold the same numbers to the last bit. Every error is a problem "
    "document (RFC 9457) whose errors point at the faulty fields."
)

Routing = dict[str, Any]
_REF = "#/components/schemas/{model}"
_BODY_PROBLEMS = (400, 413, 415, 422, 500, 503)
_READ_PROBLEMS = (400, 404, 422, 500, 503)


def compute(kind: Kind) -> Routing:
    """Describe POST /v1/compute/{kind}."""
    return _route(
        f"compute_{kind.decoder}",
        f"{kind.title}: compute",
        "Answers at once where the result is known or the planned work is small, else with a job.",
        {
            200: _results(kind.result),
            202: _answer("It became a job.", job_documents.Job, _JOB_HEADERS),
            304: {"description": "The result is the one that If-None-Match names."},
        },
        (*_BODY_PROBLEMS, 406),
        body=_request_of(kind),
        headers=(_PREFER, _IF_NONE_MATCH, _IDEMPOTENCY_KEY),
    )


def plan(kind: Kind) -> Routing:
    """Describe POST /v1/plan/{kind}."""
    return _route(
        f"plan_{kind.decoder}",
        f"{kind.title}: plan",
        "Says what would be computed, how and why, what not, and what it would cost.",
        {200: _answer("The plan.", plans.Plan)},
        _BODY_PROBLEMS,
        body=_request_of(kind),
    )


def submit() -> Routing:
    """Describe POST /v1/jobs."""
    shown = {
        f"{name}.{key}": {
            "summary": example["summary"],
            "value": {"kind": name, "request": example["request"]},
        }
        for name in KINDS
        for key, example in examples.requests(name).items()
    }
    return _route(
        "submit_job",
        "Queue a computation",
        "The job is durable when this answers. Equal requests under way are computed once.",
        {201: _answer("The job.", job_documents.Job, _JOB_HEADERS)},
        _BODY_PROBLEMS,
        body=_json_body("JobRequest", shown),
        headers=(_IDEMPOTENCY_KEY,),
    )


def job_list() -> Routing:
    """Describe GET /v1/jobs."""
    link = {"Link": _header("The next page, rel=next (RFC 8288).")}
    return _route(
        "list_jobs",
        "List jobs",
        "One's own jobs, newest first.",
        {200: _answer("A page of jobs.", job_documents.JobList, link)},
        (400, 422, 500, 503),
    )


def job() -> Routing:
    """Describe GET /v1/jobs/{job}."""
    return _route(
        "get_job",
        "Look at a job",
        "With wait, answers once the job is final or the time is over; with since as well, once "
        "anything changed since that version.",
        {200: _answer("The job.", job_documents.Job)},
        _READ_PROBLEMS,
    )


def cancel() -> Routing:
    """Describe DELETE /v1/jobs/{job}."""
    return _route(
        "cancel_job",
        "Cancel a job",
        "A queued job is cancelled at once, a running one soon; a final one stays as it is.",
        {200: _answer("The job.", job_documents.Job)},
        _READ_PROBLEMS,
    )


def job_result() -> Routing:
    """Describe GET /v1/jobs/{job}/result."""
    return _route(
        "get_job_result",
        "Result of a job",
        "404 while there is none: not_ready, with Retry-After, or no_result where none will be.",
        {200: _results(*(kind.result for kind in KINDS.values())), 304: _NOT_MODIFIED},
        (*_READ_PROBLEMS, 406),
        headers=(_IF_NONE_MATCH,),
    )


def events() -> Routing:
    """Describe GET /v1/jobs/{job}/events."""
    job = {"$ref": _REF.format(model="Job")}
    event = {
        "id": {"type": "string"},
        "event": {"enum": ["job", "end"]},
        "data": {
            "type": "string",
            "contentMediaType": negotiate.JSON,
            "contentSchema": job,
        },
    }
    text = {"text/event-stream": {"schema": {"type": "object", "properties": event}}}
    return _route(
        "follow_job",
        "Follow a job",
        "Server-sent events: job at every change, end at the last one; data is the job, id the "
        "number of the change, after which Last-Event-ID goes on.",
        {200: {"description": "The events.", "content": text}},
        _READ_PROBLEMS,
        headers=(_LAST_EVENT_ID,),
    )


def result() -> Routing:
    """Describe GET /v1/results/{digest}."""
    part = {"application/x-hdf5": {"schema": _BINARY}, negotiate.JSON: {"schema": _BINARY}}
    return _route(
        "get_result",
        "Result by name",
        "Results never change: the name is a hash of the request and the version of the solvers.",
        {
            200: _results(*(kind.result for kind in KINDS.values())),
            206: {"description": "The bytes of Range.", "content": part},
            304: _NOT_MODIFIED,
        },
        (*_READ_PROBLEMS, 406, 416),
        headers=(_IF_NONE_MATCH, _RANGE),
    )


def store_system() -> Routing:
    """Describe POST /v1/systems."""
    example = {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]}
    shown = {"chain": {"summary": "A chain of 13 masses", "value": example}}
    located = {"Location": _header("Address of the system.")}
    return _route(
        "store_system",
        "Store a system",
        "By content: its id then stands wherever a system stands.",
        {
            201: _answer("It is new.", service_documents.StoredSystem, located),
            200: _answer("It was known.", service_documents.StoredSystem, located),
        },
        _BODY_PROBLEMS,
        body=_json_body("System", shown),
    )


def system() -> Routing:
    """Describe GET /v1/systems/{system}."""
    content = {negotiate.JSON: {"schema": {"$ref": _REF.format(model="System")}}}
    return _route(
        "get_system",
        "Stored system",
        "In its canonical form.",
        {200: {"description": "The system.", "content": content}, 304: _NOT_MODIFIED},
        _READ_PROBLEMS,
        headers=(_IF_NONE_MATCH,),
    )


def live() -> Routing:
    """Describe GET /v1/health/live."""
    answers = {200: _answer("It answers.", service_documents.Health)}
    return _route("health_live", "Liveness", "Whether the process answers.", answers, (500,))


def ready() -> Routing:
    """Describe GET /v1/health/ready."""
    answers = {200: _answer("It can.", service_documents.Health)}
    text = "Whether records, store and workers can take work now."
    return _route("health_ready", "Readiness", text, answers, (500, 503))


def version() -> Routing:
    """Describe GET /v1/version."""
    answers = {200: _answer("Versions, kinds and limits.", service_documents.Version)}
    text = "What the service is, what it can and what it accepts."
    return _route("version", "Version", text, answers, (500,))


def text(app: FastAPI) -> bytes:
    """Return the contract as JSON."""
    return orjson.dumps(document(app))


def document(app: FastAPI) -> dict[str, Any]:
    """Return the contract of an application."""
    if app.openapi_schema is None:
        contract = app.openapi()
        schemas = contract["components"]["schemas"]
        for name in ("HTTPValidationError", "ValidationError"):
            schemas.pop(name, None)
        schemas.update(_request_schemas())
        contract["components"]["schemas"] = dict(sorted(schemas.items()))
        for path in contract["paths"].values():
            for operation in path.values():
                _add_problems(operation)
    found: dict[str, Any] = app.openapi()
    return found


def _add_problems(operation: dict[str, Any]) -> None:
    answers = operation["responses"]
    # Parameters of a type make the framework announce a 422 of its own shape.
    answers.pop("422", None)
    for status in operation.pop("x-problems"):
        answers[str(status)] = {
            "description": problems.of_status(status).title + ".",
            "content": {problems.MEDIA_TYPE: {"schema": {"$ref": _REF.format(model="Problem")}}},
        }
    operation["responses"] = dict(sorted(answers.items()))


def _request_schemas() -> dict[str, Any]:
    requests: list[type[BaseModel]] = [kind.request for kind in KINDS.values()]
    models: list[type[BaseModel]] = [*requests, JobRequest, Problem]
    _, found = models_json_schema([(m, "validation") for m in models], ref_template=_REF)
    schemas: dict[str, Any] = found["$defs"]
    adapter = TypeAdapter[Any](System)
    schema = adapter.json_schema(ref_template=_REF)
    schemas |= schema.pop("$defs")
    schemas["System"] = {"title": "System", **schema}
    choices = [{"$ref": _REF.format(model=model.__name__)} for model in requests]
    schemas["JobRequest"]["properties"]["request"] |= {"anyOf": choices}
    schemas["JobRequest"]["properties"]["kind"] |= {"enum": list(KINDS)}
    return schemas


def _route(
    operation: str,
    summary: str,
    description: str,
    answers: Mapping[int, Mapping[str, Any]],
    refusals: Sequence[int],
    body: Mapping[str, Any] | None = None,
    headers: Sequence[Mapping[str, Any]] = (),
) -> Routing:
    extra: dict[str, Any] = {"x-problems": sorted(refusals)}
    if body is not None:
        extra["requestBody"] = body
    if headers:
        extra["parameters"] = list(headers)
    return {
        "operation_id": operation,
        "summary": summary,
        "description": description,
        "responses": {status: dict(answer) for status, answer in answers.items()},
        "status_code": min(answers),
        "response_model": None,
        "response_class": JSONResponse,
        "openapi_extra": extra,
    }


def _answer(
    description: str, model: type[BaseModel], headers: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    return {"description": description, "model": model, "headers": dict(headers or {})}


def _results(*models: type[BaseModel]) -> dict[str, Any]:
    union: Any = models[0]
    for model in models[1:]:
        union = union | model
    return {
        "description": "The result.",
        "model": union,
        "content": {negotiate.HDF5: {"schema": _BINARY}},
        "headers": _RESULT_HEADERS,
    }


def _request_of(kind: Kind) -> dict[str, Any]:
    shown = {
        name: {"summary": example["summary"], "value": example["request"]}
        for name, example in examples.requests(kind.name).items()
    }
    return _json_body(kind.request.__name__, shown)


def _json_body(schema: str, shown: Mapping[str, Any]) -> dict[str, Any]:
    reference = {"$ref": _REF.format(model=schema)}
    content = {negotiate.JSON: {"schema": reference, "examples": dict(shown)}}
    return {"required": True, "content": content}


def _header(description: str) -> dict[str, Any]:
    return {"description": description, "schema": {"type": "string"}}


def _parameter(name: str, description: str, **schema: Any) -> dict[str, Any]:
    return {
        "name": name,
        "in": "header",
        "required": False,
        "description": description,
        "schema": {"type": "string", **schema},
    }


_BINARY: Final = {"type": "string", "format": "binary"}
_NOT_MODIFIED: Final = {"description": "The caller has it: If-None-Match names it."}
_PREFER: Final = _parameter(
    "Prefer",
    "respond-async: answer with a job. wait=N: wait so many seconds, 20 at most, before that.",
    examples=["respond-async, wait=5"],
)
_IF_NONE_MATCH: Final = _parameter("If-None-Match", "Entity tags of what the caller has.")
_IDEMPOTENCY_KEY: Final = _parameter(
    "Idempotency-Key",
    "Repeating the request with the same key answers with the same job.",
    pattern="^[!-~]{1,255}$",
)
_LAST_EVENT_ID: Final = _parameter("Last-Event-ID", "Number of the last change that was seen.")
_RANGE: Final = _parameter("Range", "Part of the representation.", examples=["bytes=0-1023"])
_JOB_HEADERS: Final = {"Location": _header("Address of the job.")}
_RESULT_HEADERS: Final = {
    "ETag": _header("Strong entity tag: hash of the representation."),
    "Content-Location": _header("Address of the result."),
    "Cache-Status": _header("Whether anything was computed (RFC 9211)."),
    "Repr-Digest": _header("SHA-256 of the representation (RFC 9530)."),
    "Server-Timing": _header("Milliseconds for plan, solve and encode."),
}
