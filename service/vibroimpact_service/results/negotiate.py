"""Headers of content negotiation: Accept, Prefer, ETag, Range and their answers."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

JSON: Final = "application/json"
HDF5: Final = "application/x-hdf5"
REPRESENTATIONS: Final = (JSON, HDF5)
"""Media types of results; the first is the default."""

CODINGS: Final = ("zstd", "gzip")
"""Content codings of answers, the better one first."""

LONGEST_PREFER_WAIT: Final = 20.0
"""Seconds above which Prefer: wait is cut, below the timeouts of common proxies."""


def representation(accept: str | None, offered: Sequence[str] = REPRESENTATIONS) -> str | None:
    """Return the offered media type that Accept prefers, or None if it accepts none.

    Among equals the earlier offer is taken; the most specific range decides about an offer
    (RFC 9110, 12.5.1).
    """
    if accept is None or not accept.strip():
        return offered[0]
    ranges = [_media_range(item) for item in accept.split(",")]
    best: tuple[float, str] | None = None
    for offer in offered:
        matching = [r for r in ranges if _covers(r[0], offer)]
        if not matching:
            continue
        quality = max(matching, key=lambda r: _precision(r[0]))[1]
        if quality > 0 and (best is None or quality > best[0]):
            best = quality, offer
    return best[1] if best else None


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


def _covers(media_range: str, offer: str) -> bool:
    return media_range in ("*/*", offer, offer.partition("/")[0] + "/*")


def _precision(media_range: str) -> int:
    return 2 - media_range.count("*")


@dataclass(frozen=True, slots=True)
class Preference:
    """Preferences of Prefer (RFC 7240): an answer by a job, and the wait before it."""

    respond_async: bool = False
    wait: float | None = None

    def applied(self) -> str:
        """Return the value of Preference-Applied."""
        parts = ["respond-async"] * self.respond_async
        if self.wait is not None:
            parts.append(f"wait={self.wait:g}")
        return ", ".join(parts)


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


def entity_tag(sha256: str) -> str:
    """Return the strong entity tag of a representation from the hash of its bytes."""
    return f'"{sha256}"'


def names(condition: str, tag: str) -> bool:
    """Whether an If-None-Match (or If-Match) names the tag, by weak comparison."""
    if condition.strip() == "*":
        return True
    given = {item.strip().removeprefix("W/") for item in condition.split(",")}
    return tag in given


def repr_digest(sha256: str) -> str:
    """Return the value of Repr-Digest (RFC 9530)."""
    return f"sha-256=:{base64.b64encode(bytes.fromhex(sha256)).decode()}:"


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


def server_timing(seconds: Mapping[str, float]) -> str:
    """Return the value of Server-Timing from durations in seconds."""
    return ", ".join(
        f"{name};dur={1e3 * value:.3f}" for name, value in seconds.items() if math.isfinite(value)
    )
