"""Jobs of the service: their state, waiting, cancelling, sharing, and their results."""

from __future__ import annotations

import html
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from vibroimpact import conversations
from vibroimpact.errors import JobCancelled, JobFailed, ServerError
from vibroimpact.kinds import read
from vibroimpact.results import Result
from vibroimpact.tables import html_table
from vibroimpact.transport import AsyncTransport, Transport

if TYPE_CHECKING:
    from vibroimpact import documents

AnyJob = TypeVar("AnyJob")


class JobState:
    """The state of a job when it was last read from the service."""

    def __init__(self, document: documents.Job) -> None:
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

    @property
    def history(self) -> list[documents.Attempt]:
        """The attempts at the job, the earliest first: worker, began, ended and why.

        Lists and events do not carry them: `refresh` reads them.
        """
        return list(self.document.get("history") or ())

    def _note(self, document: documents.Job) -> None:
        self.document = document

    def _require_success(self) -> None:
        if self.state == "failed":
            problem: Any = self.document.get("error") or {}
            raise JobFailed(self.id, problem)
        if self.state == "cancelled":
            raise JobCancelled(f"job {self.id} was cancelled")

    @contextmanager
    def _shown(self, *, progress: bool) -> Iterator[Callable[[documents.Job], None]]:
        """Yield the function to call with every change; with `progress` it updates a bar."""
        if not progress:
            yield self._note
            return
        from vibroimpact.progress import bar

        with bar(str(self.document["kind"])) as show:
            show(self.document)

            def note(document: documents.Job) -> None:
                self._note(document)
                show(document)

            yield note

    def __repr__(self) -> str:
        """Return id, kind and state."""
        return f"<{type(self).__name__} {self.id} {self.document['kind']} {self.state}>"

    def _repr_html_(self) -> str:
        done, total = self.progress
        waiting = self.document.get("waiting_reason") or ""
        error = problem["detail"] if (problem := self.document.get("error")) else ""
        return (
            f"<b>{html.escape(str(self.document['kind']))}</b> <code>{html.escape(self.id)}</code> "
            f"{self.state} <progress max='{total or 1}' value='{done}'></progress> "
            f"{done}/{total} {html.escape(waiting or error)}"
        )


class Jobs(Iterator["Job"]):
    """Jobs, one after the other; displayed, a table of the next ones.

    What is displayed is read from the service then, and still comes when one goes on.
    """

    def __init__(self, jobs: Iterator[Job]) -> None:
        self._ahead: deque[Job] = deque()
        self._jobs = jobs

    def __next__(self) -> Job:
        """Return the next one."""
        return self._ahead.popleft() if self._ahead else next(self._jobs)

    def _rows(self) -> list[list[str]]:
        self._ahead.extend(islice(self._jobs, max(0, _SHOWN_JOBS - len(self._ahead))))
        return [_row(job.document) for job in islice(self._ahead, _SHOWN_JOBS)]

    def __repr__(self) -> str:
        """Return a table of the next jobs."""
        rows = self._rows()
        if not rows:
            return "no jobs"
        widths = [max(map(len, column)) for column in zip(_HEAD, *rows, strict=True)]
        lines = [_HEAD, *rows]
        return "\n".join(
            "  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip()
            for line in lines
        )

    def _repr_html_(self) -> str:
        return html_table(_HEAD, self._rows())


_HEAD = ["id", "state", "done", "created", "kind", "name"]
_SHOWN_JOBS = 20


def _row(document: documents.Job) -> list[str]:
    done = document["progress"]
    progress = f"{done['done']}/{done['total']}"
    created = str(document["created"])[:19].replace("T", " ")
    name = document.get("name") or ""  # earlier services have none
    return [document["id"], document["state"], progress, created, document["kind"], name]


class Job(JobState):
    """A queued computation; `Client.submit` and `Client.job` return it."""

    def __init__(self, transport: Transport, document: documents.Job) -> None:
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

    def result(self, path: str | Path | None = None) -> Result:
        """Return the result of the job, which must have succeeded.

        Parameters
        ----------
        path : path, optional
            File to which the result goes piece by piece instead of to memory; its arrays are read
            as they are used.
        """
        to = None if path is None else Path(path)
        exchange = conversations.job_result(self.document, to, self._transport.cache)
        return read(self._transport.hold(exchange))


class AsyncJob(JobState):
    """A queued computation whose methods are awaited; otherwise like `Job`."""

    def __init__(self, transport: AsyncTransport, document: documents.Job) -> None:
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

    async def result(self, path: str | Path | None = None) -> Result:
        """Return the result of the job, which must have succeeded; see `Job.result`."""
        to = None if path is None else Path(path)
        exchange = conversations.job_result(self.document, to, self._transport.cache)
        return read(await self._transport.hold(exchange))


@dataclass(frozen=True, slots=True)
class Submitted(Generic[AnyJob]):
    """The outcome of queueing many computations at once.

    All lists are in the order of the requests.

    Parameters
    ----------
    inserted : list
        Jobs that have something to compute.
    existing : list
        Jobs whose results already existed.
    errors : dict
        Index of a refused request -> its error.
    of_request : dict
        Index of a request -> its job.
    """

    inserted: list[AnyJob] = field(default_factory=list)
    existing: list[AnyJob] = field(default_factory=list)
    errors: dict[int, ServerError] = field(default_factory=dict)
    of_request: dict[int, AnyJob] = field(default_factory=dict)

    @property
    def jobs(self) -> list[AnyJob]:
        """All jobs, in the order of the requests; the refused ones have none."""
        return list(self.of_request.values())

    @classmethod
    def of(
        cls,
        answers: Sequence[documents.Job | ServerError],
        make: Callable[[documents.Job], AnyJob],
    ) -> Submitted[AnyJob]:
        """Sort the answer to each request, a job or an error."""
        submitted = cls()
        for index, answer in enumerate(answers):
            if isinstance(answer, ServerError):
                submitted.errors[index] = answer
            else:
                job = submitted.of_request[index] = make(answer)
                (submitted.existing if answer["reused"] else submitted.inserted).append(job)
        return submitted
