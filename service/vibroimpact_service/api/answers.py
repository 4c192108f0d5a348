"""Answering with documents and results: representation, conditions, ranges."""

from __future__ import annotations

import asyncio
import base64
import math
import os
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Final

from pydantic import BaseModel
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from vibroimpact_service import problems
from vibroimpact_service.api import request_headers
from vibroimpact_service.api.route import services
from vibroimpact_service.documents import digest
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results.encoders import JSON
from vibroimpact_service.results.representations import Representation, encoder
from vibroimpact_service.store import HEAD

IMMUTABLE: Final = "private, max-age=31536000, immutable"
_PIECE: Final = 2**19
"""Bytes of a file that are read at a time."""


def document(
    content: BaseModel, status: int = 200, headers: Mapping[str, str] | None = None
) -> Response:
    """Answer with a document."""
    return Response(content.model_dump_json(), status, headers=dict(headers or {}), media_type=JSON)


async def tagged(
    request: Request, data: bytes, media_type: str, headers: Mapping[str, str]
) -> Response:
    """Answer with some bytes and their entity tag, or 304 where the caller has them.

    Raises
    ------
    ProblemError
        412 where If-Match names other ones.
    """
    made = Representation(media_type, data, digest.content(data))
    made = await _coded(request, made.sha256, made)
    fields = {"ETag": made.etag, "Vary": "Accept-Encoding", **headers}
    if made.coding is not None:
        fields["Content-Encoding"] = made.coding
    request_headers.check_match(request.headers.get("if-match"), made.etag)
    if request_headers.is_known(request.headers.get("if-none-match"), made.etag):
        return Response(status_code=304, headers=fields)
    return Response(made.data, headers=fields, media_type=media_type)


async def _coded(request: Request, name: str, plain: Representation) -> Representation:
    """Return a representation in the content coding that the caller prefers."""
    coding = request_headers.coding(request.headers.get("accept-encoding"))
    if coding is None:
        return plain
    return await services(request).evaluation.results.coded(name, plain, coding)


async def result(
    request: Request, name: str, stored: Representation, headers: Mapping[str, str] | None = None
) -> Response:
    """Answer with a stored result: all of it, a range, or 304 where the caller has it.

    Raises
    ------
    ProblemError
        412 where If-Match names another one, 416 where the range lies beyond the end.
    """
    sent = request.headers
    # Ranges count the bytes of the file, not of a coding that could be another one next time.
    wanted = sent.get("range") if request.scope["method"] == "GET" else None
    if wanted is None:
        stored = await _coded(request, name, stored)
    fields = {
        "ETag": stored.etag,
        "Vary": "Accept, Accept-Encoding",
        "Cache-Control": IMMUTABLE,
        "Content-Location": f"/v1/results/{name}",
        **(headers or {}),
    }
    request_headers.check_match(sent.get("if-match"), stored.etag)
    if request_headers.is_known(sent.get("if-none-match"), stored.etag):
        return Response(status_code=304, headers=fields)
    fields |= {
        "Repr-Digest": repr_digest(stored.sha256),
        "Accept-Ranges": "bytes",
    }
    if stored.coding is not None:
        fields["Content-Encoding"] = stored.coding
    how = encoder(stored.media_type)
    if how.binary:
        file_name = f"{name[:16]}.{how.suffix}"
        fields["Content-Disposition"] = f'attachment; filename="{file_name}"'
    part = None if wanted is None else _part(wanted, sent.get("if-range"), stored)
    first, stop = part or (0, stored.size)
    if part is not None:
        fields["Content-Range"] = f"bytes {first}-{stop - 1}/{stored.size}"
    status, media_type = 206 if part else 200, stored.media_type.partition(";")[0]
    if stored.file is None:
        data = stored.data[first:stop] if part else stored.data
        return Response(data, status, fields, media_type)
    fields["Content-Length"] = str(stop - first)
    if request.state.head:
        return Response(None, status, fields, media_type)
    pieces = _pieces(stored.file, HEAD + first, HEAD + stop)
    return StreamingResponse(pieces, status, fields, media_type)


def _part(wanted: str, condition: str | None, stored: Representation) -> tuple[int, int] | None:
    """Return the range of bytes to answer with, or None for all (RFC 9110, 13.1.5, 14.2)."""
    if condition is not None and condition.strip() != stored.etag:
        return None
    try:
        return request_headers.byte_range(wanted, stored.size)
    except request_headers.UnsatisfiableRangeError:
        headers = {"Content-Range": f"bytes */{stored.size}"}
        detail = f"The result has {stored.size} bytes."
        raise ProblemError(problems.RANGE_NOT_SATISFIABLE, detail, headers=headers) from None


async def _pieces(path: Path, start: int, stop: int) -> AsyncIterator[bytes]:
    """Yield the bytes of a file from start to stop."""
    with path.open("rb", buffering=0) as file:
        while start < stop:
            size = min(_PIECE, stop - start)
            piece = await asyncio.to_thread(os.pread, file.fileno(), size, start)
            if not piece:
                return  # it was cut; the missing length tells the caller
            start += len(piece)
            yield piece


def repr_digest(sha256: str) -> str:
    """Return the value of Repr-Digest (RFC 9530)."""
    return f"sha-256=:{base64.b64encode(bytes.fromhex(sha256)).decode()}:"


def server_timing(seconds: Mapping[str, float]) -> str:
    """Return the value of Server-Timing from durations in seconds."""
    return ", ".join(
        f"{name};dur={1e3 * value:.3f}" for name, value in seconds.items() if math.isfinite(value)
    )
