"""Jobs of the service: their state, waiting, cancelling, sharing, and their results."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from vibroimpact import conversations
from vibroimpact.errors import JobCancelled, JobFailed, ServerError
from vibroimpact.results import Result
from vibroimpact.systems import Document
from vibroimpact.transport import AsyncTransport, Transport

AnyJob = TypeVar("AnyJob")


class JobState:
    """The state of a job when it was last read from the service."""

    def __init__(self, document: Document) -> None:
        self.document = document

    @property
    def id(self) -> str:
        """The id of the job, with which `Client.job` finds it again."""
        return str(self.document["id"])

    @property
    def state(self) -> str:
        """Queued, running, succeeded, failed or cancelled."""
        return str(self.document["state"])

    @property
    def final(self) -> bool:
        """Whether the job has ended, so that its state will not change any more."""
        return bool(self.document["final"])

    @property
    def progress(self) -> tuple[int, int]:
        """How much of the work is done, and how much there is."""
        progress = self.document["progress"]
        return int(progress["done"]), int(progress["total"])

    def _note(self, document: Document) -> None:
        self.document = document

    def _require_success(self) -> None:
        if self.state == "failed":
            raise JobFailed(self.id, self.document.get("error") or {})
        if self.state == "cancelled":
            raise JobCancelled(f"job {self.id} was cancelled")

    @contextmanager
    def _shown(self, *, progress: bool) -> Iterator[Callable[[Document], None]]:
        """Yield the function to call with every change; with `progress` it updates a bar."""
        if not progress:
            yield self._note
            return
        from vibroimpact.progress import bar

        with bar(str(self.document["kind"])) as show:

            def note(document: Document) -> None:
                self._note(document)
                show(document)

            yield note

    def __repr__(self) -> str:
        """Return id, kind and state."""
        return f"<{type(self).__name__} {self.id} {self.document['kind']} {self.state}>"

    def _repr_html_(self) -> str:
        done, total = self.progress
        waiting = self.document.get("waiting_reason") or ""
        error = (self.document.get("error") or {}).get("detail", "")
        return (
            f"<b>{html.escape(str(self.document['kind']))}</b> <code>{html.escape(self.id)}</code> "
            f"{self.state} <progress max='{total or 1}' value='{done}'></progress> "
            f"{done}/{total} {html.escape(waiting or error)}"
        )


class Job(JobState):
    """A queued computation; `Client.submit` and `Client.job` return it."""

    def __init__(self, transport: Transport, document: Document) -> None:
        super().__init__(document)
        self._transport = transport

    def refresh(self, wait: float = 0.0) -> Job:
        """Read the job again, waiting up to `wait` seconds for a change."""
        self._note(self._transport.hold(conversations.look(self.document, wait)))
        return self

    def wait(self, timeout: float | None = None, *, progress: bool = False) -> Job:
        """Wait until the job has succeeded.

        Parameters
        ----------
        timeout : float, optional
            Longest wait in seconds; the job continues after it.
        progress : bool
            Show a progress bar.

        Raises
        ------
        JobFailed, JobCancelled, JobTimeout
        """
        with self._shown(progress=progress) as note:
            self._transport.hold(conversations.wait(self.document, timeout, note))
        self._require_success()
        return self

    def cancel(self) -> Job:
        """Cancel the job; one that has ended stays as it is."""
        self._note(self._transport.hold(conversations.cancel(self.document)))
        return self

    def share(self, *readers: str) -> list[str]:
        """Share the job and its result with exactly these owners; return them.

        Parameters
        ----------
        *readers : str
            Owners of keys; ``"*"``: every key with the scope read; none: stop sharing.
        """
        return self._transport.hold(conversations.share(self.document, readers))

    def readers(self) -> list[str]:
        """Return the owners with whom the job is shared."""
        return self._transport.hold(conversations.readers(self.document))

    def result(self) -> Result:
        """Return the result of the job, which must have succeeded."""
        return Result(self._transport.hold(conversations.job_result(self.document)))


class AsyncJob(JobState):
    """A queued computation whose methods are awaited; otherwise like `Job`."""

    def __init__(self, transport: AsyncTransport, document: Document) -> None:
        super().__init__(document)
        self._transport = transport

    async def refresh(self, wait: float = 0.0) -> AsyncJob:
        """Read the job again, waiting up to `wait` seconds for a change."""
        self._note(await self._transport.hold(conversations.look(self.document, wait)))
        return self

    async def wait(self, timeout: float | None = None, *, progress: bool = False) -> AsyncJob:
        """Wait until the job has succeeded; see `Job.wait`."""
        with self._shown(progress=progress) as note:
            await self._transport.hold(conversations.wait(self.document, timeout, note))
        self._require_success()
        return self

    async def cancel(self) -> AsyncJob:
        """Cancel the job; one that has ended stays as it is."""
        self._note(await self._transport.hold(conversations.cancel(self.document)))
        return self

    async def share(self, *readers: str) -> list[str]:
        """Share the job and its result; see `Job.share`."""
        return await self._transport.hold(conversations.share(self.document, readers))

    async def readers(self) -> list[str]:
        """Return the owners with whom the job is shared."""
        return await self._transport.hold(conversations.readers(self.document))

    async def result(self) -> Result:
        """Return the result of the job, which must have succeeded."""
        return Result(await self._transport.hold(conversations.job_result(self.document)))


@dataclass(frozen=True, slots=True)
class Submitted(Generic[AnyJob]):
    """The outcome of queueing many computations at once.

    Parameters
    ----------
    inserted : list
        Jobs that have something to compute.
    existing : list
        Jobs whose results already existed.
    errors : dict
        Index of a refused request -> its error.
    """

    inserted: list[AnyJob] = field(default_factory=list)
    existing: list[AnyJob] = field(default_factory=list)
    errors: dict[int, ServerError] = field(default_factory=dict)

    @property
    def jobs(self) -> list[AnyJob]:
        """All jobs."""
        return [*self.existing, *self.inserted]

    @classmethod
    def of(
        cls,
        answers: Sequence[Document | ServerError],
        make: Callable[[Document], AnyJob],
    ) -> Submitted[AnyJob]:
        """Sort the answer to each request, a job or an error."""
        submitted = cls()
        for index, answer in enumerate(answers):
            if isinstance(answer, ServerError):
                submitted.errors[index] = answer
            else:
                jobs = submitted.existing if answer["reused"] else submitted.inserted
                jobs.append(make(answer))
        return submitted
