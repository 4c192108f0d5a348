"""The client: computations as methods, against a service elsewhere or one of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from numbers import Integral
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

import numpy as np

from vibroimpact import conversations
from vibroimpact.config import connection
from vibroimpact.conversations import Terms
from vibroimpact.embedded import EmbeddedService
from vibroimpact.errors import ServerError
from vibroimpact.jobs import Job, Submitted
from vibroimpact.plans import Plan
from vibroimpact.results import Result
from vibroimpact.sweeps import sweep_request
from vibroimpact.systems import Document, frequencies, names, times
from vibroimpact.transport import Transport

Answer = TypeVar("Answer")
_HISTORY = ("x", "v", "energy")


class Computations(ABC, Generic[Answer]):
    """The kinds of computation as methods; what they return is there at once or to be awaited."""

    @abstractmethod
    def compute(self, kind: str, request: Mapping[str, Any], *, progress: bool = False) -> Answer:
        """Compute anything; waits for the job where the service makes one of it."""

    def impact_modes(
        self,
        system: Document,
        frequency: Any,
        *,
        unit: str = "Omega",
        outputs: Sequence[str] = ("impulse", "exists", "reason"),
        active: Sequence[int] | None = None,
        dofs: Sequence[int] | None = None,
        tau: Any = None,
    ) -> Answer:
        """Compute impact modes, eq. 10.49-10.59 and 10.87-10.89.

        Parameters
        ----------
        system : dict
            The structure, as `chain`, `system` and their like describe it.
        frequency : array, (start, stop, num) or dict
            Where: fundamental angular frequencies Omega, or those of the triangle wave with
            ``unit="omega"``.
        outputs : sequence of str
            What is wanted: impulse, exists, reason, shape, waveform, energy, stability,
            harmonics.
        active : sequence of int, optional
            Constraints that are struck; absent: all.
        dofs : sequence of int, optional
            Degrees of freedom of shape and waveform; absent: all.
        tau : array, optional
            Triangle-wave times of the waveform.
        """
        request = impact_modes_request(
            system, frequency, unit=unit, outputs=outputs, active=active, dofs=dofs, tau=tau
        )
        return self.compute("impact-modes", request)

    def existence_bands(
        self,
        system: Document,
        start: float,
        stop: float,
        *,
        unit: str = "Omega",
        outputs: Sequence[str] = ("bands", "rejected"),
        active: Sequence[int] | None = None,
        tolerance: float | None = None,
    ) -> Answer:
        """Find the ranges of frequency in which impact modes are real.

        Parameters
        ----------
        system : dict
            The structure, as `chain`, `system` and their like describe it.
        start, stop : float
            Between which frequencies: Omega, or omega with ``unit="omega"``.
        outputs : sequence of str
            What is wanted: bands, rejected, stability.
        active : sequence of int, optional
            Constraints that are struck; absent: all.
        tolerance : float, optional
            Relative width to which edges are narrowed down.
        """
        request: Document = {
            "system": dict(system),
            "frequency": {"start": float(start), "stop": float(stop), "unit": unit},
            "outputs": names(outputs),
        }
        if active is not None:
            request["active"] = [int(i) for i in active]
        if tolerance is not None:
            request["tolerance"] = float(tolerance)
        return self.compute("existence-bands", request)

    def resonances(self, system: Document, constraint: int = 0, odd_max: int = 9) -> Answer:
        """Find the internal resonances of a structure held at a limiter, eq. 10.70-10.76.

        Parameters
        ----------
        system : dict
            The structure, as `chain`, `system` and their like describe it.
        constraint : int
            Index of the constraint whose coordinate moves.
        odd_max : int
            Highest odd harmonic.
        """
        request = {"system": dict(system), "constraint": int(constraint), "odd_max": int(odd_max)}
        return self.compute("resonances", request)

    def time_history(
        self,
        system: Document,
        initial: Any,
        t_end: float,
        *,
        t: Any = None,
        outputs: Sequence[str] | None = None,
        dofs: Sequence[int] | None = None,
        load: Sequence[Mapping[str, Any]] | None = None,
        limiter: Mapping[str, Any] | None = None,
        method: str = "exact",
        tolerance: float | None = None,
        digits: int | None = None,
    ) -> Answer:
        """Compute a motion with its impacts.

        Parameters
        ----------
        system : dict
            The structure, as `chain`, `system` and their like describe it.
        initial : (x, v) or float or dict
            Displacements and velocities at t = 0, or the frequency Omega of the impact mode
            that the motion starts as, or the document itself.
        t_end : float
            Length of the motion.
        t : int or array, optional
            Times of the history, or the number of equally spaced ones.
        outputs : sequence of str, optional
            What is wanted: x, v, impacts, energy, contacts; absent: impacts and contacts, with
            times x, v and energy too.
        dofs : sequence of int, optional
            Degrees of freedom of x and v; absent: all.
        load : sequence of dict, optional
            Harmonic loads, as `harmonic` describes them.
        limiter : dict, optional
            The law of soft limiters, as `soft` describes it; absent: rigid.
        method : str
            "exact", or an integrator of scipy to compare with: RK45, DOP853, Radau, LSODA, …
        tolerance : float, optional
            Accuracy meant, relative to the size of the motion; the result says until when double
            precision can hold it.
        digits : int, optional
            Decimal digits to compute with where it cannot.
        """
        request = time_history_request(
            system,
            initial,
            t_end,
            t=t,
            outputs=outputs,
            dofs=dofs,
            load=load,
            limiter=limiter,
            method=method,
            tolerance=tolerance,
            digits=digits,
        )
        return self.compute("time-history", request)

    def ensemble(
        self,
        system: Document,
        x: Any,
        v: Any,
        t_end: float,
        *,
        t: Any = None,
        outputs: Sequence[str] | None = None,
        dofs: Sequence[int] | None = None,
        load: Sequence[Mapping[str, Any]] | None = None,
        limiter: Mapping[str, Any] | None = None,
        method: str = "exact",
        tolerance: float | None = None,
    ) -> Answer:
        """Compute the motions from many initial states.

        `Result.each` returns the impacts of every member, ``result.plot()`` the basins.

        Parameters
        ----------
        system : dict
            The structure, as `chain`, `system` and their like describe it.
        x, v : array, shape (member, dof)
            Displacements and velocities at t = 0.
        t_end : float
            Length of the motions.
        t, outputs, dofs, load, limiter, method, tolerance
            As `time_history` takes them, for all members.
        """
        request = ensemble_request(
            system,
            x,
            v,
            t_end,
            t=t,
            outputs=outputs,
            dofs=dofs,
            load=load,
            limiter=limiter,
            method=method,
            tolerance=tolerance,
        )
        return self.compute("ensemble", request)

    def slow_flow(
        self,
        system: Document,
        model: str,
        variant: str,
        initial: Mapping[str, float],
        t: Any,
        *,
        outputs: Sequence[str] = ("state", "x", "v", "error"),
    ) -> Answer:
        """Compute a motion whose impacts change slowly, and its error.

        Parameters
        ----------
        system : dict
            The one that the model is about, as `oscillator` and its like describe it.
        model : str
            ``damped`` (eq. 10.13-10.21), ``two_oscillator`` (10.41-10.46), ``restitution``
            (10.90-10.123), ``bouncing_ball`` (10.124-10.149) or ``oscillator`` (10.1-10.12).
        variant : str
            Description of the motion, such as ``exact``, ``averaged`` or ``corrected``.
        initial : mapping
            The start, such as ``{"gamma": 0.2}`` or ``{"omega": 5}``.
        t : array, (start, stop, num) or dict
            Times.
        outputs : sequence of str
            What is wanted: state, x, v, impulse, error.
        """
        request = slow_flow_request(system, model, variant, initial, t, outputs=outputs)
        return self.compute("slow-flow", request)

    def sweep(
        self,
        kind: str,
        base: Mapping[str, Any],
        axes: Mapping[str, Any],
        outputs: Sequence[str] | None = None,
        *,
        progress: bool = False,
    ) -> Answer:
        """Compute anything at every point of a lattice of values of some of its numbers.

        What an axis does not touch is computed once for all its values.

        Parameters
        ----------
        kind : str
            Of the computation, such as ``"impact-modes"``.
        base : dict
            A request of that kind, as `impact_modes_request` makes it.
        axes : mapping
            Path of a number of the base -> its values: an array, (start, stop, num), or a
            dictionary with start, stop and step. Results have these axes in this order, before
            their own dimensions.
        outputs : sequence of str, optional
            What is wanted; absent: the outputs of the base.
        progress : bool
            Show a progress bar while a job does it.
        """
        request = sweep_request(kind, base, axes, outputs)
        return self.compute("sweep", request, progress=progress)


class Client(Computations[Result]):
    """A connection to a vibroimpact service.

    Parameters
    ----------
    url : str, optional
        Address of the service; absent: ``VIBROIMPACT_URL``, or that of the profile, or else a
        service of its own is started in the background and stopped by `close`.
    data : path, optional
        Where that service keeps its records and results; absent: nothing outlives it.
    timeout : float, optional
        Longest wait for one answer, in seconds; absent: ``VIBROIMPACT_TIMEOUT``, or that of the
        profile, or 60.
    key : str, optional
        API key or token; absent: ``VIBROIMPACT_KEY``, or that of the profile.
    profile : str, optional
        Name in the file of profiles, see `vibroimpact.config`; absent: ``VIBROIMPACT_PROFILE``,
        or the file's default.

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
    ) -> None:
        meant = connection(url, key, timeout, profile)
        self._service = None if meant.url else EmbeddedService(data)
        address = self._service.url if self._service is not None else str(meant.url)
        self._transport = Transport(address, meant.timeout, key=meant.key)

    @property
    def url(self) -> str:
        """Address of the service."""
        return self._transport.url

    def __repr__(self) -> str:
        """Return the address."""
        return f"<Client {self.url}>"

    def compute(self, kind: str, request: Mapping[str, Any], *, progress: bool = False) -> Result:
        """Compute anything; waits for the job where the service makes one of it."""
        found = self._transport.hold(conversations.ask(kind, request))
        if isinstance(found, bytes):
            return Result(found)
        return Job(self._transport, found).wait(progress=progress).result()

    def submit(
        self,
        kind: str,
        request: Mapping[str, Any],
        priority: int = 0,
        *,
        deadline: float | None = None,
        webhook: Mapping[str, str] | None = None,
    ) -> Job:
        """Queue a computation; it is durable when this returns.

        Parameters
        ----------
        kind : str
        request : mapping
        priority : int
            Higher goes first among one's own jobs.
        deadline : float, optional
            Seconds from now in which it must be done, or it fails.
        webhook : mapping, optional
            ``url``, told when the job ends, and ``secret``, which signs the message.
        """
        terms = Terms(priority, deadline, webhook)
        document = self._transport.hold(conversations.submit(kind, request, terms))
        return Job(self._transport, document)

    def submit_many(
        self,
        kind: str,
        requests: Sequence[Mapping[str, Any]],
        priority: int = 0,
        *,
        deadline: float | None = None,
        webhook: Mapping[str, str] | None = None,
    ) -> Submitted[Job]:
        """Queue many computations; what is wrong with some does not keep the others.

        Parameters as for `submit`, for each of the jobs.
        """
        terms = Terms(priority, deadline, webhook)
        found = self._transport.hold(conversations.submit_many(kind, requests, terms))
        return Submitted.of(found, lambda document: Job(self._transport, document))

    def as_completed(self, jobs: Sequence[Job], timeout: float | None = None) -> Iterator[Job]:
        """Yield jobs as they become final, well or not.

        Raises
        ------
        JobTimeout
            Where none became final for so many seconds; the jobs go on.
        """
        waiting = list(jobs)
        while waiting:
            documents = [job.document for job in waiting]
            final, found = self._transport.hold(conversations.first_final(documents, timeout))
            for job, document in zip(waiting, found, strict=True):
                job.document = document
            yield from [waiting[place] for place in final]
            waiting = [job for job in waiting if not job.final]

    def store(self, system: Document) -> Document:
        """Keep a structure with the service; return the short document that stands for it.

        It goes wherever a structure goes, also with other constraints:
        ``found | {"constraints": [...]}``. A large matrix is then sent, and its natural modes
        computed, once.
        """
        return self._transport.hold(conversations.store(system))

    def batch(
        self, kind: str, requests: Sequence[Mapping[str, Any]]
    ) -> list[dict[str, Any] | ServerError]:
        """Compute many tiny things in one exchange; nothing of it is stored.

        Returns
        -------
        list of dict or ServerError
            In the order of the requests: the result as the document that JSON answers are, or
            the problem that the request met.
        """
        return self._transport.hold(conversations.batch(kind, requests))

    def plan(self, kind: str, request: Mapping[str, Any]) -> Plan:
        """Return what would be computed and skipped, and why, without computing it."""
        return Plan(self._transport.hold(conversations.plan(kind, request)))

    def job(self, job_id: str) -> Job:
        """Return a job by its id."""
        return Job(self._transport, self._transport.hold(conversations.job(job_id)))

    def jobs(self, state: str | None = None, kind: str | None = None) -> Iterator[Job]:
        """Return all jobs, newest first."""
        params = {key: value for key, value in (("state", state), ("kind", kind)) if value}
        while True:
            page = self._transport.hold(conversations.job_page(params))
            for document in page["jobs"]:
                yield Job(self._transport, document)
            if page["next"] is None:
                return
            params["cursor"] = page["next"]

    def result(self, digest: str) -> Result:
        """Return a result by its name."""
        return Result(self._transport.hold(conversations.result(digest)))

    def version(self) -> dict[str, Any]:
        """Return what the service is and can."""
        return self._transport.hold(conversations.version())

    def close(self) -> None:
        """Close the connection, and the service where it is our own."""
        self._transport.close()
        if self._service is not None:
            self._service.close()
            self._service = None

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close."""
        self.close()


def impact_modes_request(
    system: Document,
    frequency: Any,
    *,
    unit: str = "Omega",
    outputs: Sequence[str] = ("impulse", "exists", "reason"),
    active: Sequence[int] | None = None,
    dofs: Sequence[int] | None = None,
    tau: Any = None,
) -> Document:
    """Return the request document that `Client.impact_modes` sends."""
    request: Document = {
        "system": dict(system),
        "frequency": frequencies(frequency, unit),
        "outputs": names(outputs),
    }
    for name, indices in (("active", active), ("dofs", dofs)):
        if indices is not None:
            request[name] = [int(i) for i in indices]
    if tau is not None:
        request["tau"] = np.atleast_1d(np.asarray(tau, dtype=np.float64)).tolist()
    return request


def time_history_request(
    system: Document,
    initial: Any,
    t_end: float,
    *,
    t: Any = None,
    outputs: Sequence[str] | None = None,
    dofs: Sequence[int] | None = None,
    load: Sequence[Mapping[str, Any]] | None = None,
    limiter: Mapping[str, Any] | None = None,
    method: str = "exact",
    tolerance: float | None = None,
    digits: int | None = None,
) -> Document:
    """Return the request document that `Client.time_history` sends."""
    if outputs is None:
        outputs = ("impacts", "contacts") if t is None else (*_HISTORY, "impacts", "contacts")
    request: Document = {
        "system": dict(system),
        "initial": _initial(initial),
        "t_end": float(t_end),
        "outputs": names(outputs),
    }
    if isinstance(t, Integral):
        request["t"] = {"num": int(t)}
    elif t is not None:
        request["t"] = np.atleast_1d(np.asarray(t, dtype=np.float64)).tolist()
    if dofs is not None:
        request["dofs"] = [int(i) for i in dofs]
    if load is not None:
        request["load"] = [dict(term) for term in load]
    if limiter is not None:
        request["limiter"] = dict(limiter)
    if method != "exact":
        request["method"] = method
    if tolerance is not None:
        request["tolerance"] = float(tolerance)
    if digits is not None:
        request["digits"] = int(digits)
    return request


def ensemble_request(system: Document, x: Any, v: Any, t_end: float, **options: Any) -> Document:
    """Return the request document that `Client.ensemble` sends; options as it takes them."""
    places, speeds = (np.atleast_2d(np.asarray(part, dtype=np.float64)) for part in (x, v))
    initial = {"x": places.tolist(), "v": speeds.tolist()}
    return time_history_request(system, initial, t_end, **options)


def slow_flow_request(
    system: Document,
    model: str,
    variant: str,
    initial: Mapping[str, float],
    t: Any,
    *,
    outputs: Sequence[str] = ("state", "x", "v", "error"),
) -> Document:
    """Return the request document that `Client.slow_flow` sends."""
    start = {name: value if name == "root" else float(value) for name, value in initial.items()}
    return {
        "system": dict(system),
        "model": model,
        "variant": variant,
        "initial": start,
        "t": times(t),
        "outputs": names(outputs),
    }


def _initial(initial: Any) -> Document:
    if isinstance(initial, Mapping):
        return dict(initial)
    if isinstance(initial, int | float):
        return {"impact_mode": {"Omega": float(initial)}}
    x, v = (np.atleast_1d(np.asarray(part, dtype=np.float64)).tolist() for part in initial)
    return {"x": x, "v": v}
