"""Drives several quick jobs with one call: what a call costs is shared by all of them."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any, Final

import structlog

from vibroimpact_service.jobs import calls, lease
from vibroimpact_service.jobs.drive import (
    ALONE_TRIES,
    ClosingError,
    Driver,
    LeaseLostError,
    Surroundings,
)
from vibroimpact_service.jobs.engine import FAST, Call, EngineUnavailableError
from vibroimpact_service.jobs.records import JobRow
from vibroimpact_service.jobs.work import WorkerLostError

log = structlog.get_logger("vibroimpact.jobs")

_LOOK_SECONDS: Final = 0.25
_DELAY: Final = 2.0


class Group(Driver):
    """The run of some quick jobs, in a thread of its own."""

    def __init__(self, held: Sequence[JobRow], around: Surroundings) -> None:
        super().__init__(held, around)
        self._wake = threading.Event()
        self._calls = 0

    def poke(self) -> None:
        """Let it look around."""
        self._wake.set()

    def run(self) -> None:
        """Drive the jobs to an end, or give them back."""
        try:
            self._run(list(self.held.values()))
        except LeaseLostError:
            log.info("jobs no longer ours", jobs=list(self.held))
        except (ClosingError, EngineUnavailableError):
            self._give_back()
        except calls.PASSING as error:
            self._give_back(_DELAY, str(error.strerror or error))

    def _give_back(self, seconds: float = 0.0, note: str | None = None) -> None:
        try:
            self.put_back(self.held, seconds, note)
        except (ClosingError, LeaseLostError):
            log.info("jobs left to their leases", jobs=list(self.held))

    def _run(self, jobs: list[JobRow]) -> None:
        store = self.around.store.results
        there = [job for job in jobs if store.sound(job.result)]
        if there:
            self._succeed(there, reused=True)
        missing = [job for job in jobs if job not in there]
        for job in missing:
            self.supply(job)
        if missing:
            error = self._call(missing)
            if isinstance(error, WorkerLostError):
                self._one_by_one(missing)
            else:
                self._report(missing, error)

    def _one_by_one(self, jobs: list[JobRow]) -> None:
        """Compute each alone; only the one that killed the worker fails (see `Drive.alone`)."""
        with self.quarantine():
            for job in jobs:
                for _ in range(ALONE_TRIES):
                    error = self._call([job])
                    if not isinstance(error, WorkerLostError):
                        break
                self._report([job], error)

    def _report(self, jobs: list[JobRow], error: BaseException | None) -> None:
        """Record how the jobs of a call ended."""
        failed: dict[int, dict[str, Any]] = {}
        delayed: dict[int, str] = {}
        if isinstance(error, calls.PartlyDoneError):
            failed, delayed = error.failed, error.delayed
        elif isinstance(error, EngineUnavailableError):
            raise error
        elif error is not None:
            failed = dict.fromkeys(range(len(jobs)), self.around.work.explain(error))
        well = [job for i, job in enumerate(jobs) if i not in failed and i not in delayed]
        if well:
            self._succeed(well, reused=False)
        for i, problem in failed.items():
            self.around.tell(self.write(lease.fail(self.around.me, jobs[i].id, problem)))
        for i, note in delayed.items():
            self.put_back([jobs[i].id], _DELAY, note)

    def _call(self, jobs: list[JobRow]) -> BaseException | None:
        url = self.around.store.url
        names = [(url, job.kind, job.request, job.result) for job in jobs]
        ended = threading.Event()

        def end(_: Call) -> None:
            ended.set()
            self._wake.set()

        self._calls += 1
        key = f"{jobs[0].id}-{jobs[0].attempts}-{self._calls}"
        engine = self.around.engine
        call = engine.submit(key, FAST, 0, end, calls.whole, self.around.work, names)
        try:
            while not ended.is_set():
                self._wake.wait(_LOOK_SECONDS)
                self._wake.clear()
                self.check()
        except BaseException:
            engine.forget([call])
            raise
        error = engine.error(call)
        call.future.release()
        return error

    def _succeed(self, jobs: list[JobRow], *, reused: bool) -> None:
        ended = self.write(lease.succeed(self.around.me, [job.id for job in jobs], reused))
        self.around.tell(ended)
