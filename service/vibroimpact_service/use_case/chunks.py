"""Jobs in chunks: what workers do to cut a computation, compute its chunks and join them."""

from __future__ import annotations

import errno
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

import orjson
import structlog

from vibroimpact_service import logs, problems, use_case
from vibroimpact_service.documents import digest, parse, planning
from vibroimpact_service.documents.planning import Planned
from vibroimpact_service.jobs.work import (
    Chunk,
    ChunkMissingError,
    DeadlineError,
    Work,
    WorkerLostError,
)
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results import encode
from vibroimpact_service.results.rows import RowFiles
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store, StoreUnavailableError
from vibroimpact_service.use_case import computation, warming
from vibroimpact_solvers.meter import LimitPassedError, StopSignal
from vibroimpact_solvers.plan import Tick
from vibroimpact_solvers.spectrum import Cache, held_bytes

log = structlog.get_logger("vibroimpact.chunks")

CHUNK_SECONDS: Final = 0.2
"""Planned work of one chunk; part of the names of chunks, so the same in all processes."""
_LEAST_LIMIT: Final = 60.0
_TIMES_PLANNED: Final = 100.0
"""A chunk that takes longer than so many times its planned time, and the seconds above, ends."""
_MOST_LIMIT: Final = 86_400.0
_COMPILATION_SECONDS: Final = 600.0
"""More of them where kernels may have to be compiled first: all take some 70, on a busy machine
several times as many."""


class Cut(NamedTuple):
    """A request that is cut into chunks, as a process needs it to compute any of them."""

    planned: Planned
    canonical: bytes
    problems: list[Any]
    """Problem of each chunk, from `split` of the kind's solver."""
    names: list[str]
    """Names of the chunks."""
    chained: bool
    """Whether each chunk needs the one before."""
    nbytes: int
    """Memory of all that."""


KNOWN: Final = Cache(2**28, most=4)
"""Requests of recent jobs: each is decoded and planned once in a process, however many of its
chunks are computed there."""


def _cut(store_url: str, kind: str, request: str, seconds_each: float) -> Cut:
    key = "\n".join((store_url, kind, request, repr(seconds_each)))
    return KNOWN.get(key.encode(), lambda: _planned_cut(store_url, kind, request, seconds_each))


def _planned_cut(store_url: str, kind: str, request: str, seconds_each: float) -> Cut:
    store = Store(store_url)
    data = store.requests.get(request)
    if data is None:
        # It was there when the job was begun, and is stored again when it is begun again.
        raise StoreUnavailableError(errno.ENOENT, "the store has lost the request of the job")
    owner, _, canonical = data.rpartition(b"\n")
    document = parse.document(KINDS[kind].request, orjson.loads(canonical))
    planned = planning.plan(store, KINDS[kind], document)
    solver = planned.kind.solver
    cut = solver.split(planned.problem, planned.plan, seconds_each)
    names = _names(owner, planned, document, cut)
    chained = len(cut) > 1 and hasattr(solver, "follow")
    size = len(canonical) + 100 * len(names) + held_bytes(planned.problem, cut)
    return Cut(planned, canonical, cut, names, chained, size)


def _names(owner: bytes, planned: Planned, request: Any, cut: list[Any]) -> list[str]:
    """Return the names of chunks: by content, so that other requests find what they share.

    Everything that the numbers of a chunk depend on goes into its name: the request apart from
    the axis that is cut, the methods that the plan of the whole chose, and its own
    points, bit for bit. The owner does too: a hit would reveal somebody else's request.
    """
    kind = planned.kind
    methods = [(step.stage.value, str(step.method)) for step in planned.plan.steps]
    rest = request.model_dump(exclude_none=True, exclude={kind.axis} if kind.axis else None)
    common = digest.dumps({"request": rest, "methods": methods})
    name = digest.name(owner.decode(), kind.name, digest.solver_name(), common)
    if kind.axis is None:
        contents = [f":{CHUNK_SECONDS}:{i}:{len(cut)}".encode() for i in range(len(cut))]
    else:
        contents = [kind.solver.content(problem) for problem in cut]
    return [digest.content(name.encode() + content) for content in contents]


def split(store_url: str, kind: str, request: str, result: str) -> Sequence[Chunk]:
    """Return the chunks of a job."""
    job = _cut(store_url, kind, request, CHUNK_SECONDS)
    each = job.planned.seconds / max(1, len(job.names))
    lasting = job.planned.kind.axis is not None
    return [Chunk(name, each, lasting, job.chained) for name in job.names]


def solve(
    store_url: str,
    kind: str,
    request: str,
    result: str,
    indices: Sequence[int],
    tick: Tick | None = None,
) -> None:
    """Compute some chunks of a job and store each."""
    job = _cut(store_url, kind, request, CHUNK_SECONDS)
    store, solver = Store(store_url), job.planned.kind.solver
    if job.chained:
        _solve_chained(store, job, indices, tick)
        return
    for index in indices:
        if store.chunks.has(job.names[index]):
            continue  # the call is repeated because its worker died halfway
        with _limited(store, job, tick):
            # By the plan of the whole: one of the chunk alone could take another method for it.
            solved = solver.solve(job.problems[index], job.planned.plan, tick)
        _put(store, job.names[index], solved)


def _solve_chained(store: Store, job: Cut, indices: Sequence[int], tick: Tick | None) -> None:
    """Compute some chunks that need one another, and those before that are not there."""
    solver: Any = job.planned.kind.solver
    last, before = -1, None
    for index in indices:
        if store.chunks.has(job.names[index]):
            continue
        # What was computed last is at hand; else the latest that is stored is the seed.
        if last != index - 1:
            last, before = _latest(store, job, index)
        while last < index:
            with _limited(store, job, tick):
                before = solver.follow(job.problems[last + 1], job.planned.plan, before, tick)
            last += 1
            _put(store, job.names[last], before)


@contextmanager
def _limited(store: Store, job: Cut, tick: Tick | None) -> Iterator[None]:
    """Bound the processor time of a chunk, by its price and beyond all reasonable errors of that.

    Raises
    ------
    LimitPassedError
        Where it takes more.
    """
    planned = job.planned.seconds / max(1, len(job.names))
    most = min(_LEAST_LIMIT + _TIMES_PLANNED * planned, _MOST_LIMIT)
    if not warming.is_compiled(job.planned.kind.name):
        most += _COMPILATION_SECONDS
    if isinstance(tick, StopSignal):
        tick.allow(most)
    try:
        yield
    except LimitPassedError:
        kept, total = len(store.chunks.sound(job.names)), len(job.names)
        done = f", {tick.fraction:.0%} of it was done" if isinstance(tick, StopSignal) else ""
        detail = (
            f"A piece took more than {most:.3g} s of processor time; {planned:.3g} s were planned"
            f"{done}. {kept} of {total} pieces are kept."
        )
        raise LimitPassedError(detail) from None


def _latest(store: Store, job: Cut, index: int) -> tuple[int, Any]:
    """Return the index of the last stored chunk before another, and the chunk; -1, None if none."""
    for place in range(index - 1, -1, -1):
        try:
            solver: Any = job.planned.kind.solver
            return place, _get(store, job.names[place], solver.Part)
        except ChunkMissingError:
            continue
    return -1, None


def join(store_url: str, kind: str, request: str, result: str, chunks: Sequence[Chunk]) -> None:
    """Join the chunks of a job and store its result."""
    job = _cut(store_url, kind, request, CHUNK_SECONDS)
    store, solver = Store(store_url), job.planned.kind.solver
    if job.chained:
        _join_in_files(store, job, result, chunks)
        return
    solved = [_get(store, chunk.name, solver.Result) for chunk in chunks]
    whole = solver.join(job.planned.problem, job.planned.plan, solved)
    head = computation.head(job.planned, result, job.canonical)
    computation.put(store, encode.describe(whole, head))


def _join_in_files(store: Store, job: Cut, result: str, chunks: Sequence[Chunk]) -> None:
    """Join chunks that hold rows of one result, without the result in memory, and store it."""
    solver: Any = job.planned.kind.solver
    with store.results.workspace() as folder:
        with closing(RowFiles(folder)) as rows:
            assembly = solver.Assembly(job.planned.problem, rows)
            for chunk in chunks:
                assembly.add(_get(store, chunk.name, solver.Part))
            for name, values in assembly.labels().items():
                if values is not None:
                    rows.append(name, values)
        head = computation.head(job.planned, result, job.canonical)
        whole = folder / "whole"
        encode.pack_rows(solver.Result, rows, assembly.plain(), head, whole)
        if not store.results.readable(result):
            store.results.put_file(result, whole)


def _put(store: Store, name: str, solved: Any) -> None:
    store.chunks.put(name, encode.pack(encode.describe(solved, {})), durable=False)


def _get(store: Store, name: str, result: type[Any]) -> Any:
    data = store.chunks.get(name)
    if data is None:
        raise ChunkMissingError(name)
    return encode.to_result(encode.unpack(data), result)


def explain(error: BaseException) -> dict[str, Any]:
    """Return the problem document of a job that failed."""
    fault = problems.of(error)
    if isinstance(error, LimitPassedError):
        fault = ProblemError(problems.LIMIT_PASSED, str(error))
    elif isinstance(error, MemoryError):
        fault = ProblemError(problems.LIMIT_PASSED, "It needs more memory than a worker has.")
    elif isinstance(error, WorkerLostError) and "SIGXCPU" in error.why:
        detail = "It took so much processor time that its worker was ended."
        fault = ProblemError(problems.LIMIT_PASSED, detail)
    elif isinstance(error, WorkerLostError):
        fault = ProblemError(problems.WORKER_LOST, problems.WORKER_LOST.about)
    elif isinstance(error, DeadlineError):
        fault = ProblemError(problems.DEADLINE, problems.DEADLINE.about)
    elif fault.type is problems.INTERNAL:
        log.error("computation failed", exc_info=error)
    document: dict[str, Any] = fault.document("job").model_dump(mode="json")
    return document


def prepare(structures_bytes: int | None = None) -> None:
    """Load the numerical libraries before the first job needs them.

    Structures of recent requests take up to so many bytes in this process.
    """
    logs.to_stderr()
    use_case.load()
    if structures_bytes is not None:
        from vibroimpact_service.documents import decode

        decode.KNOWN.resize(structures_bytes)


WORK: Final = Work(
    split=split,
    solve=solve,
    join=join,
    explain=explain,
    prepare=prepare,
    modules=use_case.NUMERICAL,
)


def work(settings: Settings) -> Work:
    """Return the same, each process with the settings of the service."""
    return replace(WORK, prepare=partial(prepare, settings.structures_bytes))
