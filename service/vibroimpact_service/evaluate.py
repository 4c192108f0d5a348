"""The use case: is it known, is it small enough to be done at once, or does it become a job."""

from __future__ import annotations

import asyncio
import base64
import threading
import time
import uuid
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

import structlog

from vibroimpact_schema.plans import Plan
from vibroimpact_schema.requests import BatchRequest, JobRequest
from vibroimpact_schema.service import StoredSystem
from vibroimpact_service import (
    batches,
    claims,
    digest,
    intake,
    negotiate,
    problems,
    representations,
    tasks,
)
from vibroimpact_service.jobs import webhooks
from vibroimpact_service.jobs.engine import EngineUnavailableError
from vibroimpact_service.jobs.ledger import KeyReusedError, NewJob
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.records import JobRow
from vibroimpact_service.jobs.spot import Compute
from vibroimpact_service.jobs.work import Tick, WorkerLostError
from vibroimpact_service.kinds import KINDS, Kind
from vibroimpact_service.metrics import Metrics
from vibroimpact_service.negotiate import Preference
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.representations import Representation, Shelf
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_solvers.errors import Cancelled
from vibroimpact_solvers.plan import Plan as PlanOfWork

Value = TypeVar("Value")

log = structlog.get_logger("vibroimpact.evaluate")

Admit = Callable[[PlanOfWork, float], Awaitable[None]]
"""Told the plan and its planned seconds before the work begins; raises where it must not."""

_SMALL_REQUEST: Final = 2**16
"""Bytes of a request up to which it stands in the records; larger ones stand in the store."""
_SHELF_BYTES: Final = 64 * 2**20
_SMALL_BODY: Final = 2**14
"""Bytes up to which a body is read on the event loop: handing it to a thread costs more."""
_LARGE_BODY: Final = 2**20
"""Bytes above which few bodies are read at a time: as objects they take some twenty times more."""

SYSTEM_TYPES: Final = (negotiate.JSON, "application/x-matrix-market", "application/x-npy")
"""Media types in which systems are taken."""


class OverrunError(Cancelled):
    """What was planned as small takes too long for an answer at once."""


class _Limit:
    """Stops a computation some time after it first told of its progress, or when all must end.

    What came before, such as the compilation of kernels, is not its own work.
    """

    def __init__(self, seconds: float, closing: threading.Event) -> None:
        self._seconds, self._closing = seconds, closing
        self._end: float | None = None

    def __call__(self, done: int, total: int) -> None:
        now = time.perf_counter()
        if self._end is None:
            self._end = now + self._seconds
        if now > self._end or self._closing.is_set():
            raise OverrunError


@dataclass(frozen=True, slots=True)
class Question:
    """A checked request, its canonical bytes and the name of its result."""

    owner: str
    kind: Kind
    request: Any
    canonical: bytes
    digest: str


@dataclass(frozen=True, slots=True)
class Terms:
    """On which terms a job is queued.

    Parameters
    ----------
    priority : int
    deadline : float, optional
        Seconds in which it must be done.
    webhook : tuple of str, optional
        Address that is told of its end, and the secret that signs the message.
    """

    priority: int = 0
    deadline: float | None = None
    webhook: tuple[str, str] | None = None


@dataclass(slots=True)
class Answer:
    """A result, how it came about and how long that took."""

    digest: str
    representation: Representation
    cache: str
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Landed:
    """A computation that ended here: its seconds, and whether it was one at all.

    It was not where an equal one had ended between the look for a result and its beginning.
    """

    solve: float
    encode: float
    computed: bool


_CACHE_STATUS: Final = {"hit": "hit", "miss": "fwd=miss", "collapsed": "fwd=miss; collapsed"}


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
    metrics : Metrics
    """

    def __init__(self, settings: Settings, store: Store, queue: JobQueue, metrics: Metrics) -> None:
        self._metrics = metrics
        self._settings, self._store, self.queue = settings, store, queue
        self._threads = ThreadPoolExecutor(settings.inline_threads, "inline")
        self._files = ThreadPoolExecutor(2, "files")
        self._closing = threading.Event()
        self._waiting = 0
        self._flights: dict[str, asyncio.Task[Landed]] = {}
        self._shelf = Shelf(_SHELF_BYTES)
        self._large = asyncio.Semaphore(2)
        self._loading: dict[tuple[str, str], asyncio.Future[Representation | None]] = {}

    def close(self) -> None:
        """Stop what is being computed: nobody waits for it any more."""
        self._closing.set()
        for threads in (self._threads, self._files):
            threads.shutdown(wait=False, cancel_futures=True)

    async def ask(self, owner: str, kind: Kind, body: bytes) -> Question:
        """Check the bytes of a request, off the event loop unless they are few."""

        def read() -> Question:
            return question(owner, kind, intake.parse(body))

        return await self._reading(body, read)

    async def ask_job(self, owner: str, body: bytes) -> tuple[Question, Terms]:
        """Check the bytes of a request for a job; return what it asks and on which terms."""

        def read() -> tuple[Question, Terms]:
            job = intake.document(JobRequest, intake.parse(body))
            kind = kind_named(job.kind, "kind")
            webhook = self._webhook(job)
            terms = Terms(job.priority, job.deadline_seconds, webhook)
            return question(owner, kind, job.request, "request"), terms

        return await self._reading(body, read)

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
        self,
        asked: Question,
        preference: Preference,
        media_type: str,
        admit: Admit,
        key: str | None = None,
    ) -> Answer | Queued:
        """Return the result of a request, or the job that will have it.

        An idempotency key is kept with the job; a result needs none, being named by its request.
        """
        if not preference.respond_async:
            known = await self.result(asked.digest, media_type)
            if known is not None:
                self._metrics.result(asked.kind.name, "hit")
                return Answer(asked.digest, known, "hit")
            started = time.perf_counter()
            assignment = await self._assign(asked)
            planned = time.perf_counter() - started
            if tasks.seconds(assignment) <= self._settings.inline_seconds:
                try:
                    return await self._at_once(asked, assignment, media_type, planned, admit)
                except OverrunError:
                    log.warning("longer than planned: becomes a job", kind=asked.kind.name)
        job = await self.submit(asked, admit, key)
        if preference.wait is not None:
            finished = await self.queue.finished(asked.owner, job.id, preference.wait)
            if finished is not None:
                job = finished
        if preference.wait is not None and job.state == "succeeded":
            result = await self.result(asked.digest, media_type)
            if result is not None:
                return Answer(asked.digest, result, "hit" if job.reused else "fwd=miss")
        return Queued(job)

    def _webhook(self, job: JobRequest) -> tuple[str, str] | None:
        if job.webhook is None:
            return None
        try:
            webhooks.check(job.webhook.url, private=self._settings.webhook_private)
        except webhooks.RefusedError as error:
            where = problems.pointer(("webhook", "url"))
            raise problems.invalid(where, "refused_address", str(error)) from None
        try:
            base64.b64decode(job.webhook.secret.removeprefix("whsec_"), validate=True)
        except ValueError:
            where = problems.pointer(("webhook", "secret"))
            raise problems.invalid(where, "wrong_format", "it is not base64") from None
        return job.webhook.url, job.webhook.secret

    async def submit(
        self, asked: Question, admit: Admit, key: str | None, terms: Terms | None = None
    ) -> JobRow:
        """Queue a computation and return its job, which is durable then.

        Raises
        ------
        ProblemError
            422 where the request is wrong as a whole or the key was used for another one.
        """
        terms = terms or Terms()
        await self._landed(asked.digest)
        reused = self._store.results.has(asked.digest)
        seconds, compute = 0.0, None
        if not reused:
            assignment = await self._assign(asked)
            seconds = tasks.seconds(assignment)
            if self.queue.takes(seconds):
                compute = self._compute(asked, assignment)
            else:
                await self._room(asked.owner)
            await admit(assignment.plan, seconds)
        self._metrics.result(asked.kind.name, "hit" if reused else "job")
        block = tasks.request_block(asked.owner, asked.canonical)
        name = digest.content(block)
        recorded = len(block) <= _SMALL_REQUEST
        if not recorded or not (reused or compute):
            # Workers look for it here. Where there is no room, there is none for results either.
            await self._thread(lambda: self._keep_request(name, block, durable=not recorded))
        new = NewJob(
            id=f"job_{uuid.uuid4().hex}",
            owner=asked.owner,
            kind=asked.kind.name,
            request=name,
            result=asked.digest,
            priority=terms.priority,
            seconds=seconds,
            reused=reused,
            key=key,
            deadline=terms.deadline,
            webhook=terms.webhook,
            block=block if recorded else None,
        )
        try:
            return await self.queue.submit(new, compute)
        except KeyReusedError:
            detail = "The Idempotency-Key stands for another request."
            raise ProblemError(problems.KEY_REUSED, detail) from None

    def _compute(self, asked: Question, assignment: tasks.Assignment) -> Compute:
        def compute(tick: Tick) -> None:
            tasks.compute(self._store, asked.digest, assignment, asked.canonical, tick)

        return compute

    async def result_of(self, job: JobRow, media_type: str) -> Representation | None:
        """Return the result of a job that succeeded, or None where it is no longer there.

        Those of quick jobs are not awaited to reach the disk. What a power failure took away
        is computed again, from the request in the records.
        """
        found = await self.result(job.result, media_type)
        if found is not None or job.lane != "quick":
            return found
        block = await self.queue.request(job.request)
        if block is None:
            return None
        _, _, canonical = block.rpartition(b"\n")
        asked = question(job.owner, KINDS[job.kind], intake.parse(canonical))
        if asked.digest != job.result:
            return None  # it was computed by other solvers than these
        assignment = await self._assign(asked)
        flight = self._flights.get(asked.digest)
        if flight is None:
            flight = self._take_off(asked, assignment, media_type)
        await asyncio.shield(flight)
        return await self.result(job.result, media_type)

    async def result(self, name: str, media_type: str) -> Representation | None:
        """Return a stored result in a media type, or None where there is none."""
        held = self._shelf.get(name, media_type)
        if held is not None:
            return held
        if not self._store.results.has(name):
            return None
        found = await self._loaded(name, media_type)
        if found is not None:
            self._shelf.put(name, found)
        return found

    async def batch(self, owner: str, body: bytes, admit: Admit) -> bytes:
        """Return the answers to many tiny requests, in their order, as one document.

        They are computed by the workers, where there are any, and kept nowhere.

        Raises
        ------
        ProblemError
            422 where the batch as a whole is wrong; what is wrong with one of its requests
            stands in the place of its answer.
        """

        def read() -> tuple[str, list[Any]]:
            asked = intake.document(BatchRequest, intake.parse(body))
            if len(asked.requests) > self._settings.batch_requests:
                message = f"A batch has at most {self._settings.batch_requests} requests."
                raise problems.too_large("/requests", "too_long", message)
            return kind_named(asked.kind, "kind").name, asked.requests

        kind, requests = await self._thread(read)
        # Charged at what they may cost at most: they are planned where they are computed.
        await admit(PlanOfWork(kind, ()), self._settings.batch_seconds * len(requests))
        found = await asyncio.gather(
            *(
                self._part(owner, kind, first, part)
                for first, part in batches.parts(requests, 2 * max(1, self.queue.engine.slots))
            )
        )
        return b'{"answers":[' + b",".join(each for part in found for each in part) + b"]}"

    async def _part(self, owner: str, kind: str, first: int, part: bytes) -> list[bytes]:
        arguments = (self._settings, owner, kind, part, first)
        try:
            return list(await self.queue.engine.run(batches.answers, *arguments))
        except (EngineUnavailableError, WorkerLostError):
            return await self._thread(lambda: batches.answers(*arguments, None))

    async def _loaded(self, name: str, media_type: str) -> Representation | None:
        """Load a representation; once for all who ask for it at the same time."""
        key = (name, media_type)
        loading = self._loading.get(key)
        if loading is None:
            # In threads of its own: to write a large file takes long.
            loading = self._loading[key] = asyncio.get_running_loop().run_in_executor(
                self._files, lambda: representations.load(self._store, name, media_type)
            )
            loading.add_done_callback(lambda done: self._loaded_once(key, done))
        return await asyncio.shield(loading)

    def _loaded_once(
        self, key: tuple[str, str], done: asyncio.Future[Representation | None]
    ) -> None:
        del self._loading[key]
        if not done.cancelled():
            done.exception()  # those who waited raise it; there may be none left

    async def coded(self, name: str, found: Representation, coding: str | None) -> Representation:
        """Return a representation in a content coding, where it is worth it."""
        if coding is None:
            return found
        held = self._shelf.get(name, found.media_type, coding)
        if held is None:
            held = await self._thread(lambda: found.coded(coding))
            self._shelf.put(name, held, coding)
        return held

    async def store_system(
        self, owner: str, media_type: str, body: bytes
    ) -> tuple[StoredSystem, bool]:
        """Store a system by content; return it, and whether it is new."""
        return await self._reading(body, lambda: self._store_system(owner, media_type, body))

    async def system(self, name: str) -> bytes | None:
        """Return a stored system's document."""
        return await self._thread(lambda: self._store.systems.get(name))

    def _store_system(self, owner: str, media_type: str, body: bytes) -> tuple[StoredSystem, bool]:
        if media_type == negotiate.JSON:
            document = intake.union(tasks.SYSTEM, intake.parse(body))
        else:
            from vibroimpact_service import upload  # the readers load at the first file

            document = upload.system(media_type, body, self._settings)
        if hasattr(document, "id"):
            tasks.check_reference(owner, document.id)
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
        self,
        asked: Question,
        assignment: tasks.Assignment,
        media_type: str,
        planned: float,
        admit: Admit,
    ) -> Answer:
        """Compute here, or share the computation of the same that is under way."""
        if asked.digest not in self._flights:
            await admit(assignment.plan, tasks.seconds(assignment))
        flight = self._flights.get(asked.digest)
        shared = flight is not None
        if flight is None:
            flight = self._take_off(asked, assignment, media_type)
        # Whoever asked may go away; the others still wait.
        landed = await asyncio.shield(flight)
        how = "collapsed" if shared else "miss" if landed.computed else "hit"
        self._metrics.result(asked.kind.name, how)
        started = time.perf_counter()
        result = await self.result(asked.digest, media_type)
        if result is None:
            raise ProblemError(problems.UNAVAILABLE, "The result was lost as it was stored.")
        encoded = landed.encode + time.perf_counter() - started
        spent = {"plan": planned, "solve": landed.solve, "encode": encoded}
        return Answer(asked.digest, result, _CACHE_STATUS[how], spent)

    def _take_off(
        self, asked: Question, assignment: tasks.Assignment, media_type: str
    ) -> asyncio.Task[Landed]:
        flight = asyncio.create_task(self._fly(asked, assignment, media_type))
        self._flights[asked.digest] = flight
        flight.add_done_callback(lambda done: self._land(asked.digest, done))
        return flight

    async def _fly(self, asked: Question, assignment: tasks.Assignment, media_type: str) -> Landed:
        def work() -> tuple[Landed, Representation | None]:
            name, started = asked.digest, time.perf_counter()
            data = None
            if not self._store.results.has(name):
                limit = _Limit(self._settings.inline_overrun_seconds, self._closing)
                data = tasks.compute(self._store, name, assignment, asked.canonical, limit)
            solved = time.perf_counter()
            found = None
            if data is not None and len(data) <= representations.LARGE:
                # Here, where the numbers are at hand; later they would be read again. It is
                # held in memory: most are never asked for again, and need not be written twice.
                found = representations.make(self._store, name, media_type, data, keep=False)
            encoding = time.perf_counter() - solved
            return Landed(solved - started, encoding, computed=data is not None), found

        landed, found = await self._thread(work)
        if found is not None:
            self._shelf.put(asked.digest, found)
        if landed.computed:
            methods = [step.method for step in assignment.plan.steps]
            planned = tasks.seconds(assignment)
            self._metrics.solved(asked.kind.name, methods, landed.solve, planned)
        return landed

    def _land(self, name: str, flight: asyncio.Task[Landed]) -> None:
        del self._flights[name]
        if not flight.cancelled():
            flight.exception()  # those who waited raise it; there may be none left

    async def _room(self, owner: str) -> None:
        """Refuse another job where too many of the owner's are unfinished."""
        most = self._settings.max_unfinished_jobs
        if await self.queue.unfinished(owner, most) >= most:
            detail = f"There are {most} unfinished jobs, the most that one owner may have."
            raise ProblemError(problems.TOO_MANY_JOBS, detail, headers={"Retry-After": "10"})

    async def _landed(self, name: str) -> None:
        """Wait for the computation of a result that is under way here."""
        flight = self._flights.get(name)
        if flight is not None:
            await asyncio.wait([flight])

    async def _assign(self, asked: Question) -> tasks.Assignment:
        return await self._thread(
            lambda: tasks.assign(self._store, asked.kind, asked.request, self._settings)
        )

    def _keep_request(self, name: str, data: bytes, *, durable: bool) -> None:
        if not self._store.requests.has(name):
            self._store.requests.put(name, data, durable=durable)

    async def _reading(self, body: bytes, read: Callable[[], Value]) -> Value:
        """Read a body where that disturbs nobody: few at a time where they are large."""
        if len(body) <= _SMALL_BODY:
            return read()
        if len(body) <= _LARGE_BODY:
            return await self._thread(read)
        async with self._large:
            return await self._thread(read)

    async def _thread(self, work: Callable[[], Value]) -> Value:
        if self._closing.is_set():
            raise ProblemError(problems.UNAVAILABLE, "The service ends.")
        if self._waiting >= self._settings.max_waiting:
            detail = f"{self._waiting} requests are waiting already."
            raise ProblemError(problems.UNAVAILABLE, detail, headers={"Retry-After": "1"})
        self._waiting += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self._threads, work)
        finally:
            self._waiting -= 1


def question(owner: str, kind: Kind, content: Any, *prefix: str) -> Question:
    """Return the checked request in some JSON content.

    Raises
    ------
    ProblemError
        422 with a pointer to each faulty field; `prefix` is the path to the content.
    """
    request = intake.document(kind.request, content, *prefix)
    canonical = digest.canonical(request)
    tasks.check_references(owner, canonical, content, *prefix)
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
