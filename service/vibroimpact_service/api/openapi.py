"""What the routes' OpenAPI declarations share, and the document that FastAPI generates of them.

Each route declares its own parameters, answers and examples at its decorator.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any, Final

from fastapi import FastAPI, Path
from pydantic import BaseModel, TypeAdapter
from pydantic.json_schema import models_json_schema

from vibroimpact_schema import examples
from vibroimpact_schema.jobs import RetryRequest, ShareRequest
from vibroimpact_schema.keys import KeyRequest
from vibroimpact_schema.problems import Problem
from vibroimpact_schema.submissions import BatchRequest, JobRequest
from vibroimpact_schema.systems import System
from vibroimpact_service import problems
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results.encoders import ENCODERS, JSON

Declaration = dict[str, Any]

BINARY: Final = {"type": "string", "format": "binary"}
_REF: Final = "#/components/schemas/{model}"


def header(description: str) -> Declaration:
    """Return the declaration of a response header."""
    return {"description": description, "schema": {"type": "string"}}


def request_header(name: str, description: str, **schema: Any) -> Declaration:
    """Return the declaration of an optional request header that the handler reads itself."""
    about = {"required": False, "description": description}
    return {"name": name, "in": "header", **about, "schema": {"type": "string", **schema}}


def path_id(description: str, example: str, form: re.Pattern[str]) -> Any:
    """Return the declaration of an id in a path, which the handler checks: 404, and not 422."""
    pattern = {"pattern": f"^{form.pattern}$"}
    return Path(description=description, examples=[example], json_schema_extra=pattern)


_RATES: Final = {
    "RateLimit": header("What is left of the rates and quotas of the key (RFC 9331 draft)."),
    "RateLimit-Policy": header("The rates and quotas of the key."),
}
IF_NONE_MATCH: Final = request_header("If-None-Match", "Entity tags that the client holds.")
OF_RESULTS: Final = [
    {
        "name": parameter.name,
        "in": "query",
        "required": False,
        "description": parameter.about,
        "schema": {"type": "string"},
    }
    for parameter in (encoder.parameter for encoder in ENCODERS.values())
    if parameter is not None
]
"""Parameters of routes that answer with results."""
IDEMPOTENCY_KEY: Final = request_header(
    "Idempotency-Key",
    "Repeating the request with the same key answers with the same job.",
    pattern="^[!-~]{1,255}$",
)
REQUEST_ID: Final = request_header(
    "X-Request-ID",
    "Name of this request in the answer, in problems and in the log, of letters, digits, '.', '_' "
    "and '-'; others are replaced.",
)


def answer(
    description: str,
    model: Any = None,
    *,
    headers: Mapping[str, Declaration] | None = None,
    links: Mapping[str, Mapping[str, str]] | None = None,
    content: Mapping[str, Declaration] | None = None,
    rated: bool = True,
) -> Declaration:
    """Return the declaration of a successful answer.

    Parameters
    ----------
    links : mapping, optional
        Operations that can follow, each with where its path parameters come from.
    content : mapping, optional
        Media types beside the JSON of the model.
    rated : bool
        Whether the answer carries the rate-limit headers: those of routes that need a key do.
    """
    declared: Declaration = {"description": description}
    declared["headers"] = {**(headers or {}), **(_RATES if rated else {})}
    if model is not None:
        declared["model"] = model
    if content:
        declared["content"] = dict(content)
    if links:
        declared["links"] = {
            operation: {"operationId": operation, "parameters": dict(parameters)}
            for operation, parameters in links.items()
        }
    return declared


def not_modified(description: str = "The client holds it: If-None-Match names it.") -> Declaration:
    """Return the declaration of an answer 304."""
    return answer(description)


def failures(*statuses: int) -> dict[int | str, Declaration]:
    """Return the declarations of answers by problem documents."""
    declared: dict[int | str, Declaration] = {}
    for status in statuses:
        problem = problems.of_status(status)
        example = ProblemError(problem, problem.about).document("6f1c0d").model_dump(mode="json")
        schema = {"$ref": _REF.format(model=Problem.__name__)}
        content = {problems.MEDIA_TYPE: {"schema": schema, "example": example}}
        declared[status] = {"description": f"{problem.title}.", "content": content}
    return declared


BODY_FAILURES: Final = failures(400, 408, 413, 415, 422, 500, 503)
"""Problems of routes that read a body."""
READ_FAILURES: Final = failures(400, 404, 422, 500, 503)
"""Problems of routes that look something up."""


def json_body(
    model: str, shown: Mapping[str, Any], others: Mapping[str, Declaration] | None = None
) -> Declaration:
    """Return the declaration of a JSON request body that the handler reads itself.

    It has a schema of `_request_schemas`, examples by name ({"summary", "value"}), and perhaps
    further media types.
    """
    content = {"schema": {"$ref": _REF.format(model=model)}, "examples": dict(shown)}
    return {"required": True, "content": {JSON: content, **(others or {})}}


def document(app: FastAPI) -> dict[str, Any]:
    """Return the OpenAPI document of an application.

    FastAPI generates it; what it cannot know is added: the schemas of the bodies that handlers
    read themselves, the examples of ``openapi/examples``, and that a service without keys
    answers without one. Optional parameters lose the type null, which no address can hold.
    """
    if app.openapi_schema is None:
        generated = app.openapi()
        schemas = generated["components"]["schemas"] | _request_schemas()
        generated["components"]["schemas"] = dict(sorted(schemas.items()))
        for operations in generated["paths"].values():
            for operation in operations.values():
                operation["responses"] = dict(sorted(operation["responses"].items()))
                for parameter in operation.get("parameters", ()):
                    _drop_null(parameter["schema"])
                for status, example in examples.answers(operation["operationId"]).items():
                    content = operation["responses"][status]["content"]
                    for media_type in content.keys() - (ENCODERS.keys() - {JSON}):
                        content[media_type]["example"] = example
                if "security" in operation:
                    operation["security"].append({})
    return app.openapi()


def _drop_null(schema: dict[str, Any]) -> None:
    for choice in schema.pop("anyOf", ()):
        if choice != {"type": "null"}:
            schema.update(choice)


def _request_schemas() -> dict[str, Any]:
    requests: list[type[BaseModel]] = [kind.request for kind in KINDS.values()]
    models: list[type[BaseModel]] = [
        *requests,
        BatchRequest,
        JobRequest,
        KeyRequest,
        RetryRequest,
        ShareRequest,
        Problem,
    ]
    _, generated = models_json_schema([(m, "validation") for m in models], ref_template=_REF)
    schemas: dict[str, Any] = generated["$defs"]
    system = TypeAdapter[Any](System).json_schema(ref_template=_REF)
    schemas |= system.pop("$defs")
    schemas["System"] = {"title": "System", **system}
    choices = [{"$ref": _REF.format(model=model.__name__)} for model in requests]
    schemas["JobRequest"]["properties"]["request"] |= {"anyOf": choices}
    schemas["BatchRequest"]["properties"]["requests"]["items"] = {"anyOf": choices}
    for envelope in ("JobRequest", "BatchRequest"):
        schemas[envelope]["properties"]["kind"] |= {"enum": list(KINDS)}
    for schema in schemas.values():
        for field in schema.get("properties", {}).values():
            _tell_default(field)
    return schemas


def _tell_default(field: dict[str, Any]) -> None:
    """Say in words what an optional field of a request is by default.

    Generators of clients take fields with a ``default`` for fields that are always there, and would
    ask for them in requests.
    """
    default = field.pop("default", None)
    if default is not None:
        said = f"Default: {json.dumps(default)}."
        field["description"] = f"{field['description']} {said}" if "description" in field else said
