"""The use case: a request is answered from the store, computed now, or becomes a job."""

from __future__ import annotations

import uuid
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import structlog

from vibroimpact_schema.plans import Plan as PlanDocument
from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_service import execute, problems
from vibroimpact_service.documents import digest, parse, planning, requests
from vibroimpact_service.documents.planning import Planned
from vibroimpact_service.documents.requests import JobOptions, Request
from vibroimpact_service.execute import Computed
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.records import KeyReusedError, NewJob
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.jobs.work import StoppedError, StopSignal
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.metrics import Metrics
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results.collection import Results
from vibroimpact_service.results.representations import Representation
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_service.threads import Threads
from vibroimpact_service.warming import Warming
from vibroimpact_solvers.plan import Plan

log = structlog.get_logger("vibroimpact.evaluate")

_SMALL_REQUEST: Final = 2**16
"""Bytes of a request up to which it stands in the records; larger ones stand in the store."""
_CACHE_STATUS: Final = {"hit": "hit", "miss": "fwd=miss", "collapsed": "fwd=miss; collapsed"}


@dataclass(frozen=True, slots=True)
class Admission:
    """Whether the caller may have a computation done.

    Parameters
    ----------
    charge : callable
        ``await charge(plan, seconds)`` charges a planned computation to the caller, and raises
        `ProblemError` where it costs too much.
    free : bool
        Whether `charge` does nothing for what is computed at once.
    """

    charge: Callable[[Plan, float], Awaitable[None]]
    free: bool = False


async def _nothing(_plan: Plan, _seconds: float) -> None:
    """Charge nothing."""


_PAID: Final = Admission(_nothing, free=True)
"""For what was charged before."""


@dataclass(frozen=True, slots=True)
class Preference:
    """Preferences of Prefer (RFC 7240): an answer by a job, and the wait before it."""

    respond_async: bool = False
    wait: float | None = None


@dataclass(frozen=True, slots=True)
class Answer:
    """A result."""

    representation: Representation
    cache: str
    """Value of Cache-Status."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Stage (``plan``, ``solve``, ``encode``) -> time that it took."""


class Evaluation:
    """Answers requests of all kinds."""

    def __init__(
        self,
        settings: Settings,
        store: Store,
        queue: JobQueue,
        metrics: Metrics,
        warming: Warming | None = None,
    ) -> None:
        self._settings, self._metrics = settings, metrics
        self.warming = warming or Warming()
        self.store, self.queue = store, queue
        self.threads = Threads(settings, self._computed)
        self.results = Results(store)

    def close(self) -> None:
        """Stop what is being computed; store what was answered."""
        self.threads.close()
        self.results.close()

    async def plan(self, request: Request) -> PlanDocument:
        """Return what a computation would do, without doing it."""
        planned = await self.threads.run(lambda: self._plan(request))
        return PlanDocument(
            **planning.steps(planned.plan),
            kind=request.kind.name,
            digest=request.digest,
            seconds=planned.seconds,
            cached=self.store.results.has(request.digest),
            inline=planned.seconds <= self._settings.inline_seconds,
        )

    async def compute(
        self,
        request: Request,
        preference: Preference,
        media_type: str,
        admission: Admission,
        key: str | None = None,
    ) -> Answer | JobRow:
        """Return the result of a request, or the job that will have it.

        An idempotency key is kept with the job; a result needs none, being named by its request.
        While kernels are missing it becomes a job: this process would not answer anybody else
        while it compiled them. The caller waits for the job as long as for a result.
        """
        planned, wait = None, preference.wait
        if not preference.respond_async:
            stored = await self.results.get(request.digest, media_type)
            if stored is not None:
                self._metrics.result(request.kind.name, "hit")
                return Answer(stored, "hit")
            if not self._is_warm(request):
                wait = self._settings.inline_overrun_seconds if wait is None else wait
            else:
                try:
                    outcome = await self._now(request, media_type, admission)
                except StoppedError:
                    log.warning("longer than planned: becomes a job", kind=request.kind.name)
                else:
                    if isinstance(outcome, Answer):
                        return outcome
                    planned = outcome
        job = await self.submit(request, admission, key, planned=planned)
        if wait is not None:
            job = await self.queue.wait(request.owner, job.id, wait) or job
            if job.state == "succeeded":
                result = await self.results.get(request.digest, media_type)
                if result is not None:
                    return Answer(result, "hit" if job.reused else "fwd=miss")
        return job

    async def submit(
        self,
        request: Request,
        admission: Admission,
        key: str | None,
        options: JobOptions | None = None,
        planned: Planned | None = None,
    ) -> JobRow:
        """Queue a computation and return its job, which is durable then.

        Raises
        ------
        ProblemError
            422 where the fields do not form a valid problem together, or the key was used for
            another request.
        """
        options = options or JobOptions()
        await self.threads.ended(request.digest)
        reused = self.store.results.has(request.digest)
        seconds, work = 0.0, None
        if not reused:
            if planned is None:
                planned = await self.threads.run(lambda: self._plan(request))
            seconds = planned.seconds
            at_once = self._is_warm(request) and self.threads.accepts(seconds)
            if at_once and not self.queue.computes(request.digest):
                work = self._work(request, planned)
            else:
                await self._check_unfinished(request.owner)
            await admission.charge(planned.plan, seconds)
        self._metrics.result(request.kind.name, "hit" if reused else "job")
        block = requests.stored_form(request.owner, request.canonical)
        name = digest.content(block)
        recorded = len(block) <= _SMALL_REQUEST
        if not recorded or not (reused or work):
            # Workers look for it here. Where there is no room, there is none for results either.
            await self.threads.run(lambda: self._keep_request(name, block, durable=not recorded))
        new = NewJob(
            id=f"job_{uuid.uuid4().hex}",
            owner=request.owner,
            kind=request.kind.name,
            request=name,
            result=request.digest,
            priority=options.priority,
            seconds=seconds,
            reused=reused,
            key=key,
            deadline=options.deadline,
            webhook=options.webhook,
            block=block if recorded else None,
        )
        if work is not None:
            shared = await self.threads.on_submission(request.digest, work)
            if shared is not None and self.store.results.has(request.digest):
                new = replace(new, computed=not shared, reused=shared)
        try:
            return await self.queue.submit(new)
        except KeyReusedError:
            detail = "The Idempotency-Key stands for another request."
            raise ProblemError(problems.KEY_REUSED, detail) from None

    async def result_of(self, job: JobRow, media_type: str) -> Representation | None:
        """Return the result of a job that succeeded, or None where it is no longer there.

        Results of quick jobs are acknowledged before they are on disk. What a power failure
        took away is computed again, from the request in the records.
        """
        result = await self.results.get(job.result, media_type)
        if result is not None or job.queue != "quick":
            return result
        block = await self.queue.request(job.request)
        if block is None:
            return None
        _, _, canonical = block.rpartition(b"\n")
        request = requests.read(job.owner, KINDS[job.kind], parse.json(canonical))
        if request.digest != job.result:
            return None  # it was computed by other solvers than these
        outcome = await self.compute(request, Preference(), media_type, _PAID)
        if isinstance(outcome, Answer):
            return outcome.representation
        detail = "The result was lost and is being computed again."
        raise ProblemError(problems.UNAVAILABLE, detail, headers={"Retry-After": "5"})

    async def _now(
        self, request: Request, media_type: str, admission: Admission
    ) -> Answer | Planned:
        """Compute a result now, or return its plan where that would take too long.

        Equal requests share one computation. Where the caller is charged, that comes between
        the plan and the computation; else both are one call in a thread.
        """
        planned, name = None, request.digest
        if not admission.free:
            planned = await self.threads.run(lambda: self._plan(request))
            if planned.seconds > self._settings.inline_seconds:
                return planned
            if not self.threads.running(name):
                await admission.charge(planned.plan, planned.seconds)
        work = self._work(request, planned, media_type)
        outcome, shared = await self.threads.once(name, work)
        if isinstance(outcome, Planned):
            return outcome
        how = "collapsed" if shared else "miss" if outcome.fresh else "hit"
        self._metrics.result(request.kind.name, how)
        result = outcome.representation
        if result is None or result.media_type != media_type:
            result = await self.results.get(name, media_type)
        if result is None:
            raise ProblemError(
                problems.UNAVAILABLE,
                "The result was computed but is not in the store; send the request again.",
            )
        return Answer(result, _CACHE_STATUS[how], outcome.seconds)

    def _is_warm(self, request: Request) -> bool:
        """Whether the kernels for a request are compiled; those of a sweep are its base's too."""
        kinds = [request.kind.name]
        if isinstance(request.document, SweepRequest):
            kinds.append(request.document.root.kind)
        return self.warming.is_warm(*kinds)

    def _plan(self, request: Request) -> Planned:
        return planning.plan(self.store, request.kind, request.document, self._settings)

    def _work(
        self, request: Request, planned: Planned | None, media_type: str | None = None
    ) -> Callable[[StopSignal], Computed | Planned]:
        """Return the call that computes a result in a thread."""
        return partial(execute.now, self.store, self._settings, request, planned, media_type)

    def _computed(self, outcome: Computed | Planned) -> None:
        """Count what was computed, and hold it in memory."""
        if isinstance(outcome, Planned) or not outcome.fresh:
            return
        planned, result = outcome.planned, outcome.representation
        methods = [step.method for step in planned.plan.steps]
        self._metrics.solved(planned.kind.name, methods, outcome.seconds["solve"], planned.seconds)
        if result is not None:
            self.results.keep(outcome.digest, result)

    async def _check_unfinished(self, owner: str) -> None:
        """Refuse another job where too many of the owner's are unfinished."""
        most = self._settings.max_unfinished_jobs
        if await self.queue.unfinished(owner, most) >= most:
            detail = f"There are {most} unfinished jobs, the most that one owner may have."
            raise ProblemError(problems.TOO_MANY_JOBS, detail, headers={"Retry-After": "10"})

    def _keep_request(self, name: str, data: bytes, *, durable: bool) -> None:
        if not self.store.requests.has(name):
            self.store.requests.put(name, data, durable=durable)
