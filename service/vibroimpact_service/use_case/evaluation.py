"""The use case: a request is answered from the store, computed now, or becomes a job."""

from __future__ import annotations

import asyncio
import time
import uuid
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, TypeVar

import structlog

from vibroimpact_schema.branches import BranchesRequest
from vibroimpact_schema.calibrations import CalibrationRequest
from vibroimpact_schema.plans import Plan as PlanDocument
from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_service import problems
from vibroimpact_service.documents import digest, limits, parse, planning, requests
from vibroimpact_service.documents.planning import Planned
from vibroimpact_service.documents.requests import JobOptions, Request
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.records import KeyReusedError, NewJob
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.metrics import Metrics
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results import representations
from vibroimpact_service.results.representations import Representation, Results
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import computation
from vibroimpact_service.use_case.charges import Admission, Charge, admit
from vibroimpact_service.use_case.computation import Computed
from vibroimpact_service.use_case.threads import SUBMISSION_SECONDS, Threads, in_time
from vibroimpact_service.use_case.warming import Warming
from vibroimpact_solvers.meter import StoppedError, StopSignal

Value = TypeVar("Value")

log = structlog.get_logger("vibroimpact.evaluate")

_SMALL_REQUEST: Final = 2**16
"""Bytes of a request up to which it stands in the records; larger ones stand in the store."""
_FOR_JOB_SECONDS: Final = 0.25
"""Part of the time for which a caller waits that is left for what makes a job of it."""
_LEAST_SECONDS: Final = 1.0
"""What a plan and a record of a job may take where the caller waits for less: a short wait is for
the result, and the job that the caller gets instead needs both."""
_KEY_REUSED: Final = "The Idempotency-Key stands for another request."
_LOST_SECONDS: Final = 600.0
"""A lost result is computed again at most once in such a time."""
_CACHE_STATUS: Final = {"hit": "hit", "miss": "fwd=miss", "collapsed": "fwd=miss; collapsed"}


_PAID: Final = Admission(free=True)
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
        planned = await self._planned(request)
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

        An idempotency key stands for the request from now on, whatever answers it.
        While kernels are missing it becomes a job: this process would not answer anybody else
        while it compiled them. The caller waits for the job as long as for a result.
        """
        clock = asyncio.get_running_loop().time
        planned, wait = None, preference.wait
        until = None if wait is None else clock() + wait
        if key is not None:
            await self._keep_key(request, key)
        if not preference.respond_async:
            stored = await self.results.get(request.digest, media_type)
            if stored is not None:
                self._metrics.result(request.kind.name, "hit")
                return Answer(stored, "hit")
            if not self._is_warm(request):
                until = until or clock() + self._settings.inline_overrun_seconds
            else:
                seconds = None if wait is None else max(wait - _FOR_JOB_SECONDS, 0.5 * wait)
                try:
                    outcome = await self._now(request, media_type, admission, seconds)
                except StoppedError:
                    log.warning("longer than planned: becomes a job", kind=request.kind.name)
                else:
                    if isinstance(outcome, Answer):
                        return outcome
                    planned = outcome
        wanted = None if preference.respond_async else media_type
        recorded = None if until is None else max(until, clock() + _LEAST_SECONDS)
        job = await self.submit(
            request, admission, key, planned=planned, media_type=wanted, until=recorded
        )
        if until is not None:
            left = max(0.0, until - clock())
            job = await self.queue.wait(request.owner, job.id, left) or job
            if job.state == "succeeded":
                # What is too large to be read in the time left is read from the job.
                with suppress(TimeoutError):
                    async with asyncio.timeout_at(until):
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
        media_type: str | None = None,
        until: float | None = None,
    ) -> JobRow:
        """Queue a computation and return its job, which is durable then.

        Parameters
        ----------
        media_type : str, optional
            In which the caller wants the result; a result that is too large for it is refused.
        until : float, optional
            When the caller is to be answered, by the clock of the event loop.

        Raises
        ------
        ProblemError
            422 where the fields do not form a valid problem together, or the key was used for
            another request; 503 where nothing is known of the request when the time is over.
        """
        options, clock = options or JobOptions(), asyncio.get_running_loop().time
        left = None if until is None else max(0.0, 0.5 * (until - clock()))
        await self.threads.ended(request.digest, left)
        # A large file is read to be checked, which would hold up the event loop.
        results = self.store.results
        reused = results.has(request.digest) and await self.threads.run(
            lambda: results.readable(request.digest)
        )
        seconds, work, charge = 0.0, None, None
        if not reused:
            if planned is None:
                planned = await in_time(until, self._planned(request))
            if media_type is not None:
                representations.check_size(limits.least_bytes(planned.plan), media_type)
            seconds = planned.seconds
            soon = until is None or clock() + SUBMISSION_SECONDS < until
            at_once = soon and self._is_warm(request) and self.threads.accepts(seconds)
            at_once = at_once and not self.queue.computes(request.digest)
            if not at_once:
                await self.room_for_jobs(request.owner)
            await admit(request, admission, planned)
            if at_once:
                charge = Charge(admission, seconds, goes_on=True)
                work = charge.measured(self._work(request, planned))
        self._metrics.result(request.kind.name, "hit" if reused else "job")
        name, block = await self._keep_request(request, until, for_workers=not (reused or work))
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
            fingerprint=options.fingerprint(request.digest),
            deadline=options.deadline,
            webhook=options.webhook,
            name=options.name,
            block=block,
            account=admission.account,
        )
        if work is not None:
            shared = await self.threads.on_submission(request.digest, work)
            if shared and charge is not None:
                charge.give_back()
            if shared is not None and self.store.results.has(request.digest):
                new = replace(new, computed=not shared, reused=shared)
        return await self._record(new, admission)

    async def _record(self, new: NewJob, admission: Admission) -> JobRow:
        """Record a job; what was held is given back where it is not, or its key has another."""
        job: JobRow | None = None
        try:
            job = await self.queue.submit(new)
        except KeyReusedError:
            raise ProblemError(problems.KEY_REUSED, _KEY_REUSED) from None
        finally:
            if not new.done and (job is None or job.id != new.id):
                await admission.settle(new.seconds, 0.0)
        return job

    async def result_of(self, job: JobRow, media_type: str) -> Representation | None:
        """Return the result of a job that succeeded, or None where its request is gone too.

        Results of quick jobs are acknowledged before they are on disk. What a power failure
        took away, or what is damaged, is computed again from the request.
        """
        result = await self.results.get(job.result, media_type)
        if result is not None:
            return result
        block = await self.queue.request(job.request)
        if block is None:
            return None
        _, _, canonical = block.rpartition(b"\n")
        request = requests.read(job.owner, KINDS[job.kind], parse.json(canonical))
        if request.digest != job.result:
            return None  # it was computed by other solvers than these
        # However often it is asked for meanwhile, one job computes it.
        key = f"lost-{job.id}-{time.time() // _LOST_SECONDS:.0f}"
        outcome = await self.compute(request, Preference(), media_type, _PAID, key)
        if isinstance(outcome, Answer):
            return outcome.representation
        detail = "The result was lost and is being computed again."
        raise ProblemError(problems.UNAVAILABLE, detail, headers={"Retry-After": "5"})

    async def _now(
        self, request: Request, media_type: str, admission: Admission, seconds: float | None
    ) -> Answer | Planned:
        """Compute a result now, or return its plan where that would take too long.

        It is given up after the given time, if there is one, with `StoppedError`.

        Equal requests share one computation. Where the caller is charged, that comes between
        the plan and the computation; else both are one call in a thread.
        """
        planned, charge, name = None, None, request.digest
        if not admission.free:
            clock = asyncio.get_running_loop().time
            until = None if seconds is None else clock() + max(seconds, _LEAST_SECONDS)
            planned = await in_time(until, self._planned(request))
            if planned.seconds > self._settings.inline_seconds:
                return planned
            if not self.threads.running(name):
                await admit(request, admission, planned)
                charge = Charge(admission, planned.seconds)
        work = self._work(request, planned, media_type)
        if charge is not None:
            work = charge.measured(work)
        try:
            outcome, shared = await self.threads.once(name, work, seconds)
        finally:
            if charge is not None:
                charge.give_back()
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
        """Whether the kernels for a request are compiled, and those of its base."""
        kinds = [request.kind.name]
        if isinstance(request.document, SweepRequest | CalibrationRequest):
            kinds.append(request.document.root.kind)
        elif isinstance(request.document, BranchesRequest):
            kinds.append("periodic-motions")
        return all(self.warming.states[kind] == "warm" for kind in kinds)

    async def _planned(self, request: Request) -> Planned:
        """Plan a request in a thread, until it is cancelled."""
        plan = partial(planning.plan, self.store, request.kind, request.document, self._settings)
        return await self.threads.planned(plan)

    async def _keep_key(self, request: Request, key: str) -> None:
        """Let an idempotency key stand for a request.

        Raises
        ------
        ProblemError
            422 where it stands for another one.
        """
        try:
            await self.queue.keep_key(request.owner, key, request.digest)
        except KeyReusedError:
            raise ProblemError(problems.KEY_REUSED, _KEY_REUSED) from None

    def _work(
        self, request: Request, planned: Planned | None, media_type: str | None = None
    ) -> Callable[[StopSignal], Computed | Planned]:
        """Return the call that computes a result in a thread."""
        return partial(computation.now, self.store, self._settings, request, planned, media_type)

    def _computed(self, outcome: Computed | Planned) -> None:
        """Count what was computed, and hold it in memory."""
        if isinstance(outcome, Planned) or not outcome.fresh:
            return
        planned, result = outcome.planned, outcome.representation
        methods = [step.method for step in planned.plan.steps]
        self._metrics.solved(planned.kind.name, methods, outcome.seconds["solve"], planned.seconds)
        if result is not None:
            self.results.keep(outcome.digest, result)

    async def room_for_jobs(self, owner: str) -> int:
        """Return how many more unfinished jobs an owner may have.

        Raises
        ------
        ProblemError
            429 where it is none.
        """
        most = self._settings.max_unfinished_jobs
        unfinished = await self.queue.unfinished(owner, most)
        if unfinished >= most:
            detail = f"There are {most} unfinished jobs, the most that one owner may have."
            raise ProblemError(problems.TOO_MANY_JOBS, detail, headers={"Retry-After": "10"})
        return most - unfinished

    async def _keep_request(
        self, request: Request, until: float | None, *, for_workers: bool
    ) -> tuple[str, bytes | None]:
        """Store a request where it is large, or workers look for it.

        Returns
        -------
        tuple
            Its name, and its stored form if that is small and stands in the records.
        """
        block = requests.stored_form(request.owner, request.canonical)
        name, recorded = digest.content(block), len(block) <= _SMALL_REQUEST

        def keep() -> None:
            if not self.store.requests.readable(name):
                self.store.requests.put(name, block, durable=not recorded)

        if for_workers or not recorded:
            # Where there is no room for it, there is none for results either.
            await in_time(until, self.threads.run(keep))
        return name, block if recorded else None
