"""Many tiny computations at once: what a request costs beside its numbers is shared."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import orjson
import structlog

from vibroimpact_service import digest, intake, problems, tasks
from vibroimpact_service.jobs.work import Tick
from vibroimpact_service.kinds import KINDS, Kind
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

log = structlog.get_logger("vibroimpact.batches")


def answers(
    settings: Settings, owner: str, kind: str, contents: bytes, first: int, tick: Tick | None
) -> list[bytes]:
    """Return the answer to each of some requests: ``{"result": …}`` or ``{"problem": …}``.

    Parameters
    ----------
    settings : Settings
    owner, kind : str
    contents : bytes
        Some requests, as `parts` packs them.
    first : int
        Position of the first of them in the whole batch.
    tick : Tick, optional
    """
    store = Store(settings.store_url)
    requests = pickle.loads(contents)
    found = []
    for position, content in enumerate(requests, first):
        try:
            found.append(b'{"result":' + _answer(settings, store, owner, KINDS[kind], content))
        except Exception as error:
            problem = problems.of(error)
            if problem.type is problems.INTERNAL:
                log.exception("request of a batch failed", kind=kind, position=position)
            document = problem.document(f"batch-{position}").model_dump(mode="json")
            found.append(b'{"problem":' + orjson.dumps(document))
        if tick is not None:
            tick(position, len(requests))
    return [each + b"}" for each in found]


def _answer(settings: Settings, store: Store, owner: str, kind: Kind, content: Any) -> bytes:
    from vibroimpact_service import encode  # the numerical libraries load at the first request

    request = intake.document(kind.request, content)
    canonical = digest.canonical(request)
    tasks.check_references(owner, canonical, content)
    name = digest.name(owner, kind.name, tasks.solver_name(), canonical)
    assignment = tasks.assign(store, kind, request, settings)
    if tasks.seconds(assignment) > settings.batch_seconds:
        detail = "This is too much work for a batch; submit it as a job."
        raise ProblemError(problems.TOO_LARGE, detail)
    result = kind.solver.solve(assignment.problem, assignment.plan)
    created = datetime.now(UTC).isoformat(timespec="milliseconds")
    head = tasks.head(name, assignment, canonical, created)
    return encode.json(encode.describe(result, head))


def parts(requests: Sequence[Any], count: int) -> list[tuple[int, bytes]]:
    """Cut a batch into about equal parts; return the first position and the bytes of each.

    They are not JSON: that would refuse integers of more than 64 bits and turn NaN into null,
    about which the answer should rather say where it stands.
    """
    size = max(1, -(-len(requests) // count))
    return [
        (start, pickle.dumps(requests[start : start + size]))
        for start in range(0, len(requests), size)
    ]
