"""Request headers: Accept, Accept-Encoding, Prefer, Idempotency-Key, conditions, Range."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from starlette.requests import Request

from vibroimpact_service import problems
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results.encoders import ENCODERS
from vibroimpact_service.results.representations import CODINGS
from vibroimpact_service.use_case.evaluation import Preference

LONGEST_PREFER_WAIT: Final = 20.0
"""Seconds above which Prefer: wait is cut, below the timeouts of common proxies."""
_KEY = re.compile(r"[!-~]{1,255}")


def result_media_type(request: Request) -> str:
    """Return the media type of a result that Accept prefers.

    Raises
    ------
    ProblemError
        406 where none fits.
    """
    accept = ", ".join(request.headers.getlist("accept"))
    media_type = preferred(accept)
    if media_type is None:
        detail = f"Results are {' or '.join(ENCODERS)}."
        raise ProblemError(problems.NOT_ACCEPTABLE, detail)
    parameter = ENCODERS[media_type].parameter
    if parameter is None:
        return media_type
    return f"{media_type};{parameter.name}={request.query_params.get(parameter.name, '')}"


def preferred(accept: str) -> str | None:
    """Return the media type of results that Accept prefers, or None if it accepts none.

    Among equals the earlier one is taken; the most specific range decides about an offer
    (RFC 9110, 12.5.1).
    """
    if not accept.strip():
        return next(iter(ENCODERS))
    # Of equal ranges the first one counts.
    qualities = dict(_media_range(item) for item in reversed(accept.split(",")))

    def quality(offer: str) -> float:
        ranges = (offer, offer.partition("/")[0] + "/*", "*/*")
        return next((qualities[each] for each in ranges if each in qualities), 0.0)

    best = max(ENCODERS, key=quality)
    return best if quality(best) > 0 else None


def coding(accept_encoding: str | None) -> str | None:
    """Return the content coding to send, ``zstd`` or ``gzip``, or None for none."""
    if not accept_encoding:
        return None
    qualities = dict(_media_range(item) for item in accept_encoding.split(","))
    best = max(CODINGS, key=lambda each: qualities.get(each, qualities.get("*", 0.0)))
    return best if qualities.get(best, qualities.get("*", 0.0)) > 0 else None


def _media_range(item: str) -> tuple[str, float]:
    name, *parameters = (part.strip().lower() for part in item.split(";"))
    quality = 1.0
    for parameter in parameters:
        key, _, value = parameter.partition("=")
        if key.strip() == "q":
            quality = _quality(value.strip())
    return name, quality


def _quality(text: str) -> float:
    return float(text) if re.fullmatch(r"0(\.\d{0,3})?|1(\.0{0,3})?", text) else 0.0


def preference(headers: Sequence[str]) -> Preference:
    """Return the preferences of the Prefer headers; unknown ones are ignored (RFC 7240)."""
    respond_async, wait = False, None
    for item in ",".join(headers).split(","):
        key, _, value = item.partition(";")[0].partition("=")
        key, value = key.strip().lower(), value.strip().strip('"')
        if key == "respond-async":
            respond_async = True
        elif key == "wait" and wait is None and re.fullmatch(r"\d{1,9}(\.\d{1,9})?", value):
            wait = min(float(value), LONGEST_PREFER_WAIT)
    return Preference(respond_async, wait)


def preference_applied(preference: Preference) -> dict[str, str]:
    """Return the header that states which preferences are obeyed, with the wait that is granted."""
    parts = ["respond-async"] * preference.respond_async
    if preference.wait is not None:
        parts.append(f"wait={preference.wait:g}")
    return {"Preference-Applied": ", ".join(parts)} if parts else {}


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


def last_event(header: str | None) -> int:
    """Return the number in Last-Event-ID, of a change of a job; 0 where there is none."""
    return int(header) if header and re.fullmatch(r"[0-9]{1,9}", header) else 0


def is_known(condition: str | None, tag: str) -> bool:
    """Whether If-None-Match names an entity tag, by weak comparison: the caller has the answer."""
    if condition is None or condition.strip() == "*":
        return condition is not None
    return tag in {item.strip().removeprefix("W/") for item in condition.split(",")}


def check_match(condition: str | None, tag: str | None) -> None:
    """Refuse a request whose If-Match names neither the entity tag nor ``*``.

    Raises
    ------
    ProblemError
        412.
    """
    if condition is None or condition.strip() == "*":
        return
    if tag is None or tag not in [item.strip() for item in condition.split(",")]:
        raise ProblemError(problems.PRECONDITION_FAILED, problems.PRECONDITION_FAILED.about)


class UnsatisfiableRangeError(ValueError):
    """No byte of the requested range exists."""


def byte_range(header: str | None, size: int) -> tuple[int, int] | None:
    """Return (first, last + 1) of the one requested range of bytes.

    None where there is none, or several, or an unknown one: the whole representation is
    then to be sent (RFC 9110, 14.2).

    Raises
    ------
    UnsatisfiableRangeError
        Where the range lies beyond the end.
    """
    if header is None:
        return None
    match = re.fullmatch(r"bytes=\s*(\d{0,18})-(\d{0,18})\s*", header.strip())
    if match is None or match.group(0) == "bytes=-" or not any(match.groups()):
        return None
    first, last = match.groups()
    if not first:
        length = min(int(last), size)
        if length == 0:
            raise UnsatisfiableRangeError
        return size - length, size
    start = int(first)
    if last and int(last) < start:
        return None
    if start >= size:
        raise UnsatisfiableRangeError
    return start, min(int(last) + 1, size) if last else size
