"""Request headers that several routes read."""

from __future__ import annotations

import re

from starlette.requests import Request

from vibroimpact_service import problems
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results import negotiate

_KEY = re.compile(r"[!-~]{1,255}")


def result_media_type(request: Request) -> str:
    """Return the media type of a result that Accept prefers.

    Raises
    ------
    ProblemError
        406 where none fits.
    """
    accept = ", ".join(request.headers.getlist("accept"))
    media_type = negotiate.representation(accept)
    if media_type is None:
        detail = f"Results are {' or '.join(negotiate.REPRESENTATIONS)}."
        raise ProblemError(problems.NOT_ACCEPTABLE, detail)
    return media_type


def idempotency_key(request: Request) -> str | None:
    """Return the Idempotency-Key of a request, if it has one.

    Raises
    ------
    ProblemError
        400 where its form is wrong.
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
