"""The asynchronous client: the same exchanges with the service, awaited."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Coroutine, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from vibroimpact import conversations
from vibroimpact.computations import Computations
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

    It takes the parameters of `vibroimpact.Client` and has the same methods.

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
        self._connection, self._data = connection(url, key, timeout, profile), data
        self._service: EmbeddedService | None = None
        self._transport: AsyncTransport | None = None

    @property
    def url(self) -> str:
        """Address of the service."""
        return self._open.url

    @property
    def _open(self) -> AsyncTransport:
        if self._transport is None:
            raise RuntimeError("open an AsyncClient first: async with AsyncClient() as client")
        return self._transport

    async def compute(
        self, kind: str, request: Mapping[str, Any], *, progress: bool = False
    ) -> Result:
        """Compute a request of any kind; where the service queues it, wait for the job."""
        answer = await self._open.hold(conversations.ask(kind, request))
        if isinstance(answer, bytes):
            return Result(answer)
        job = AsyncJob(self._open, answer)
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
        """Queue a computation; see `Client.submit`."""
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
        """Queue many computations; those that are refused do not hold back the others.

        The parameters are those of `submit` and hold for each job.
        """
        terms = Terms(priority, deadline, webhook)
        answers = await self._open.hold(conversations.submit_many(kind, requests, terms))
        return Submitted.of(answers, lambda document: AsyncJob(self._open, document))

    async def as_completed(
        self, jobs: Sequence[AsyncJob], timeout: float | None = None
    ) -> AsyncIterator[AsyncJob]:
        """Yield jobs as they end; see `Client.as_completed`."""
        waiting = list(jobs)
        while waiting:
            documents = [job.document for job in waiting]
            exchange = conversations.first_final(documents, timeout)
            final, documents = await self._open.hold(exchange)
            for job, document in zip(waiting, documents, strict=True):
                job.document = document
            for place in final:
                yield waiting[place]
            waiting = [job for job in waiting if not job.final]

    async def store(self, system: Document) -> Document:
        """Store a structure with the service; see `Client.store`."""
        return await self._open.hold(conversations.store(system))

    async def batch(
        self, kind: str, requests: Sequence[Mapping[str, Any]]
    ) -> list[dict[str, Any] | ServerError]:
        """Compute many small requests in one exchange; see `Client.batch`."""
        return await self._open.hold(conversations.batch(kind, requests))

    async def plan(self, kind: str, request: Mapping[str, Any]) -> Plan:
        """Return the steps of a computation and those it skips, with reasons; compute nothing."""
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
        """Return a stored result by its digest."""
        return Result(await self._open.hold(conversations.result(digest)))

    async def version(self) -> dict[str, Any]:
        """Return the version, kinds and limits of the service."""
        return await self._open.hold(conversations.version())

    async def close(self) -> None:
        """Close the connection, and stop the service if this client started it."""
        transport, self._transport = self._transport, None
        if transport is not None:
            await transport.close()
        service, self._service = self._service, None
        if service is not None:
            await asyncio.to_thread(service.close)

    async def __aenter__(self) -> Self:
        """Open the connection, starting a service if no address was given; return the client."""
        address = self._connection.url
        if address is None:
            self._service = await asyncio.to_thread(EmbeddedService, self._data)
            address = self._service.url
        self._transport = AsyncTransport(
            address, self._connection.timeout, key=self._connection.key
        )
        return self

    async def __aexit__(self, *error: object) -> None:
        """Close the client."""
        await self.close()
