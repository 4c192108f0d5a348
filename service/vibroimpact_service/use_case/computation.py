"""One computation: planned, solved, encoded and stored; chunks and batches use its parts."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

from vibroimpact_service.documents import digest, limits, planning
from vibroimpact_service.documents.planning import Planned
from vibroimpact_service.documents.requests import Request
from vibroimpact_service.results import encode, representations
from vibroimpact_service.results.encode import Content
from vibroimpact_service.results.representations import Representation
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_solvers.meter import StopSignal
from vibroimpact_solvers.plan import Tick


@dataclass(frozen=True, slots=True)
class Computed:
    """What became of the computation of the result with a digest."""

    digest: str
    planned: Planned
    seconds: dict[str, float]
    """Stage (``plan``, ``solve``, ``encode``) -> time that it took."""
    fresh: bool = False
    """Whether it was computed; else the result was stored already."""
    representation: Representation | None = None
    """The result; None where it is not wanted, large, or not fresh."""


def now(
    store: Store,
    settings: Settings,
    request: Request,
    planned: Planned | None,
    media_type: str | None,
    signal: StopSignal,
) -> Computed | Planned:
    """Compute a result in this thread and store it; only plan it where that would take long.

    Without a plan it is planned here, as long as anybody wants it; without a media type its
    representation is not wanted.
    """
    began = time.perf_counter()
    if planned is None:
        planned = planning.plan(
            store, request.kind, request.document, settings, signal.while_wanted
        )
        if planned.seconds > settings.inline_seconds:
            return planned
    elif store.results.readable(request.digest):  # an equal request came first
        return Computed(request.digest, planned, {"plan": 0.0, "solve": 0.0, "encode": 0.0})
    if media_type is not None:
        representations.check_size(limits.least_bytes(planned.plan), media_type)
    ready = time.perf_counter()
    content = compute(planned, request.digest, request.canonical, signal)
    solved = time.perf_counter()
    representation = None
    if media_type is not None and content.nbytes <= representations.LARGE:
        representation = representations.of_content(content, media_type)
    put(store, content, durable=False)
    seconds = {
        "plan": ready - began, "solve": solved - ready, "encode": time.perf_counter() - solved
    }  # fmt: skip
    return Computed(request.digest, planned, seconds, True, representation)


def compute(planned: Planned, name: str, canonical: bytes, tick: Tick | None = None) -> Content:
    """Compute the result with a digest, of a request in its canonical form, in one go."""
    result = planned.kind.solver.solve(planned.problem, planned.plan, tick)
    return encode.describe(result, head(planned, name, canonical))


def head(planned: Planned, name: str, canonical: bytes) -> dict[str, Any]:
    """Return what surrounds the numbers of a result; parameters as of `compute`."""
    now = datetime.now(UTC).isoformat(timespec="milliseconds")
    units = planned.problem.system.units
    return {
        "kind": planned.kind.name,
        "digest": name,
        "request": canonical.decode(),
        "plan": planning.steps(planned.plan),
        "provenance": {"created": now, "solver_version": digest.SOLVER_VERSION},
        "units": None if units is None else asdict(units),
    }


def put(store: Store, content: Content, *, durable: bool = True) -> None:
    """Store a result, unless it is there: later requests get the bytes of the first one.

    With `durable` false a power failure may take it away again; it is computed again then.
    """
    name = content.head["digest"]
    if not store.results.readable(name):
        store.results.put(name, encode.pack(content), durable=durable)
