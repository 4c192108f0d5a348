"""The asynchronous client: the same exchanges with the service, awaited."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Coroutine, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

from vibroimpact import conversations, kinds
from vibroimpact.cache import Cache
from vibroimpact.computations import Computations
from vibroimpact.config import connection
from vibroimpact.conversations import Terms
from vibroimpact.embedded import EmbeddedService
from vibroimpact.errors import ServerError, as_answered
from vibroimpact.jobs import AsyncJob, Submitted
from vibroimpact.parts import Parts
from vibroimpact.plans import Plan
from vibroimpact.results import Result
from vibroimpact.transport import RETRIES, AsyncTransport

if TYPE_CHECKING:
    from vibroimpact import documents

    Outcome = TypeVar("Outcome")
    Later = Coroutine[Any, Any, Outcome]


class AsyncClient(
    Computations[
        "Later[kinds.NaturalFrequencies]",
        "Later[kinds.ImpactModes]",
        "Later[kinds.ExistenceBands]",
        "Later[kinds.Resonances]",
        "Later[kinds.PeriodicMotions]",
        "Later[kinds.Branches]",
        "Later[kinds.Attractors]",
        "Later[kinds.TimeHistory]",
        "Later[kinds.Ensemble]",
        "Later[kinds.SlowFlow]",
        "Later[kinds.Calibration]",
        "Later[kinds.Sweep]",
    ]
):
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
        retries: int = RETRIES,
        cache: str | Path | None = None,
    ) -> None:
        self._connection, self._data = connection(url, key, timeout, profile), data
        self._retries, self._cache = retries, None if cache is None else Cache(cache)
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

    async def _compute(
        self, kind: str, request: Mapping[str, Any], *, progress: bool = False
    ) -> Result:
        answer = await self._open.hold(conversations.ask(kind, request, self._open.cache))
        if isinstance(answer, bytes | Parts):
            return kinds.read(answer)
        job = AsyncJob(self._open, answer)
        with as_answered():
            await job.wait(progress=progress)
            return await job.result()

    async def submit(
        self,
        kind: documents.Kind,
        request: documents.Request,
        priority: int = 0,
        *,
        deadline: float | None = None,
        webhook: documents.Webhook | None = None,
        name: str | None = None,
    ) -> AsyncJob:
        """Queue a computation; see `Client.submit`."""
        terms = Terms(priority, deadline, webhook, name)
        document = await self._open.hold(conversations.submit(kind, request, terms))
        return AsyncJob(self._open, document)

    async def submit_many(
        self,
        kind: documents.Kind,
        requests: Sequence[documents.Request],
        priority: int = 0,
        *,
        deadline: float | None = None,
        webhook: documents.Webhook | None = None,
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
            known = [job.document for job in waiting]
            exchange = conversations.first_final(known, timeout)
            final, known = await self._open.hold(exchange)
            for job, document in zip(waiting, known, strict=True):
                job.document = document
            for place in final:
                yield waiting[place]
            waiting = [job for job in waiting if not job.final]

    async def store(self, system: documents.System) -> documents.SystemReference:
        """Store a structure with the service; see `Client.store`."""
        return await self._open.hold(conversations.store(system))

    async def batch(
        self, kind: documents.Kind, requests: Sequence[documents.Request]
    ) -> list[Mapping[str, Any] | ServerError]:
        """Compute many small requests in one exchange; see `Client.batch`."""
        return await self._open.hold(conversations.batch(kind, requests))

    async def plan(self, kind: documents.Kind, request: documents.Request) -> Plan:
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

    async def result(self, digest: str, path: str | Path | None = None) -> Result:
        """Return a stored result by its digest; see `Client.result`."""
        to = None if path is None else Path(path)
        return kinds.read(await self._open.hold(conversations.result(digest, to, self._open.cache)))

    async def version(self) -> documents.Version:
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
            address,
            self._connection.timeout,
            key=self._connection.key,
            retries=self._retries,
            cache=self._cache,
        )
        return self

    async def __aexit__(self, *error: object) -> None:
        """Close the client."""
        await self.close()
