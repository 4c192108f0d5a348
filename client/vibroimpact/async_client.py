"""The asynchronous twin of the client: the same conversations, awaited."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Coroutine, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from vibroimpact import conversations
from vibroimpact.client import Computations
from vibroimpact.config import connection
from vibroimpact.conversations import Terms
from vibroimpact.embedded import EmbeddedService
from vibroimpact.errors import ServerError
from vibroimpact.jobs import AsyncJob, Submitted
from vibroimpact.plans import Plan
from vibroimpact.results import Result
from vibroimpact.systems import Document
from vibroimpact.transport import AsyncTransport


class AsyncClient(Computations[Coroutine[Any, Any, Result]]):
    """A connection to a vibroimpact service, for use with ``async with`` and ``await``.

    Takes what `vibroimpact.Client` takes and has its methods.

    Examples
    --------
    >>> async with AsyncClient() as client:  # doctest: +SKIP
    ...     modes = [client.impact_modes(s, (0.6, 2.4, 1000)) for s in structures]
    ...     results = await asyncio.gather(*modes)
    """

    def __init__(
        self,
        url: str | None = None,
        data: str | Path | None = None,
        timeout: float | None = None,
        *,
        key: str | None = None,
        profile: str | None = None,
    ) -> None:
        self._meant, self._data = connection(url, key, timeout, profile), data
        self._service: EmbeddedService | None = None
        self._transport: AsyncTransport | None = None

    @property
    def url(self) -> str:
        """Address of the service."""
        return self._open.url

    @property
    def _open(self) -> AsyncTransport:
        if self._transport is None:
            raise RuntimeError("an AsyncClient is open within: async with AsyncClient() as client")
        return self._transport

    async def compute(
        self, kind: str, request: Mapping[str, Any], *, progress: bool = False
    ) -> Result:
        """Compute anything; waits for the job where the service makes one of it."""
        found = await self._open.hold(conversations.ask(kind, request))
        if isinstance(found, bytes):
            return Result(found)
        job = AsyncJob(self._open, found)
        await job.wait(progress=progress)
        return await job.result()

    async def submit(
        self,
        kind: str,
        request: Mapping[str, Any],
        priority: int = 0,
        *,
        deadline: float | None = None,
        webhook: Mapping[str, str] | None = None,
    ) -> AsyncJob:
        """Queue a computation; as `Client.submit`."""
        terms = Terms(priority, deadline, webhook)
        document = await self._open.hold(conversations.submit(kind, request, terms))
        return AsyncJob(self._open, document)

    async def submit_many(
        self,
        kind: str,
        requests: Sequence[Mapping[str, Any]],
        priority: int = 0,
        *,
        deadline: float | None = None,
        webhook: Mapping[str, str] | None = None,
    ) -> Submitted[AsyncJob]:
        """Queue many computations; what is wrong with some does not keep the others.

        Parameters as for `submit`, for each of the jobs.
        """
        terms = Terms(priority, deadline, webhook)
        found = await self._open.hold(conversations.submit_many(kind, requests, terms))
        return Submitted.of(found, lambda document: AsyncJob(self._open, document))

    async def as_completed(
        self, jobs: Sequence[AsyncJob], timeout: float | None = None
    ) -> AsyncIterator[AsyncJob]:
        """Yield jobs as they become final, well or not; raises as `Client.as_completed`."""
        waiting = list(jobs)
        while waiting:
            documents = [job.document for job in waiting]
            final, found = await self._open.hold(conversations.first_final(documents, timeout))
            for job, document in zip(waiting, found, strict=True):
                job.document = document
            for place in final:
                yield waiting[place]
            waiting = [job for job in waiting if not job.final]

    async def store(self, system: Document) -> Document:
        """Keep a structure with the service; return the short document that stands for it.

        It goes wherever a structure goes, also with other constraints:
        ``found | {"constraints": [...]}``. A large matrix is then sent, and its natural modes
        computed, once.
        """
        return await self._open.hold(conversations.store(system))

    async def batch(
        self, kind: str, requests: Sequence[Mapping[str, Any]]
    ) -> list[dict[str, Any] | ServerError]:
        """Compute many tiny things in one exchange; nothing of it is stored.

        Returns
        -------
        list of dict or ServerError
            In the order of the requests: the result as the document that JSON answers are, or
            the problem that the request met.
        """
        return await self._open.hold(conversations.batch(kind, requests))

    async def plan(self, kind: str, request: Mapping[str, Any]) -> Plan:
        """Return what would be computed and skipped, and why, without computing it."""
        return Plan(await self._open.hold(conversations.plan(kind, request)))

    async def job(self, job_id: str) -> AsyncJob:
        """Return a job by its id."""
        return AsyncJob(self._open, await self._open.hold(conversations.job(job_id)))

    async def jobs(
        self, state: str | None = None, kind: str | None = None
    ) -> AsyncIterator[AsyncJob]:
        """Return all jobs, newest first."""
        params = {key: value for key, value in (("state", state), ("kind", kind)) if value}
        while True:
            page = await self._open.hold(conversations.job_page(params))
            for document in page["jobs"]:
                yield AsyncJob(self._open, document)
            if page["next"] is None:
                return
            params["cursor"] = page["next"]

    async def result(self, digest: str) -> Result:
        """Return a result by its name."""
        return Result(await self._open.hold(conversations.result(digest)))

    async def version(self) -> dict[str, Any]:
        """Return what the service is and can."""
        return await self._open.hold(conversations.version())

    async def close(self) -> None:
        """Close the connection, and the service where it is our own."""
        transport, self._transport = self._transport, None
        if transport is not None:
            await transport.close()
        service, self._service = self._service, None
        if service is not None:
            await asyncio.to_thread(service.close)

    async def __aenter__(self) -> Self:
        """Open the connection, starting a service where there is none, and return itself."""
        address = self._meant.url
        if address is None:
            self._service = await asyncio.to_thread(EmbeddedService, self._data)
            address = self._service.url
        self._transport = AsyncTransport(address, self._meant.timeout, key=self._meant.key)
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close."""
        await self.close()
