"""Reading request bodies: media type, size, and how slowly they may come."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Final

from starlette.requests import Request

from vibroimpact_service import problems
from vibroimpact_service.api.dependencies import services
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results import representations

_LEAST_RATE: Final = 4096
"""Bytes per second that a body must reach on average."""


async def read_json(request: Request) -> bytes:
    """Return the bytes of a JSON body, never more than the limit.

    Raises
    ------
    ProblemError
        408, 413, 415 or 503.
    """
    _, body = await read_body(request, (representations.JSON,))
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
    return media_type, await _read(request)


async def _read(request: Request) -> bytes:
    settings, memory = services(request).settings, services(request).body_memory
    limit, pause = settings.max_body_bytes, settings.body_seconds
    claimed = request.headers.get("content-length", "0")
    # Superscripts are digits to Python, but no numbers.
    if claimed.isdecimal() and (len(claimed) > 18 or int(claimed) > limit):
        raise _too_long(limit)
    clock = asyncio.get_running_loop().time
    began = clock()
    parts: list[bytes] = []
    size = 0
    try:
        async with asyncio.timeout_at(began + pause) as timer:
            async for part in request.stream():
                if size + len(part) > limit:
                    raise _too_long(limit)
                memory.take(len(part))
                size += len(part)
                parts.append(part)
                # A body that comes more slowly than this on average only occupies memory.
                slowest = began + pause + size / _LEAST_RATE
                timer.reschedule(min(slowest, clock() + pause))
        return b"".join(parts)
    except TimeoutError:
        detail = f"The body came too slowly; {size} bytes of it arrived."
        headers = {"Connection": "close"}
        raise ProblemError(problems.TIMEOUT, detail, headers=headers) from None
    finally:
        memory.left += size


def _too_long(limit: int) -> ProblemError:
    return problems.too_large("", "body_too_long", f"The body is longer than {limit} bytes.")
