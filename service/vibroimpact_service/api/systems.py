"""/v1/systems: stored systems, so that a large matrix is sent once."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Final

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_schema.service import StoredSystem
from vibroimpact_service import problems
from vibroimpact_service.api import answers, bodies, openapi
from vibroimpact_service.api.route import FAILURES, READ, SUBMIT, owner, services
from vibroimpact_service.documents import digest, stored_systems
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results.encoders import JSON

router = APIRouter(tags=["systems"], responses=FAILURES)

_SYSTEM = re.compile(r"sys_[0-9a-f]{64}")
SystemId = Annotated[str, openapi.path_id("Id of a system.", "sys_" + "0" * 64, _SYSTEM)]

_CHAIN: Final = {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]}
_MATRIX_MARKET: Final = (
    "%%MatrixMarket matrix coordinate real symmetric\n2 2 3\n1 1 2.0\n2 1 -1.0\n2 2 2.0\n"
)


def _file(description: str) -> openapi.Declaration:
    return {**openapi.BINARY, "description": description}


_FILES: Final[Mapping[str, openapi.Declaration]] = {
    "application/x-matrix-market": {
        "schema": {
            "type": "string",
            "description": "K alone (masses 1), M and K, or M, K and C, one text after another.",
        },
        "examples": {"K": {"summary": "Stiffness of two masses", "value": _MATRIX_MARKET}},
    },
    "application/x-npy": {
        "schema": {
            **openapi.BINARY,
            "description": "float64 of shape (n, n): K; (2, n, n): M and K; (3, n, n): M, K and C.",
        }
    },
    stored_systems.MULTIPART: {
        "schema": {
            "type": "object",
            "description": "Files of other programs as they are; how their names end tells the "
            "format, see Structures. Unpacked, they have at most as many bytes as a body. Masses "
            "are 1 where there are none.",
            "properties": {
                **{name: _file(f"File of the matrix {name}.") for name in ("M", "K", "C")},
                "file": {
                    "type": "array",
                    "items": _file("A file."),
                    "description": "Files of several matrices, or whose names tell which they "
                    "have, and the .dof or .mapping beside one.",
                },
            },
            "additionalProperties": False,
        }
    },
}


def _stored(description: str) -> openapi.Declaration:
    located = {"Location": openapi.header("Address of the system.")}
    links = {"get_system": {"system": "$response.body#/id"}}
    return openapi.answer(description, StoredSystem, headers=located, links=links)


@router.post(
    "/v1/systems",
    operation_id="store_system",
    summary="Store a system",
    dependencies=[SUBMIT],
    responses={
        200: _stored("The system was stored already."),
        201: _stored("The system is stored."),
        **openapi.BODY_FAILURES,
    },
    openapi_extra={
        # openapi-python-client takes bodies of several types for optional, and only imports what
        # it then needs where a parameter is.
        "parameters": [openapi.REQUEST_ID],
        "requestBody": openapi.json_body(
            "System", {"chain": {"summary": "A chain of 13 masses", "value": _CHAIN}}, _FILES
        ),
    },
)
async def store_system(request: Request) -> Response:
    """Store a system: its id, a hash of the content, can then be used in its place."""
    media_type, body = await bodies.read_body(request, stored_systems.MEDIA_TYPES)
    packed = media_type == stored_systems.MULTIPART
    content_type = request.headers["content-type"] if packed else media_type
    evaluation, settings = services(request).evaluation, services(request).settings
    stored, new = await evaluation.threads.parse(
        body,
        lambda: stored_systems.put(evaluation.store, settings, owner(request), content_type, body),
        packed=packed,
    )
    headers = {"Location": f"/v1/systems/{stored.id}"}
    return answers.document(stored, 201 if new else 200, headers)


@router.get(
    "/v1/systems/{system}",
    operation_id="get_system",
    summary="Stored system",
    dependencies=[READ],
    responses={
        200: openapi.answer(
            "The system.",
            content={JSON: {"schema": {"$ref": "#/components/schemas/System"}}},
        ),
        304: openapi.not_modified(),
        **openapi.READ_FAILURES,
    },
    openapi_extra={"parameters": [openapi.IF_NONE_MATCH]},
)
async def get_system(request: Request, system: SystemId) -> Response:
    """In its canonical form."""
    data = None
    if _SYSTEM.fullmatch(system) and digest.owned(owner(request), system):
        evaluation = services(request).evaluation
        data = await evaluation.threads.run(lambda: evaluation.store.systems.get(system))
    if data is None:
        raise ProblemError(problems.NOT_FOUND, "There is no such system.")
    headers = {"Cache-Control": answers.IMMUTABLE}
    return await answers.tagged(request, data, JSON, headers)
