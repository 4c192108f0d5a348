"""What routes have in common: reading a body, who asks, answering with a document or a result."""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import AsyncIterator, Awaitable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final, TypeVar

from pydantic import BaseModel
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from vibroimpact_service import negotiate, problems
from vibroimpact_service.access.budget import Budget
from vibroimpact_service.api import guard
from vibroimpact_service.evaluate import Admit, Evaluation
from vibroimpact_service.negotiate import UnsatisfiableRangeError
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.representations import SUFFIXES, Representation
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import HEAD
from vibroimpact_solvers.plan import Plan

Value = TypeVar("Value")

_PIECE: Final = 2**19
"""Bytes of a file that are read at a time."""
_SLOWEST: Final = 4096
"""Bytes per second that a body must reach on the average."""

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


def owner(request: Request) -> str:
    """Return whose jobs, results and systems a request is about."""
    return guard.caller(request).owner


def spending(request: Request) -> Admit:
    """Return what charges a computation to whoever asks."""
    budget: Budget = request.app.state.budget

    async def spend(plan: Plan, seconds: float) -> None:
        left = await budget.spend(guard.caller(request), plan, seconds)
        more: dict[str, str] = request.state.more_headers
        for name, value in left.items():
            more[name] = f"{more[name]}, {value}" if name in more else value

    return spend


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
    _, body = await read_body(request, (negotiate.JSON,))
    return body


async def read_body(request: Request, media_types: Sequence[str]) -> tuple[str, bytes]:
    """Return the media type of a body, one of those accepted, and its bytes.

    Raises
    ------
    ProblemError
        408, 413, 415 or 503.
    """
    given, _, parameters = request.headers.get("content-type", "").partition(";")
    media_type = given.strip().lower()
    charset = parameters.partition("charset=")[2].strip().strip('"').lower()
    if media_type not in media_types or charset not in ("", "utf-8"):
        accepted = ", ".join(media_types)
        detail = f"The body must be {accepted.replace(', ', ' or ')}, in UTF-8 where it is text."
        raise ProblemError(problems.UNSUPPORTED_MEDIA_TYPE, detail, headers={"Accept": accepted})
    if request.headers.get("content-encoding", "identity").strip().lower() != "identity":
        detail = "The body must not be compressed."
        headers = {"Accept-Encoding": "identity"}
        raise ProblemError(problems.UNSUPPORTED_MEDIA_TYPE, detail, headers=headers)
    return media_type, await _read(request, settings(request).max_body_bytes)


async def _read(request: Request, limit: int) -> bytes:
    claimed = request.headers.get("content-length", "0")
    if claimed.isdigit() and (len(claimed) > 18 or int(claimed) > limit):
        raise _too_long(limit)
    room: Room = request.app.state.room
    patience = settings(request).body_seconds
    clock = asyncio.get_running_loop().time
    began = clock()
    parts: list[bytes] = []
    size, stream = 0, request.stream()
    with room.lease() as lease:
        while True:
            # Slower than that on the average, a body only holds on to what others need.
            late = began + patience + size / _SLOWEST
            try:
                async with asyncio.timeout_at(min(late, clock() + patience)):
                    part = await anext(stream, None)
            except TimeoutError:
                detail = f"The body came too slowly; {size} bytes of it arrived."
                raise ProblemError(
                    problems.TIMEOUT, detail, headers={"Connection": "close"}
                ) from None
            if part is None:
                return b"".join(parts)
            size += len(part)
            if size > limit:
                raise _too_long(limit)
            lease.take(len(part))
            parts.append(part)


class Room:
    """The memory for bodies that are being received, shared by all requests.

    Parameters
    ----------
    size : int
        Bytes.
    """

    def __init__(self, size: int) -> None:
        self.left = size

    @contextmanager
    def lease(self) -> Iterator[Lease]:
        """Take room piece by piece, and give all of it back at the end."""
        lease = Lease(self)
        try:
            yield lease
        finally:
            self.left += lease.taken


class Lease:
    """The room that one body takes."""

    def __init__(self, room: Room) -> None:
        self._room, self.taken = room, 0

    def take(self, size: int) -> None:
        """Take more.

        Raises
        ------
        ProblemError
            503 where there is none.
        """
        if size > self._room.left:
            detail = "Too many large requests are arriving at once."
            raise ProblemError(problems.UNAVAILABLE, detail, headers={"Retry-After": "2"})
        self._room.left -= size
        self.taken += size


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
    key = given.strip()
    if len(key) > 2 and key[0] == key[-1] == '"':  # a string of a structured field (RFC 9651)
        key = key[1:-1]
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


async def result(
    request: Request, name: str, found: Representation, headers: Mapping[str, str] | None = None
) -> Response:
    """Answer with a stored result: all of it, a range, or 304 where the caller has it.

    Raises
    ------
    ProblemError
        416 where the range lies beyond the end.
    """
    asked = request.headers
    # Ranges count the bytes of the file, not of a coding that could be another one next time.
    wanted = asked.get("range") if request.scope["method"] == "GET" else None
    if wanted is None:
        coding = negotiate.coding(asked.get("accept-encoding"))
        found = await evaluation(request).coded(name, found, coding)
    about = {
        "ETag": found.etag,
        "Vary": "Accept, Accept-Encoding",
        "Cache-Control": IMMUTABLE,
        "Content-Location": f"/v1/results/{name}",
        **(headers or {}),
    }
    known = asked.get("if-none-match")
    if known is not None and negotiate.names(known, found.etag):
        return Response(status_code=304, headers=about)
    about |= {
        "Repr-Digest": negotiate.repr_digest(found.sha256),
        "Accept-Ranges": "bytes",
    }
    if found.coding is not None:
        about["Content-Encoding"] = found.coding
    if found.media_type == negotiate.HDF5:
        file_name = f"{name[:16]}.{SUFFIXES[found.media_type]}"
        about["Content-Disposition"] = f'attachment; filename="{file_name}"'
    part = _part(wanted, asked.get("if-range"), found)
    first, stop = part or (0, found.size)
    if part is not None:
        about["Content-Range"] = f"bytes {first}-{stop - 1}/{found.size}"
    status, media_type = 206 if part else 200, found.media_type
    if found.file is None:
        data = found.data[first:stop] if part else found.data
        return Response(data, status, about, media_type)
    about["Content-Length"] = str(stop - first)
    if request.state.head:
        return Response(None, status, about, media_type)
    pieces = _pieces(found.file, HEAD + first, HEAD + stop)
    return StreamingResponse(pieces, status, about, media_type)


def _part(
    wanted: str | None, condition: str | None, found: Representation
) -> tuple[int, int] | None:
    """Return the range of bytes to answer with, or None for all (RFC 9110, 13.1.5, 14.2)."""
    if condition is not None and condition.strip() != found.etag:
        return None
    try:
        return negotiate.byte_range(wanted, found.size)
    except UnsatisfiableRangeError:
        headers = {"Content-Range": f"bytes */{found.size}"}
        detail = f"The result has {found.size} bytes."
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
