"""What a computation does from request to stored result, here and in worker processes alike."""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Sequence
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
from vibroimpact_service import claims, digest, intake, problems
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
        system = stored_system(store, request.system, "system")
        request = request.model_copy(update={"system": system})
    if settings is not None:
        claims.check(request, settings)
    try:
        model = decode.system(request.system)
    except ModelError as error:
        raise problems.of(error.under("system")) from None
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


def compute(store: Store, result_name: str, assignment: Assignment, request: bytes) -> None:
    """Compute a result in one go and store it."""
    kind, problem, plan = assignment
    keep(store, result_name, assignment, request, kind.solver.solve(problem, plan))


def keep(
    store: Store, result_name: str, assignment: Assignment, request: bytes, result: Any
) -> None:
    """Store a result under its name, unless it is there already.

    What surrounds the numbers (when, by which version) is fixed here, once: whoever asks
    later gets the same bytes.
    """
    from vibroimpact_service import encode

    if store.results.has(result_name):
        return
    units = assignment.problem.system.units
    head = {
        "kind": assignment.kind.name,
        "digest": result_name,
        "request": request.decode(),
        "plan": plan_document(assignment.plan).model_dump(),
        "provenance": {
            "created": datetime.now(UTC).isoformat(timespec="milliseconds"),
            "solver_version": SOLVER_VERSION,
        },
        "units": None
        if units is None
        else {"length": units.length, "mass": units.mass, "time": units.time},
    }
    store.results.put(result_name, encode.freeze(result, head))


@cache
def solver_name() -> str:
    """Return what makes results differ beside the request: version and sources of the solvers."""
    text = hashlib.sha256()
    for package in ("vibroimpact_solvers", "vibroimpact_service.decode"):
        spec = importlib.util.find_spec(package)
        assert spec is not None
        assert spec.origin is not None
        file = Path(spec.origin)
        for source in sorted(file.parent.rglob("*.py")) if file.stem == "__init__" else [file]:
            text.update(source.read_bytes())
    return f"{SOLVER_VERSION}+{text.hexdigest()[:16]}"


@lru_cache(maxsize=4)
def _known(store_url: str, kind: str, request: str) -> tuple[Assignment, bytes]:
    # Decoded and planned once per process, however many chunks of the job it computes.
    store = Store(store_url)
    data = store.requests.get(request)
    if data is None:
        raise FileNotFoundError("the request of the job is gone")
    document = intake.document(KINDS[kind].request, orjson.loads(data))
    return assign(store, KINDS[kind], document), data


def _pieces(assignment: Assignment) -> list[Any]:
    kind, problem, plan = assignment
    return kind.solver.split(problem, plan, CHUNK_SECONDS)


def _chunk_name(result_name: str, index: int, count: int) -> str:
    return digest.content(f"{result_name}:{CHUNK_SECONDS}:{index}:{count}".encode())


def split(store_url: str, kind: str, request: str, result: str) -> Sequence[Chunk]:
    """Return the chunks of a job."""
    assignment, _ = _known(store_url, kind, request)
    count = len(_pieces(assignment))
    each = seconds(assignment) / max(1, count)
    return [Chunk(_chunk_name(result, index, count), each) for index in range(count)]


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

    assignment, _ = _known(store_url, kind, request)
    store, solver = Store(store_url), assignment.kind.solver
    pieces = _pieces(assignment)
    for index in indices:
        # By the plan of the whole: one of the piece alone could take another method for it.
        values = solver.solve(pieces[index], assignment.plan, tick)
        store.chunks.put(_chunk_name(result, index, len(pieces)), encode.freeze(values, {}))


def join(store_url: str, kind: str, request: str, result: str, chunks: Sequence[Chunk]) -> None:
    """Put the chunks of a job together and store its result."""
    from vibroimpact_service import encode

    assignment, data = _known(store_url, kind, request)
    store, solver = Store(store_url), assignment.kind.solver
    parts = []
    for chunk in chunks:
        block = store.chunks.get(chunk.name)
        if block is None:
            raise ChunkMissingError(chunk.name)
        parts.append(encode.thaw(block, solver.Result))
    whole = solver.join(assignment.problem, assignment.plan, parts)
    keep(store, result, assignment, data, whole)


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
    from vibroimpact_service import decode, encode

    log.debug("prepared", modules=[decode.__name__, encode.__name__])


WORK: Final = Work(split=split, solve=solve, join=join, explain=explain, prepare=prepare)
