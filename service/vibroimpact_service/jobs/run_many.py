"""The run of several quick jobs by one call, which shares the cost of a call among them."""

from __future__ import annotations

from typing import Any

from vibroimpact_service.jobs import worker
from vibroimpact_service.jobs.engine import FAST, EngineUnavailableError
from vibroimpact_service.jobs.run import SUSPECT_ERRORS, Run, suspect
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.jobs.work import TRANSIENT_ERRORS


class QuickRun(Run):
    """The run of several quick jobs; see the module."""

    def _run(self) -> None:
        store = self.context.store.results
        stored = [job for job in self.jobs.values() if store.readable(job.result)]
        if stored:
            self.succeed([job.id for job in stored], reused=True)
        missing = [job for job in self.jobs.values() if job not in stored and self._ensured(job)]
        if not missing:
            return
        self.called = missing
        arguments = [self.arguments(job) for job in missing]
        most = self.context.max_chunks_bytes
        _, error = self.call(FAST, worker.complete, arguments, most)
        alone = len(missing) == 1
        if not isinstance(error, SUSPECT_ERRORS) or (alone and not suspect(error)):
            self._record(missing, error)
            return
        for job in missing:  # only the one that killed the worker fails
            self.called = [job]
            _, error = self.repeat_alone(worker.complete, [self.arguments(job)], most)
            self._record([job], error)

    def _ensured(self, job: JobRow) -> bool:
        """Whether the workers can have the request of a job, which fails if they cannot."""
        try:
            self.ensure_request(job)
        except LookupError as error:
            self.fail([job.id], self.context.work.explain(error))
            return False
        return True

    def _record(self, jobs: list[JobRow], error: BaseException | None) -> None:
        """Record how the jobs of a call ended."""
        failed: dict[int, dict[str, Any]] = {}
        delayed: dict[int, str] = {}
        if isinstance(error, worker.PartlyDoneError):
            failed, delayed = error.failed, error.delayed
        elif error is not None:
            if isinstance(error, (EngineUnavailableError, *TRANSIENT_ERRORS)):
                raise error
            failed = dict.fromkeys(range(len(jobs)), self.context.work.explain(error))
        succeeded = [j.id for i, j in enumerate(jobs) if i not in failed and i not in delayed]
        if succeeded:
            self.succeed(succeeded, reused=False)
        for i, problem in failed.items():
            self.fail([jobs[i].id], problem)
        for i, note in delayed.items():
            self.put_back([jobs[i].id], "delayed", note)
