"""What comes after the headers: a body of limited size, not too slowly, and that nobody waits."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Sequence
from typing import Final, TypeVar

from starlette.requests import ClientDisconnect, Request

from vibroimpact_service import problems
from vibroimpact_service.api.route import services
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results.encoders import JSON

Value = TypeVar("Value")

_UNWATCHED_SECONDS: Final = 0.02
"""Time in which most work is done; until then nobody looks whether the caller is there."""
_LEAST_RATE: Final = 4096
"""Bytes per second that a body must reach on average."""


async def read_json(request: Request) -> bytes:
    """Return the bytes of a JSON body, never more than the limit.

    Raises
    ------
    ProblemError
        408, 413, 415 or 503.
    """
    _, body = await read_body(request, (JSON,))
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
        detail = (
            f"The body must be {accepted.replace(', ', ' or ')}, in UTF-8 where it is text, and "
            "the header Content-Type must say so."
        )
        raise ProblemError(problems.UNSUPPORTED_MEDIA_TYPE, detail, headers={"Accept": accepted})
    if request.headers.get("content-encoding", "identity").strip().lower() != "identity":
        detail = "The body must not be compressed."
        headers = {"Accept-Encoding": "identity"}
        raise ProblemError(problems.UNSUPPORTED_MEDIA_TYPE, detail, headers=headers)
    return media_type, await _read(request)


async def _read(request: Request) -> bytes:
    parts = services(request)
    settings = parts.settings
    limit, pause = settings.max_body_bytes, settings.body_seconds
    claimed = request.headers.get("content-length", "0")
    # Superscripts are digits to Python, but no numbers.
    if claimed.isdecimal() and (len(claimed) > 18 or int(claimed) > limit):
        raise _too_long(limit)
    clock = asyncio.get_running_loop().time
    began = clock()
    pieces: list[bytes] = []
    size = 0
    try:
        async with asyncio.timeout_at(began + pause) as timer:
            async for piece in request.stream():
                if size + len(piece) > limit:
                    raise _too_long(limit)
                if len(piece) > parts.body_bytes_left:
                    detail = "Too many large requests are arriving at once."
                    headers = {"Retry-After": "2"}
                    raise ProblemError(problems.UNAVAILABLE, detail, headers=headers)
                parts.body_bytes_left -= len(piece)
                size += len(piece)
                pieces.append(piece)
                # A body that comes more slowly than this on average only occupies memory.
                slowest = began + pause + size / _LEAST_RATE
                timer.reschedule(min(slowest, clock() + pause))
        return b"".join(pieces)
    except TimeoutError:
        detail = f"The body came too slowly; {size} bytes of it arrived."
        headers = {"Connection": "close"}
        raise ProblemError(problems.TIMEOUT, detail, headers=headers) from None
    finally:
        parts.body_bytes_left += size


def _too_long(limit: int) -> ProblemError:
    return problems.too_large("", "body_too_long", f"The body is longer than {limit} bytes.")


async def while_connected(request: Request, work: Awaitable[Value]) -> Value:
    """Return what an awaitable returns; the body of the request was read before.

    Raises
    ------
    ClientDisconnect
        Where the caller went away first; the awaitable is cancelled then.
    """
    task, watching, has_left = asyncio.current_task(), None, False
    assert task is not None

    async def watch() -> None:
        nonlocal has_left
        while (await request.receive())["type"] != "http.disconnect":
            continue
        has_left = True
        task.cancel()

    def begin() -> None:
        nonlocal watching
        watching = asyncio.ensure_future(watch())

    timer = asyncio.get_running_loop().call_later(_UNWATCHED_SECONDS, begin)
    try:
        return await work
    except asyncio.CancelledError:
        if has_left and task.uncancel() == 0:
            raise ClientDisconnect from None
        raise
    finally:
        timer.cancel()
        if watching is not None:
            watching.cancel()
