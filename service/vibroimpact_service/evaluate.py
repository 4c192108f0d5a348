"""The use case: is it known, is it small enough to be done at once, or does it become a job."""

from __future__ import annotations

import asyncio
import time
import uuid
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

from vibroimpact_schema.plans import Plan
from vibroimpact_schema.requests import JobRequest
from vibroimpact_schema.service import StoredSystem
from vibroimpact_service import claims, digest, intake, problems, representations, tasks
from vibroimpact_service.jobs.ledger import KeyReusedError, NewJob
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.records import JobRow
from vibroimpact_service.kinds import KINDS, Kind
from vibroimpact_service.negotiate import Preference
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.representations import Representation, Shelf
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

Value = TypeVar("Value")

_SHELF_BYTES: Final = 64 * 2**20
_SMALL_BODY: Final = 2**14
"""Bytes up to which a body is read on the event loop: handing it to a thread costs more."""


@dataclass(frozen=True, slots=True)
class Question:
    """A checked request, its canonical bytes and the name of its result."""

    owner: str
    kind: Kind
    request: Any
    canonical: bytes
    digest: str


@dataclass(slots=True)
class Answer:
    """A result, how it came about and how long that took."""

    digest: str
    representation: Representation
    cache: str
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Queued:
    """A job in place of a result."""

    job: JobRow


class Evaluation:
    """Answers requests of all kinds.

    Parameters
    ----------
    settings : Settings
    store : Store
    queue : JobQueue
    """

    def __init__(self, settings: Settings, store: Store, queue: JobQueue) -> None:
        self._settings, self._store, self.queue = settings, store, queue
        self._threads = ThreadPoolExecutor(settings.inline_threads, "inline")
        self._flights: dict[str, asyncio.Task[dict[str, float]]] = {}
        self._shelf = Shelf(_SHELF_BYTES)

    def close(self) -> None:
        """Wait for what is being computed."""
        self._threads.shutdown()

    async def ask(self, owner: str, kind: Kind, body: bytes) -> Question:
        """Check the bytes of a request, off the event loop unless they are few."""

        def read() -> Question:
            return question(owner, kind, intake.parse(body))

        return read() if len(body) <= _SMALL_BODY else await self._thread(read)

    async def ask_job(self, owner: str, body: bytes) -> tuple[Question, int]:
        """Check the bytes of a request for a job; return what it asks and its priority."""

        def read() -> tuple[Question, int]:
            job = intake.document(JobRequest, intake.parse(body))
            kind = kind_named(job.kind, "kind")
            return question(owner, kind, job.request, "request"), job.priority

        return read() if len(body) <= _SMALL_BODY else await self._thread(read)

    async def plan(self, asked: Question) -> Plan:
        """Return what a computation would do, without doing it."""
        assignment = await self._assign(asked)
        seconds = tasks.seconds(assignment)
        return Plan(
            **tasks.plan_document(assignment.plan).model_dump(),
            kind=asked.kind.name,
            digest=asked.digest,
            seconds=seconds,
            cached=self._store.results.has(asked.digest),
            inline=seconds <= self._settings.inline_seconds,
        )

    async def compute(
        self, asked: Question, preference: Preference, media_type: str, key: str | None = None
    ) -> Answer | Queued:
        """Return the result of a request, or the job that will have it.

        An idempotency key is kept with the job; a result needs none, being named by its request.
        """
        if not preference.respond_async:
            known = await self.result(asked.digest, media_type)
            if known is not None:
                return Answer(asked.digest, known, "hit")
            started = time.perf_counter()
            assignment = await self._assign(asked)
            planned = time.perf_counter() - started
            if tasks.seconds(assignment) <= self._settings.inline_seconds:
                return await self._at_once(asked, assignment, media_type, planned)
        job = await self.submit(asked, priority=0, key=key)
        if preference.wait is not None:
            finished = await self.queue.finished(asked.owner, job.id, preference.wait)
            if finished is not None:
                job = finished
        if preference.wait is not None and job.state == "succeeded":
            result = await self.result(asked.digest, media_type)
            if result is not None:
                return Answer(asked.digest, result, "hit" if job.reused else "fwd=miss")
        return Queued(job)

    async def submit(self, asked: Question, priority: int, key: str | None) -> JobRow:
        """Queue a computation and return its job, which is durable then.

        Raises
        ------
        ProblemError
            422 where the request is wrong as a whole or the key was used for another one.
        """
        await self._landed(asked.digest)
        reused = self._store.results.has(asked.digest)
        seconds = 0.0
        if not reused:
            seconds = tasks.seconds(await self._assign(asked))
        name = digest.content(asked.canonical)
        await self._thread(lambda: self._keep_request(name, asked.canonical))
        new = NewJob(
            id=f"job_{uuid.uuid4().hex}",
            owner=asked.owner,
            kind=asked.kind.name,
            request=name,
            result=asked.digest,
            priority=priority,
            seconds=seconds,
            reused=reused,
            key=key,
        )
        try:
            return await self.queue.submit(new)
        except KeyReusedError:
            detail = "The Idempotency-Key stands for another request."
            raise ProblemError(problems.KEY_REUSED, detail) from None

    async def result(self, name: str, media_type: str) -> Representation | None:
        """Return a stored result in a media type, or None where there is none."""
        held = self._shelf.get(name, media_type)
        if held is not None:
            return held
        if not self._store.results.has(name):
            return None
        found = await self._thread(lambda: representations.load(self._store, name, media_type))
        if found is not None:
            self._shelf.put(name, found)
        return found

    async def store_system(self, owner: str, body: bytes) -> tuple[StoredSystem, bool]:
        """Store a system by content; return it, and whether it is new."""
        return await self._thread(lambda: self._store_system(owner, body))

    async def system(self, name: str) -> bytes | None:
        """Return a stored system's document."""
        return await self._thread(lambda: self._store.systems.get(name))

    def _store_system(self, owner: str, body: bytes) -> tuple[StoredSystem, bool]:
        document = intake.union(tasks.SYSTEM, intake.parse(body))
        if hasattr(document, "id"):
            document = tasks.stored_system(self._store, document)
        claims.check_system(document, self._settings)
        system = tasks.checked_system(document)
        data = digest.canonical(document)
        name = f"sys_{digest.name(owner, 'system', '', data)}"
        new = not self._store.systems.has(name)
        if new:
            self._store.systems.put(name, data)
        return StoredSystem(id=name, n=system.n, constraints=len(system.constraints)), new

    async def _at_once(
        self, asked: Question, assignment: tasks.Assignment, media_type: str, planned: float
    ) -> Answer:
        """Compute here, or share the computation of the same that is under way."""
        flight = self._flights.get(asked.digest)
        cache = "fwd=miss" if flight is None else "fwd=miss; collapsed"
        if flight is None:
            flight = asyncio.create_task(self._fly(asked, assignment))
            self._flights[asked.digest] = flight
            flight.add_done_callback(lambda done: self._land(asked.digest, done))
        # Whoever asked may go away; the others still wait.
        seconds = await asyncio.shield(flight)
        started = time.perf_counter()
        result = await self.result(asked.digest, media_type)
        if result is None:
            raise ProblemError(problems.UNAVAILABLE, "The result was lost as it was stored.")
        encoded = time.perf_counter() - started
        return Answer(asked.digest, result, cache, {"plan": planned, **seconds, "encode": encoded})

    async def _fly(self, asked: Question, assignment: tasks.Assignment) -> dict[str, float]:
        def work() -> float:
            started = time.perf_counter()
            if not self._store.results.has(asked.digest):
                tasks.compute(self._store, asked.digest, assignment, asked.canonical)
            return time.perf_counter() - started

        return {"solve": await self._thread(work)}

    def _land(self, name: str, flight: asyncio.Task[dict[str, float]]) -> None:
        del self._flights[name]
        if not flight.cancelled():
            flight.exception()  # those who waited raise it; there may be none left

    async def _landed(self, name: str) -> None:
        """Wait for the computation of a result that is under way here."""
        flight = self._flights.get(name)
        if flight is not None:
            await asyncio.wait([flight])

    async def _assign(self, asked: Question) -> tasks.Assignment:
        return await self._thread(
            lambda: tasks.assign(self._store, asked.kind, asked.request, self._settings)
        )

    def _keep_request(self, name: str, data: bytes) -> None:
        if not self._store.requests.has(name):
            self._store.requests.put(name, data)

    async def _thread(self, work: Callable[[], Value]) -> Value:
        return await asyncio.get_running_loop().run_in_executor(self._threads, work)


def question(owner: str, kind: Kind, content: Any, *prefix: str) -> Question:
    """Return the checked request in some JSON content.

    Raises
    ------
    ProblemError
        422 with a pointer to each faulty field; `prefix` is the path to the content.
    """
    request = intake.document(kind.request, content, *prefix)
    canonical = digest.canonical(request)
    name = digest.name(owner, kind.name, tasks.solver_name(), canonical)
    return Question(owner, kind, request, canonical, name)


def kind_named(name: str, *prefix: str) -> Kind:
    """Return the kind of that name.

    Raises
    ------
    ProblemError
        422 where there is none.
    """
    if name not in KINDS:
        where = problems.pointer(prefix)
        message = f"must be one of {', '.join(KINDS)}"
        raise problems.invalid(where, "unknown_choice", message)
    return KINDS[name]
