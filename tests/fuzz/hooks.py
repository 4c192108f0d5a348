"""What schemathesis is told beyond the contract: media types, and requests that get far."""

from __future__ import annotations

import zlib
from typing import Any

import schemathesis
from schemathesis.generation.meta import TestPhase

from vibroimpact_schema import examples
from vibroimpact_service.kinds import KINDS

EXAMPLES = {kind: [each["request"] for each in examples.requests(kind).values()] for kind in KINDS}
JOBS = [{"kind": kind, "request": each} for kind, known in EXAMPLES.items() for each in known]


@schemathesis.serializer("application/x-matrix-market")
def as_text(_: Any, value: Any) -> bytes:
    """Send texts as they are."""
    return value if isinstance(value, bytes) else str(value).encode("utf-8", "surrogatepass")


@schemathesis.serializer("application/x-npy")
def as_bytes(_: Any, value: Any) -> bytes:
    """Send bytes as they are."""
    return value if isinstance(value, bytes) else str(value).encode("utf-8", "surrogatepass")


@schemathesis.deserializer("application/json")
def of_json(_: Any, response: Any) -> Any:
    """Read JSON; a range of its bytes is no document, only text."""
    return response.text if response.status_code == 206 else response.json()


@schemathesis.hook
def before_call(_: Any, case: Any, __: Any) -> None:
    """Let every other computation of a conversation be one of the examples.

    What is made up from the schema alone is hardly ever a structure that can move, and what has
    no result leads nowhere. And nothing is shared with the user who must not see it.
    """
    if case.path == "/v1/jobs/{job}/share" and isinstance(case.body, dict):
        readers = case.body.get("readers")
        if isinstance(readers, list) and {"*", "bob"} & {r for r in readers if isinstance(r, str)}:
            case.body = {**case.body, "readers": ["carol"]}
    meta = case.meta
    if meta is None or meta.phase.name is not TestPhase.STATEFUL:
        return
    if case.method != "POST" or meta.generation.mode.is_negative:
        return
    known = JOBS if case.path == "/v1/jobs" else EXAMPLES.get(case.path.rpartition("/")[2])
    number = zlib.crc32(repr(case.body).encode())
    if known and number % 2:
        case.body = known[number // 2 % len(known)]
