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
from vibroimpact_schema import keys as key_documents
from vibroimpact_schema import results as result_documents
from vibroimpact_schema import service as service_documents
from vibroimpact_schema.problems import Problem
from vibroimpact_schema.requests import BatchRequest, JobRequest
from vibroimpact_schema.systems import System
from vibroimpact_service import negotiate, problems
from vibroimpact_service.access.caller import Scope
from vibroimpact_service.api import guard
from vibroimpact_service.api.lifecycle import DEPRECATED
from vibroimpact_service.kinds import KINDS, Kind
from vibroimpact_service.problems import ProblemError

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
_CALLER_PROBLEMS = (401, 403, 421, 429)
_BODY_PROBLEMS = (400, 408, 413, 415, 422, 500, 503)
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


def batch() -> Routing:
    """Describe POST /v1/batch."""
    shown = {
        "impact-modes": {
            "summary": "The same chain at two frequencies",
            "value": {
                "kind": "impact-modes",
                "requests": [
                    {
                        "system": {
                            "preset": "chain",
                            "n": 13,
                            "constraints": [{"dof": 5, "gap": 0.2}],
                        },
                        "frequency": {"values": [frequency]},
                        "outputs": ["impulse"],
                    }
                    for frequency in (1.0, 2.0)
                ],
            },
        }
    }
    return _route(
        "compute_batch",
        "Many tiny computations at once",
        "Each request is answered by its result or its problem, in the same order. Nothing is "
        "stored; GET /v1/version tells how many there may be, and larger work is a job.",
        {200: _answer("The answers.", result_documents.BatchAnswers)},
        _BODY_PROBLEMS,
        body=_json_body("BatchRequest", shown),
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


def share() -> Routing:
    """Describe GET /v1/jobs/{job}/share."""
    return _route(
        "get_share",
        "Who else may see a job",
        "Only its owner is told.",
        {200: _answer("Its readers.", job_documents.Share)},
        _READ_PROBLEMS,
    )


def set_share() -> Routing:
    """Describe PUT /v1/jobs/{job}/share."""
    shown = {"bob": {"summary": "A colleague", "value": {"readers": ["carol"]}}}
    return _route(
        "share_job",
        "Let others see a job",
        "Exactly those named may from now on look at the job, follow it and take its result; "
        "only its owner may cancel or share it. Noted among the administrative acts.",
        {200: _answer("Its readers.", job_documents.Share)},
        (*_BODY_PROBLEMS, 404),
        body=_json_body("ShareRequest", shown),
    )


def end_share() -> Routing:
    """Describe DELETE /v1/jobs/{job}/share."""
    return _route(
        "unshare_job",
        "Let nobody else see a job",
        "Its owner alone sees it again.",
        {200: _answer("Its readers: none.", job_documents.Share)},
        _READ_PROBLEMS,
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
        body=_system_body(shown),
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


def key_list() -> Routing:
    """Describe GET /v1/keys."""
    answers = {200: _answer("All keys.", key_documents.KeyList)}
    text = "Their secrets are not kept and cannot be shown."
    return _route("list_keys", "List API keys", text, answers, (404, 500, 503))


def make_key() -> Routing:
    """Describe POST /v1/keys."""
    example = {"owner": "ann", "label": "laptop", "scopes": ["read", "submit"], "days": 365}
    shown = {"laptop": {"summary": "A key for a year", "value": example}}
    return _route(
        "make_key",
        "Make an API key",
        "The answer shows the key itself, this once.",
        {201: _answer("The key.", key_documents.MadeKey)},
        (*_BODY_PROBLEMS, 404),
        body=_json_body("KeyRequest", shown),
    )


def revoke_key() -> Routing:
    """Describe DELETE /v1/keys/{key}."""
    answers = {200: _answer("The key.", key_documents.ApiKey)}
    text = "It is refused from now on. Jobs and results of its owner stay."
    return _route("revoke_key", "Revoke an API key", text, answers, _READ_PROBLEMS)


def audit() -> Routing:
    """Describe GET /v1/audit."""
    answers = {200: _answer("A page of acts.", key_documents.ActList)}
    text = "Who made and revoked which keys, newest first."
    return _route("list_acts", "Administrative acts", text, answers, _READ_PROBLEMS)


def metrics() -> Routing:
    """Describe GET /metrics."""
    content = {"text/plain": {"schema": {"type": "string"}}}
    answers = {200: {"description": "The figures.", "content": content}}
    text = "Requests, queue, workers, cache and solve times, in the format of Prometheus."
    return _route("metrics", "The service's own figures", text, answers, (500, 503))


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
        contract["components"]["securitySchemes"] = {"key": _KEY_SCHEME}
        for path, operations in contract["paths"].items():
            for method, operation in operations.items():
                _add_access(operation, guard.rule(method.upper(), path))
                if (method.upper(), path) in DEPRECATED:
                    operation["deprecated"] = True
                _add_problems(operation)
                _describe_parameters(operation)
                _add_examples(operation)
                _add_links(operation)
    found: dict[str, Any] = app.openapi()
    return found


def _add_access(operation: dict[str, Any], scope: Scope | None) -> None:
    if scope is None:
        return
    operation["security"] = [{"key": [scope.value]}, {}]
    operation["x-problems"] = sorted({*operation["x-problems"], *_CALLER_PROBLEMS})
    for answer in operation["responses"].values():
        answer.setdefault("headers", {}).update(_RATE_HEADERS)


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


def _describe_parameters(operation: dict[str, Any]) -> None:
    for parameter in operation.get("parameters", ()):
        if parameter["in"] == "path":
            parameter |= _PATHS[parameter["name"]]
        elif parameter["in"] == "query":
            # What is absent is absent; an address cannot hold null.
            schema = parameter["schema"]
            (given,) = [s for s in schema.pop("anyOf", [{}]) if s.get("type") != "null"]
            schema.update(given)


def _add_examples(operation: dict[str, Any]) -> None:
    shown = examples.answers(operation["operationId"])
    for status, answer in operation["responses"].items():
        for media_type, content in answer.get("content", {}).items():
            if media_type == problems.MEDIA_TYPE:
                type_ = problems.of_status(int(status))
                problem = ProblemError(type_, type_.about).document("6f1c0d")
                content["example"] = problem.model_dump(mode="json")
            elif status in shown and media_type != negotiate.HDF5:
                content["example"] = shown[status]


def _add_links(operation: dict[str, Any]) -> None:
    for status, links in _LINKS.get(operation["operationId"], {}).items():
        for target, parameters in links.items():
            link = {"operationId": target, "parameters": parameters}
            operation["responses"][status].setdefault("links", {})[target] = link


def _request_schemas() -> dict[str, Any]:
    requests: list[type[BaseModel]] = [kind.request for kind in KINDS.values()]
    models: list[type[BaseModel]] = [*requests, BatchRequest, JobRequest]
    models += [key_documents.KeyRequest, job_documents.ShareRequest, Problem]
    _, found = models_json_schema([(m, "validation") for m in models], ref_template=_REF)
    schemas: dict[str, Any] = found["$defs"]
    adapter = TypeAdapter[Any](System)
    schema = adapter.json_schema(ref_template=_REF)
    schemas |= schema.pop("$defs")
    schemas["System"] = {"title": "System", **schema}
    choices = [{"$ref": _REF.format(model=model.__name__)} for model in requests]
    schemas["JobRequest"]["properties"]["request"] |= {"anyOf": choices}
    schemas["JobRequest"]["properties"]["kind"] |= {"enum": list(KINDS)}
    schemas["BatchRequest"]["properties"]["requests"]["items"] = {"anyOf": choices}
    schemas["BatchRequest"]["properties"]["kind"] |= {"enum": list(KINDS)}
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


def _system_body(shown: Mapping[str, Any]) -> dict[str, Any]:
    body = _json_body("System", shown)
    market = "%%MatrixMarket matrix coordinate real symmetric\n2 2 3\n1 1 2.0\n2 1 -1.0\n2 2 2.0\n"
    about = "K alone (masses 1), M and K, or M, K and C, one text after another."
    body["content"]["application/x-matrix-market"] = {
        "schema": {"type": "string", "description": about},
        "examples": {"K": {"summary": "Stiffness of two masses", "value": market}},
    }
    about = "float64 of shape (n, n): K; (2, n, n): M and K; (3, n, n): M, K and C."
    body["content"]["application/x-npy"] = {"schema": {**_BINARY, "description": about}}
    return body


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


_KEY_SCHEME: Final = {
    "type": "http",
    "scheme": "bearer",
    "description": "An API key (vik_…) or a token of the OpenID Connect issuer that the service "
    "trusts. A service on a loopback address without keys needs none.",
}
_RATE_HEADERS: Final = {
    "RateLimit": _header("What is left of the rates and quotas of a key."),
    "RateLimit-Policy": _header("The rates and quotas of a key."),
}
_PATHS: Final = {
    "job": {
        "description": "Id of a job.",
        "schema": {"type": "string", "pattern": "^job_[0-9a-f]{32}$"},
        "example": "job_00000000000000000000000000000000",
    },
    "digest": {
        "description": "Name of a result.",
        "schema": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
        "example": "0" * 64,
    },
    "system": {
        "description": "Id of a system.",
        "schema": {"type": "string", "pattern": "^sys_[0-9a-f]{64}$"},
        "example": "sys_" + "0" * 64,
    },
    "key": {
        "description": "Id of a key.",
        "schema": {"type": "string", "pattern": "^[0-9a-f]{12}$"},
        "example": "0" * 12,
    },
}
_OF_JOB: Final = {
    operation: {"job": "$response.body#/id"}
    for operation in (
        "get_job",
        "cancel_job",
        "get_job_result",
        "follow_job",
        "get_share",
        "share_job",
        "unshare_job",
    )
}
_LINKS: Final[Mapping[str, Mapping[str, Mapping[str, Mapping[str, str]]]]] = {
    "submit_job": {"201": _OF_JOB},
    **{
        f"compute_{kind.decoder}": {
            "200": {"get_result": {"digest": "$response.body#/digest"}},
            "202": _OF_JOB,
        }
        for kind in KINDS.values()
    },
    "get_job": {"200": {"get_result": {"digest": "$response.body#/digest"}}},
    "store_system": {
        status: {"get_system": {"system": "$response.body#/id"}} for status in ("200", "201")
    },
    "make_key": {"201": {"revoke_key": {"key": "$response.body#/id"}}},
}
"""Operation -> status -> what can be asked next, and from where its parameters come."""

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
