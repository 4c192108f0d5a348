"""What routes have in common: reading a body, who asks, answering with a document or a result."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Mapping
from typing import Final, TypeVar

from pydantic import BaseModel
from starlette.requests import Request
from starlette.responses import Response

from vibroimpact_service import negotiate, problems
from vibroimpact_service.evaluate import Evaluation
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.representations import SUFFIXES, Representation
from vibroimpact_service.settings import Settings

Value = TypeVar("Value")

OWNER: Final = "local"
"""Whose everything is, as long as there are no keys."""

_KEY = re.compile(r"[!-~]{1,255}")
IMMUTABLE: Final = "private, max-age=31536000, immutable"


def evaluation(request: Request) -> Evaluation:
    """Return the use case of the application that serves a request."""
    found: Evaluation = request.app.state.evaluation
    return found


def settings(request: Request) -> Settings:
    """Return the settings of the application that serves a request."""
    found: Settings = request.app.state.settings
    return found


async def unless_draining(request: Request, waiting: Awaitable[Value | None]) -> Value | None:
    """Return what an awaitable returns, or None once the service is told to stop."""
    drain: asyncio.Event = request.app.state.drain
    work, stop = asyncio.ensure_future(waiting), asyncio.ensure_future(drain.wait())
    try:
        await asyncio.wait({work, stop}, return_when=asyncio.FIRST_COMPLETED)
        return work.result() if work.done() else None
    finally:
        stop.cancel()
        if not work.done():
            work.cancel()


async def read_json(request: Request) -> bytes:
    """Return the bytes of a JSON body, never more than the limit.

    Raises
    ------
    ProblemError
        413 or 415.
    """
    media_type, _, parameters = request.headers.get("content-type", "").partition(";")
    charset = parameters.partition("charset=")[2].strip().strip('"').lower()
    if media_type.strip().lower() != negotiate.JSON or charset not in ("", "utf-8"):
        detail = "The body must be application/json in UTF-8."
        raise ProblemError(
            problems.UNSUPPORTED_MEDIA_TYPE, detail, headers={"Accept": "application/json"}
        )
    if request.headers.get("content-encoding", "identity").strip().lower() != "identity":
        detail = "The body must not be compressed."
        headers = {"Accept-Encoding": "identity"}
        raise ProblemError(problems.UNSUPPORTED_MEDIA_TYPE, detail, headers=headers)
    return await _read(request, settings(request).max_body_bytes)


async def _read(request: Request, limit: int) -> bytes:
    claimed = request.headers.get("content-length", "0")
    if claimed.isdigit() and (len(claimed) > 18 or int(claimed) > limit):
        raise _too_long(limit)
    parts, size = [], 0
    async for part in request.stream():
        size += len(part)
        if size > limit:
            raise _too_long(limit)
        parts.append(part)
    return b"".join(parts)


def _too_long(limit: int) -> ProblemError:
    return problems.too_large("", "body_too_long", f"The body is longer than {limit} bytes.")


def wanted_representation(request: Request) -> str:
    """Return the media type of a result that Accept asks for.

    Raises
    ------
    ProblemError
        406 where none fits.
    """
    accept = ", ".join(request.headers.getlist("accept"))
    found = negotiate.representation(accept)
    if found is None:
        detail = f"Results are {' or '.join(negotiate.REPRESENTATIONS)}."
        raise ProblemError(problems.NOT_ACCEPTABLE, detail)
    return found


def idempotency_key(request: Request) -> str | None:
    """Return the Idempotency-Key of a request, if it has one.

    Raises
    ------
    ProblemError
        400 where it is not one.
    """
    given = request.headers.get("idempotency-key")
    if given is None:
        return None
    key = given.strip().strip('"')
    if not _KEY.fullmatch(key):
        detail = "Idempotency-Key must be 1 to 255 visible ASCII characters."
        raise ProblemError(problems.BAD_REQUEST, detail)
    return key


def document(
    content: BaseModel, status: int = 200, headers: Mapping[str, str] | None = None
) -> Response:
    """Answer with a document."""
    return Response(
        content.model_dump_json(), status, headers=dict(headers or {}), media_type=negotiate.JSON
    )


def result(
    request: Request, name: str, found: Representation, headers: Mapping[str, str] | None = None
) -> Response:
    """Answer with a stored result: all of it, or 304 where the caller has it."""
    about = {
        "ETag": found.etag,
        "Vary": "Accept",
        "Cache-Control": IMMUTABLE,
        "Content-Location": f"/v1/results/{name}",
        **(headers or {}),
    }
    known = request.headers.get("if-none-match")
    if known is not None and negotiate.names(known, found.etag):
        return Response(status_code=304, headers=about)
    about |= {
        "Repr-Digest": negotiate.repr_digest(found.sha256),
        "Accept-Ranges": "bytes",
    }
    if found.media_type == negotiate.HDF5:
        file_name = f"{name[:16]}.{SUFFIXES[found.media_type]}"
        about["Content-Disposition"] = f'attachment; filename="{file_name}"'
    return Response(found.data, headers=about, media_type=found.media_type)
