"""The client: computations, jobs and results of a service elsewhere or one of its own."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from vibroimpact import conversations, kinds
from vibroimpact import requests as builders
from vibroimpact.cache import Cache
from vibroimpact.computations import Computations
from vibroimpact.config import connection
from vibroimpact.conversations import Terms
from vibroimpact.embedded import EmbeddedService
from vibroimpact.errors import ServerError, as_answered
from vibroimpact.jobs import Job, Jobs, Submitted
from vibroimpact.parts import Parts
from vibroimpact.plans import Plan
from vibroimpact.results import Result
from vibroimpact.transport import RETRIES, Transport

if TYPE_CHECKING:
    from vibroimpact import documents


class Client(
    Computations[
        kinds.NaturalFrequencies,
        kinds.ImpactModes,
        kinds.ExistenceBands,
        kinds.Resonances,
        kinds.PeriodicMotions,
        kinds.Branches,
        kinds.Attractors,
        kinds.TimeHistory,
        kinds.Ensemble,
        kinds.SlowFlow,
        kinds.Calibration,
        kinds.Sweep,
    ]
):
    """A connection to a vibroimpact service.

    Parameters
    ----------
    url : str, optional
        Address of the service; default: ``VIBROIMPACT_URL``, or the address in the profile. If
        none is given, the client starts a service in the background, which `close` stops.
    data : path, optional
        Folder of the records and results of that service; default: a temporary one.
    timeout : float, optional
        Longest wait for one answer, in seconds; default: ``VIBROIMPACT_TIMEOUT``, or the value in
        the profile, or 60.
    key : str, optional
        API key or token; default: ``VIBROIMPACT_KEY``, or the key in the profile.
    profile : str, optional
        Name of a profile in the configuration file, see `vibroimpact.config`; default:
        ``VIBROIMPACT_PROFILE``, or the default profile of the file.
    retries : int
        Repetitions of a request after temporary failures, with growing pauses.
    cache : path, optional
        Folder in which results are kept by their digest: they are fetched once, and are there
        where no service answers.

    Examples
    --------
    >>> with Client() as client:  # doctest: +SKIP
    ...     structure = chain(13, [constraint(5, 0.2)])
    ...     result = client.impact_modes(structure, (0.6, 2.4, 1000))
    ...     result.plot()
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
        chosen = connection(url, key, timeout, profile)
        self._service = None if chosen.url else EmbeddedService(data)
        address = self._service.url if self._service is not None else str(chosen.url)
        kept = None if cache is None else Cache(cache)
        self._transport = Transport(
            address, chosen.timeout, key=chosen.key, retries=retries, cache=kept
        )

    @property
    def url(self) -> str:
        """Address of the service."""
        return self._transport.url

    def __repr__(self) -> str:
        """Return the address."""
        return f"<Client {self.url}>"

    def _compute(self, kind: str, request: Mapping[str, Any], *, progress: bool = False) -> Result:
        answer = self._transport.hold(conversations.ask(kind, request, self._transport.cache))
        if isinstance(answer, bytes | Parts):
            return kinds.read(answer)
        with as_answered():
            return Job(self._transport, answer).wait(progress=progress).result()

    def submit(
        self,
        kind: documents.Kind,
        request: documents.Request,
        priority: int = 0,
        *,
        deadline: float | None = None,
        webhook: documents.Webhook | None = None,
        name: str | None = None,
    ) -> Job:
        """Queue a computation. The job is durable when this returns.

        Parameters
        ----------
        kind : str
            Kind of computation, such as ``"impact-modes"``.
        request : mapping
            The request document, for example from `impact_modes_request`.
        priority : int
            Jobs of higher priority run before the owner's other jobs.
        deadline : float, optional
            Seconds from now after which an unfinished job fails.
        webhook : mapping, optional
            ``url``, to which a message is sent when the job ends, and ``secret``, which signs it.
        name : str, optional
            What to call the job in lists, such as that of the console.
        """
        terms = Terms(priority, deadline, webhook, name)
        document = self._transport.hold(conversations.submit(kind, request, terms))
        return Job(self._transport, document)

    def submit_many(
        self,
        kind: documents.Kind,
        requests: Sequence[documents.Request],
        priority: int = 0,
        *,
        deadline: float | None = None,
        webhook: documents.Webhook | None = None,
    ) -> Submitted[Job]:
        """Queue many computations; those that are refused do not hold back the others.

        The parameters are those of `submit` and hold for each job.
        """
        terms = Terms(priority, deadline, webhook)
        answers = self._transport.hold(conversations.submit_many(kind, requests, terms))
        return Submitted.of(answers, lambda document: Job(self._transport, document))

    def as_completed(self, jobs: Sequence[Job], timeout: float | None = None) -> Iterator[Job]:
        """Yield jobs as they end, whether they succeed or not.

        Raises
        ------
        JobTimeout
            If no job ends within `timeout` seconds; the jobs continue.
        """
        waiting = list(jobs)
        while waiting:
            known = [job.document for job in waiting]
            final, known = self._transport.hold(conversations.first_final(known, timeout))
            for job, document in zip(waiting, known, strict=True):
                job.document = document
            yield from [waiting[place] for place in final]
            waiting = [job for job in waiting if not job.final]

    def store(self, system: documents.System) -> documents.SystemReference:
        """Store a structure with the service; return the short document that stands for it.

        The document can replace the structure in every request, also with other constraints:
        ``stored | {"constraints": [...]}``. A large matrix is then sent only once, and its natural
        modes are computed only once.
        """
        return self._transport.hold(conversations.store(system))

    def batch(
        self, kind: documents.Kind, requests: Sequence[documents.Request]
    ) -> list[Mapping[str, Any] | ServerError]:
        """Compute many small requests in one exchange; nothing is stored.

        Returns
        -------
        list of dict or ServerError
            In the order of the requests: the result as the document of a JSON answer, or the
            error that the request caused.
        """
        return self._transport.hold(conversations.batch(kind, requests))

    def plan(self, kind: documents.Kind, request: documents.Request) -> Plan:
        """Return the steps of a computation and those it skips, with reasons; compute nothing."""
        return Plan(self._transport.hold(conversations.plan(kind, request)))

    def job(self, job_id: str) -> Job:
        """Return a job by its id."""
        return Job(self._transport, self._transport.hold(conversations.job(job_id)))

    def jobs(self, state: str | None = None, kind: str | None = None) -> Jobs:
        """Return all jobs, newest first: to go through, or to be displayed as a table."""
        return Jobs(self._each_job(state, kind))

    def _each_job(self, state: str | None, kind: str | None) -> Iterator[Job]:
        params = {key: value for key, value in (("state", state), ("kind", kind)) if value}
        while True:
            page = self._transport.hold(conversations.job_page(params))
            for document in page["jobs"]:
                yield Job(self._transport, document)
            if page["next"] is None:
                return
            params["cursor"] = page["next"]

    def result(self, digest: str, path: str | Path | None = None) -> Result:
        """Return a stored result by its digest; with a path it goes there, as in `Job.result`."""
        to = None if path is None else Path(path)
        exchange = conversations.result(digest, to, self._transport.cache)
        return kinds.read(self._transport.hold(exchange))

    def version(self) -> documents.Version:
        """Return the version, kinds and limits of the service."""
        return self._transport.hold(conversations.version())

    def close(self) -> None:
        """Close the connection, and stop the service if this client started it."""
        self._transport.close()
        if self._service is not None:
            self._service.close()
            self._service = None

    def __enter__(self) -> Self:
        """Return the client."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close the client."""
        self.close()


if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Return a request builder by its address in 0.1.0."""
        if not name.endswith("_request") or not hasattr(builders, name):
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        message = f"{__name__}.{name} has moved: import it from vibroimpact"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return getattr(builders, name)
