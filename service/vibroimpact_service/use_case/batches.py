"""POST /v1/batch: many tiny computations in one request, shared among the workers."""

from __future__ import annotations

import asyncio
import pickle
from collections.abc import Mapping, Sequence
from typing import Any

import orjson
import structlog

from vibroimpact_schema.submissions import BatchRequest
from vibroimpact_service import kinds, problems
from vibroimpact_service.documents import parse, planning, requests
from vibroimpact_service.jobs.engine import Engine, EngineUnavailableError
from vibroimpact_service.jobs.work import WorkerLostError
from vibroimpact_service.kinds import Kind
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results import encode
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import computation
from vibroimpact_service.use_case.charges import Admission, Charge
from vibroimpact_service.use_case.threads import Threads
from vibroimpact_solvers.meter import StopSignal
from vibroimpact_solvers.plan import Plan, Tick

log = structlog.get_logger("vibroimpact.batches")


async def answer(
    owner: str,
    body: bytes,
    admission: Admission,
    settings: Settings,
    threads: Threads,
    engine: Engine,
    kernels: Mapping[str, str],
) -> bytes:
    """Return the results of the requests of a batch, in their order, as one document.

    They are computed by the workers, or in this process where there are none, and not stored.

    Raises
    ------
    ProblemError
        422 where the batch as a whole is wrong; what is wrong with one of its requests
        stands in the place of its result. 503 where neither workers nor kernels are there yet.
    """

    def read() -> tuple[str, list[Any]]:
        batch = parse.document(BatchRequest, parse.json(body))
        if len(batch.requests) > settings.batch_requests:
            message = f"A batch has at most {settings.batch_requests} requests."
            raise problems.too_large("/requests", "too_long", message)
        return kinds.named(batch.kind, "kind").name, batch.requests

    kind, contents = await threads.run(read)
    # What they may cost at most is held: they are planned where they are computed.
    held, loop = settings.batch_seconds * len(contents), asyncio.get_running_loop()
    await admission.charge(Plan(kind, ()), held)

    def used(seconds: Sequence[float]) -> None:
        if not loop.is_closed():
            asyncio.run_coroutine_threadsafe(admission.settle(0.0, sum(seconds)), loop)

    async def part(first: int, contents: bytes) -> list[bytes]:
        arguments = (settings, owner, kind, contents, first)
        counted = None if admission.account is None else used
        try:
            return list(await engine.run(compute, *arguments, used=counted))
        except (EngineUnavailableError, WorkerLostError):
            if kernels[kind] != "warm":
                detail = "The kernels are being compiled."
                headers = {"Retry-After": "1"}
                raise ProblemError(problems.UNAVAILABLE, detail, headers=headers) from None
            here = Charge(admission, 0.0).measured(lambda _: compute(*arguments, None))
            return await threads.compute(lambda: here(StopSignal()))

    parts = _parts(contents, 2 * max(1, engine.workers))
    try:
        answers = await asyncio.gather(*(part(first, some) for first, some in parts))
    finally:
        await admission.settle(held, 0.0)
    return b'{"answers":[' + b",".join(each for some in answers for each in some) + b"]}"


def compute(
    settings: Settings, owner: str, kind: str, contents: bytes, first: int, tick: Tick | None
) -> list[bytes]:
    """Return the answer to each of some requests: ``{"result": …}`` or ``{"problem": …}``.

    They are packed by `_parts`; `first` is the position of the first of them in the whole batch.
    """
    store = Store(settings.store_url)
    batch = pickle.loads(contents)
    answers = []
    for position, content in enumerate(batch, first):
        try:
            result = _result(settings, store, owner, kinds.KINDS[kind], content)
            answers.append(b'{"result":' + result + b"}")
        except Exception as error:
            fault = problems.of(error)
            if fault.type is problems.INTERNAL:
                log.exception("request of a batch failed", kind=kind, position=position)
            document = fault.document(f"batch-{position}").model_dump(mode="json")
            answers.append(b'{"problem":' + orjson.dumps(document) + b"}")
        if tick is not None:
            tick(position, len(batch))
    return answers


def _result(settings: Settings, store: Store, owner: str, kind: Kind, content: Any) -> bytes:
    request = requests.read(owner, kind, content)
    planned = planning.plan(store, kind, request.document, settings)
    if planned.seconds > settings.batch_seconds:
        detail = "This is too much work for a batch; submit it as a job."
        raise ProblemError(problems.TOO_LARGE, detail)
    computed = computation.compute(planned, request.digest, request.canonical)
    return encode.to_json(computed)


def _parts(contents: Sequence[Any], count: int) -> list[tuple[int, bytes]]:
    """Cut a batch into about equal parts; return the first position and the bytes of each.

    They are not JSON: that would refuse integers of more than 64 bits and turn NaN into null,
    and the problem of the request could not name the place.
    """
    size = max(1, -(-len(contents) // count))
    return [
        (start, pickle.dumps(contents[start : start + size]))
        for start in range(0, len(contents), size)
    ]
