"""What a computation does from request to stored result, here and in worker processes alike."""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from functools import cache, lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import orjson
import structlog
from pydantic import TypeAdapter

from vibroimpact_schema.plans import PlanSkip, PlanStep, Steps
from vibroimpact_schema.systems import AnySystem, System, SystemReference
from vibroimpact_service import claims, digest, intake, loading, problems
from vibroimpact_service.jobs.work import (
    Chunk,
    ChunkMissingError,
    DeadlineError,
    Tick,
    Work,
    WorkerLostError,
)
from vibroimpact_service.kinds import KINDS, Kind
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_service.spool import Spool
from vibroimpact_service.store import Store
from vibroimpact_solvers.errors import ModelError, SolverError
from vibroimpact_solvers.plan import Plan

if TYPE_CHECKING:
    from vibroimpact_solvers.model import System as ModelSystem

log = structlog.get_logger("vibroimpact.tasks")

SOLVER_VERSION: Final = version("vibroimpact")
SYSTEM: Final[TypeAdapter[AnySystem | SystemReference]] = TypeAdapter(System)
CHUNK_SECONDS: Final = 0.2
"""Planned work of one chunk; part of the names of chunks, so the same in all processes."""


class Assignment(NamedTuple):
    """A computation that was checked and planned."""

    kind: Kind
    problem: Any
    plan: Plan


def assign(store: Store, kind: Kind, request: Any, settings: Settings | None = None) -> Assignment:
    """Check a request as a whole and plan it.

    With settings, what it claims is held against the limits before anything is allocated.

    Raises
    ------
    ProblemError
        413 or 422 with the field that is wrong.
    """
    from vibroimpact_service import decode  # the numerical libraries load at the first request

    if isinstance(request.system, SystemReference):
        request = request.with_system(stored_system(store, request.system, *kind.structure))
    if settings is not None:
        claims.check(request, settings)
    try:
        model = decode.system(request.system)
    except ModelError as error:
        raise problems.of(error.under(*kind.structure)) from None
    try:
        problem = kind.problem(request, model)
        plan = kind.solver.plan(problem)
    except SolverError as error:
        raise problems.of(error) from None
    if settings is not None:
        claims.check_plan(plan, settings)
    return Assignment(kind, problem, plan)


def stored_system(store: Store, reference: SystemReference, *where: str) -> AnySystem:
    """Return a system that was stored before, with the constraints of the reference.

    `where` is the path from the body to the reference.

    Raises
    ------
    ProblemError
        422 where there is none of that name.
    """
    data = store.systems.get(reference.id)
    if data is None:
        pointer = problems.pointer((*where, "id"))
        raise problems.invalid(pointer, "unknown_system", "there is no such system")
    system: AnySystem = intake.union(SYSTEM, orjson.loads(data))
    if reference.constraints is not None:
        return system.model_copy(update={"constraints": reference.constraints})
    return system


def check_references(owner: str, canonical: bytes, content: Any, *place: str | int) -> None:
    """Refuse a request that names a system of someone else, as if there were none.

    `canonical` is its canonical form, which tells most that name no system at all; `content`
    the JSON content that it was, and `place` the path from the body to that.

    Raises
    ------
    ProblemError
        422 with the place of the name.
    """
    if b'"sys_' in canonical:
        _check_parts(owner, content, place)


def _check_parts(owner: str, content: Any, place: tuple[str | int, ...]) -> None:
    if isinstance(content, dict):
        name = content.get("id")
        if isinstance(name, str) and name.startswith("sys_"):
            check_reference(owner, name, *place)
        parts: Iterable[tuple[str | int, Any]] = content.items()
    elif isinstance(content, list):
        parts = enumerate(content)
    else:
        return
    for name, part in parts:
        if isinstance(part, dict | list):
            _check_parts(owner, part, (*place, name))


def check_reference(owner: str, name: str, *place: str | int) -> None:
    """Refuse the name of a system of someone else."""
    if not digest.owned(owner, name):
        where = problems.pointer((*place, "id"))
        raise problems.invalid(where, "unknown_system", "there is no such system")


def plan_document(plan: Plan) -> Steps:
    """Return a plan as a document."""
    return Steps(
        steps=[
            PlanStep(
                stage=step.stage.value,
                method=step.method,
                reason=step.reason,
                flops=step.flops,
                bytes=step.bytes,
                count=step.count,
            )
            for step in plan.steps
        ],
        skips=[PlanSkip(what=skip.what, why=skip.why) for skip in plan.skips],
        flops=plan.flops,
        bytes=plan.bytes,
    )


def checked_system(document: AnySystem) -> ModelSystem:
    """Return the solver's system of a document.

    Raises
    ------
    ProblemError
        422 with the field that is wrong.
    """
    from vibroimpact_service import decode

    try:
        return decode.system(document)
    except ModelError as error:
        raise problems.of(error) from None


def seconds(assignment: Assignment) -> float:
    """Return the estimated time of a computation on one core of this machine."""
    from vibroimpact_solvers import cost

    return cost.seconds(assignment.plan)


def compute(
    store: Store,
    result_name: str,
    assignment: Assignment,
    request: bytes,
    tick: Tick | None = None,
) -> bytes | None:
    """Compute a result in one go and store it; return its bundle, unless it was there already.

    It need not outlive a power failure: whoever asks again has it computed again.
    """
    kind, problem, plan = assignment
    result = kind.solver.solve(problem, plan, tick)
    return keep(store, result_name, assignment, request, result, durable=False)


def keep(
    store: Store,
    result_name: str,
    assignment: Assignment,
    request: bytes,
    result: Any,
    *,
    durable: bool = True,
) -> bytes | None:
    """Store a result under its name and return its bundle, unless it is there already.

    What surrounds the numbers (when, by which version) is fixed here, once: whoever asks
    later gets the same bytes.
    """
    from vibroimpact_service import encode

    if store.results.has(result_name):
        return None
    surroundings = head(result_name, assignment, request, _now())
    data = encode.freeze(result, surroundings)
    store.results.put(result_name, data, durable=durable)
    return data


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def head(result_name: str, assignment: Assignment, request: bytes, created: str) -> dict[str, Any]:
    """Return what surrounds the numbers of a result."""
    units = assignment.problem.system.units
    return {
        "kind": assignment.kind.name,
        "digest": result_name,
        "request": request.decode(),
        "plan": plan_document(assignment.plan).model_dump(),
        "provenance": {"created": created, "solver_version": SOLVER_VERSION},
        "units": None
        if units is None
        else {"length": units.length, "mass": units.mass, "time": units.time},
    }


@cache
def solver_name() -> str:
    """Return what makes results differ beside the request: version and sources of the solvers."""
    text = hashlib.sha256()
    sources = ("vibroimpact_solvers", "vibroimpact_service.decode", "vibroimpact_service.lattice")
    for package in sources:
        spec = importlib.util.find_spec(package)
        assert spec is not None
        assert spec.origin is not None
        file = Path(spec.origin)
        for source in sorted(file.parent.rglob("*.py")) if file.stem == "__init__" else [file]:
            text.update(source.read_bytes())
    return f"{SOLVER_VERSION}+{text.hexdigest()[:16]}"


class Known(NamedTuple):
    """A job's request as a process needs it for any of its chunks."""

    assignment: Assignment
    canonical: bytes
    pieces: list[Any]
    names: list[str]
    """Names of the chunks, one per piece."""


def request_block(owner: str, canonical: bytes) -> bytes:
    """Return what is stored of a request: whose it is, and its canonical form."""
    return digest.content(owner.encode()).encode() + b"\n" + canonical


@lru_cache(maxsize=4)
def _known(store_url: str, kind: str, request: str, seconds_each: float) -> Known:
    # Decoded and planned once per process, however many chunks of the job it computes.
    store = Store(store_url)
    data = store.requests.get(request)
    if data is None:
        raise FileNotFoundError("the request of the job is gone")
    owner, _, canonical = data.rpartition(b"\n")
    document = intake.document(KINDS[kind].request, orjson.loads(canonical))
    assignment = assign(store, KINDS[kind], document)
    pieces = assignment.kind.solver.split(assignment.problem, assignment.plan, seconds_each)
    return Known(assignment, canonical, pieces, _names(owner, assignment, document, pieces))


def _names(owner: bytes, assignment: Assignment, request: Any, pieces: list[Any]) -> list[str]:
    """Return the names of chunks: by content, so that other requests find what they share.

    Everything that the numbers of a piece depend on goes into its name: the request apart from
    the axis that is cut, the methods that the plan of the whole chose, and the piece's own
    points, bit for bit. The owner does too: a hit would reveal what somebody else asked.
    """
    kind, _, plan = assignment
    methods = [(step.stage.value, str(step.method)) for step in plan.steps]
    rest = request.model_dump(exclude_none=True, exclude={kind.axis} if kind.axis else None)
    common = digest.dumps({"request": rest, "methods": methods})
    name = digest.name(owner.decode(), kind.name, solver_name(), common)
    if kind.axis is None:
        contents = [f":{CHUNK_SECONDS}:{i}:{len(pieces)}".encode() for i in range(len(pieces))]
    else:
        contents = [kind.solver.content(piece) for piece in pieces]
    return [digest.content(name.encode() + content) for content in contents]


def split(store_url: str, kind: str, request: str, result: str) -> Sequence[Chunk]:
    """Return the chunks of a job."""
    known = _known(store_url, kind, request, CHUNK_SECONDS)
    each = seconds(known.assignment) / max(1, len(known.names))
    lasting = known.assignment.kind.axis is not None
    return [Chunk(name, each, lasting, _chained(known)) for name in known.names]


def _chained(known: Known) -> bool:
    """Whether each piece of a job needs the one before."""
    return len(known.pieces) > 1 and hasattr(known.assignment.kind.solver, "follow")


def solve(
    store_url: str,
    kind: str,
    request: str,
    result: str,
    indices: Sequence[int],
    tick: Tick | None = None,
) -> None:
    """Compute some chunks of a job and store each."""
    from vibroimpact_service import encode

    known = _known(store_url, kind, request, CHUNK_SECONDS)
    store, solver = Store(store_url), known.assignment.kind.solver
    if _chained(known):
        _follow(store, known, indices, tick)
        return
    for index in indices:
        if store.chunks.has(known.names[index]):
            continue  # the call is repeated because its worker died halfway
        # By the plan of the whole: one of the piece alone could take another method for it.
        values = solver.solve(known.pieces[index], known.assignment.plan, tick)
        store.chunks.put(known.names[index], encode.freeze(values, {}))


def _follow(store: Store, known: Known, indices: Sequence[int], tick: Tick | None) -> None:
    """Compute some pieces that need one another, and those before that are not there."""
    from vibroimpact_service import encode

    solver: Any = known.assignment.kind.solver
    last, before = -1, None
    for index in indices:
        if store.chunks.has(known.names[index]):
            continue
        # What was computed last is at hand; else the latest that is there is the seed.
        if last != index - 1:
            last, before = _latest(store, known, index)
        while last < index:
            before = solver.follow(known.pieces[last + 1], known.assignment.plan, before, tick)
            last += 1
            store.chunks.put(known.names[last], encode.freeze(before, {}))


def _latest(store: Store, known: Known, index: int) -> tuple[int, Any]:
    """Return the last piece before another that is there, and what it is; -1 where none is."""
    from vibroimpact_service import encode

    for place in range(index - 1, -1, -1):
        block = store.chunks.get(known.names[place])
        if block is not None:
            part: Any = encode.thaw(block, known.assignment.kind.solver.Part)  # type: ignore[attr-defined]
            return place, part
    return -1, None


def _assemble(store: Store, known: Known, result: str, chunks: Sequence[Chunk]) -> None:
    """Put pieces that are parts of one result together, in files, and store it."""
    from vibroimpact_service import encode

    solver: Any = known.assignment.kind.solver
    with store.results.workspace() as folder:
        with Spool(folder) as spool:
            assembly = solver.Assembly(known.assignment.problem, spool)
            for chunk in chunks:
                block = store.chunks.get(chunk.name)
                if block is None:
                    raise ChunkMissingError(chunk.name)
                assembly.add(encode.thaw(block, solver.Part))
            for name, values in assembly.labels().items():
                if values is not None:
                    spool.append(name, values)
        surroundings = head(result, known.assignment, known.canonical, _now())
        whole = folder / "whole"
        encode.freeze_file(solver.Result, spool, assembly.plain(), surroundings, whole)
        if not store.results.has(result):
            store.results.put_file(result, whole)


def join(store_url: str, kind: str, request: str, result: str, chunks: Sequence[Chunk]) -> None:
    """Put the chunks of a job together and store its result."""
    from vibroimpact_service import encode

    known = _known(store_url, kind, request, CHUNK_SECONDS)
    store, solver = Store(store_url), known.assignment.kind.solver
    if _chained(known):
        _assemble(store, known, result, chunks)
        return
    parts = []
    for chunk in chunks:
        block = store.chunks.get(chunk.name)
        if block is None:
            raise ChunkMissingError(chunk.name)
        parts.append(encode.thaw(block, solver.Result))
    whole = solver.join(known.assignment.problem, known.assignment.plan, parts)
    keep(store, result, known.assignment, known.canonical, whole)


def explain(error: BaseException) -> dict[str, Any]:
    """Return the problem document of a job that failed."""
    problem = problems.of(error)
    if isinstance(error, WorkerLostError):
        problem = ProblemError(problems.WORKER_LOST, problems.WORKER_LOST.about)
    elif isinstance(error, DeadlineError):
        problem = ProblemError(problems.DEADLINE, problems.DEADLINE.about)
    elif problem.type is problems.INTERNAL:
        log.error("computation failed", exc_info=error)
    document: dict[str, Any] = problem.document("job").model_dump(mode="json")
    return document


def prepare() -> None:
    """Load the numerical libraries before the first job needs them."""
    from vibroimpact_service import decode, encode, logs

    logs.to_stderr()
    log.debug("prepared", modules=[decode.__name__, encode.__name__])


WORK: Final = Work(
    split=split,
    solve=solve,
    join=join,
    explain=explain,
    prepare=prepare,
    modules=loading.NUMERICAL,
)
