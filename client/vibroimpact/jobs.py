"""Jobs on the service: look at them, wait for them, cancel them, take their results."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from vibroimpact import conversations
from vibroimpact.errors import JobCancelled, JobFailed, ServerError
from vibroimpact.results import Result
from vibroimpact.transport import AsyncTransport, Transport

AnyJob = TypeVar("AnyJob")
Document = dict[str, Any]


class JobState:
    """What a job was when last looked at."""

    def __init__(self, document: Document) -> None:
        self.document = document

    @property
    def id(self) -> str:
        """Its id; `Client.job` finds it again by it."""
        return str(self.document["id"])

    @property
    def state(self) -> str:
        """Queued, running, succeeded, failed or cancelled."""
        return str(self.document["state"])

    @property
    def final(self) -> bool:
        """Whether the state will not change any more."""
        return bool(self.document["final"])

    @property
    def progress(self) -> tuple[int, int]:
        """How much is done, of how much."""
        done = self.document["progress"]
        return int(done["done"]), int(done["total"])

    def _note(self, document: Document) -> None:
        self.document = document

    def _require_success(self) -> None:
        if self.state == "failed":
            raise JobFailed(self.id, self.document.get("error") or {})
        if self.state == "cancelled":
            raise JobCancelled(f"job {self.id} was cancelled")

    @contextmanager
    def _shown(self, *, progress: bool) -> Iterator[Callable[[Document], None]]:
        """Yield what takes note of changes, and shows them in a bar where that is wanted."""
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
        told = self.document.get("waiting_reason") or ""
        error = (self.document.get("error") or {}).get("detail", "")
        return (
            f"<b>{html.escape(str(self.document['kind']))}</b> <code>{html.escape(self.id)}</code> "
            f"{self.state} <progress max='{total or 1}' value='{done}'></progress> "
            f"{done}/{total} {html.escape(told or error)}"
        )


class Job(JobState):
    """A queued computation.

    Parameters
    ----------
    transport : Transport
    document : dict
        The job as the service describes it.
    """

    def __init__(self, transport: Transport, document: Document) -> None:
        super().__init__(document)
        self._transport = transport

    def refresh(self, wait: float = 0.0) -> Job:
        """Look at it again, waiting up to so many seconds for a change."""
        self._note(self._transport.hold(conversations.look(self.document, wait)))
        return self

    def wait(self, timeout: float | None = None, *, progress: bool = False) -> Job:
        """Wait until it ended well.

        Parameters
        ----------
        timeout : float, optional
            Longest wait in seconds; the job goes on after it.
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
        """Cancel it; nothing happens to a job that ended."""
        self._note(self._transport.hold(conversations.cancel(self.document)))
        return self

    def share(self, *readers: str) -> list[str]:
        """Let exactly these see it and its result; return them.

        Parameters
        ----------
        *readers : str
            Owners of keys; ``"*"``: whoever has a key that may read; none: nobody else.
        """
        return self._transport.hold(conversations.share(self.document, readers))

    def readers(self) -> list[str]:
        """Return who else may see it."""
        return self._transport.hold(conversations.readers(self.document))

    def result(self) -> Result:
        """Return the result of a job that succeeded."""
        return Result(self._transport.hold(conversations.job_result(self.document)))


class AsyncJob(JobState):
    """A queued computation, waited for asynchronously; otherwise as `Job`."""

    def __init__(self, transport: AsyncTransport, document: Document) -> None:
        super().__init__(document)
        self._transport = transport

    async def refresh(self, wait: float = 0.0) -> AsyncJob:
        """Look at it again, waiting up to so many seconds for a change."""
        self._note(await self._transport.hold(conversations.look(self.document, wait)))
        return self

    async def wait(self, timeout: float | None = None, *, progress: bool = False) -> AsyncJob:
        """Wait until it ended well; raises as `Job.wait`."""
        with self._shown(progress=progress) as note:
            await self._transport.hold(conversations.wait(self.document, timeout, note))
        self._require_success()
        return self

    async def cancel(self) -> AsyncJob:
        """Cancel it; nothing happens to a job that ended."""
        self._note(await self._transport.hold(conversations.cancel(self.document)))
        return self

    async def share(self, *readers: str) -> list[str]:
        """Let exactly these see it and its result, as `Job.share`."""
        return await self._transport.hold(conversations.share(self.document, readers))

    async def readers(self) -> list[str]:
        """Return who else may see it."""
        return await self._transport.hold(conversations.readers(self.document))

    async def result(self) -> Result:
        """Return the result of a job that succeeded."""
        return Result(await self._transport.hold(conversations.job_result(self.document)))


@dataclass(frozen=True, slots=True)
class Submitted(Generic[AnyJob]):
    """What became of many computations that were queued at once.

    Parameters
    ----------
    inserted : list
        Jobs that will do work.
    existing : list
        Jobs whose results were there already.
    errors : dict
        Place of a request -> the problem that it met.
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
        found: Sequence[Document | ServerError],
        make: Callable[[Document], AnyJob],
    ) -> Submitted[AnyJob]:
        """Sort what was found."""
        sorted_out = cls()
        for place, one in enumerate(found):
            if isinstance(one, ServerError):
                sorted_out.errors[place] = one
            else:
                jobs = sorted_out.existing if one["reused"] else sorted_out.inserted
                jobs.append(make(one))
        return sorted_out
