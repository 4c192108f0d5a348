"""The client: computations as methods, against a service elsewhere or one of its own."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from vibroimpact.embedded import EmbeddedService
from vibroimpact.jobs import Job
from vibroimpact.results import Result
from vibroimpact.systems import Document, frequencies
from vibroimpact.transport import Transport

_HDF5 = "application/x-hdf5"


class Client:
    """A connection to a vibroimpact service.

    Parameters
    ----------
    url : str, optional
        Address of the service; absent: ``VIBROIMPACT_URL``, or else a service of its own is
        started in the background and stopped by `close`.
    data : path, optional
        Where that service keeps its records and results; absent: nothing outlives it.
    timeout : float
        Longest wait for one answer, in seconds.

    Examples
    --------
    >>> with Client() as client:  # doctest: +SKIP
    ...     structure = chain(13, [constraint(5, 0.2)])
    ...     result = client.impact_modes(structure, (0.6, 2.4, 1000))
    ...     result.plot()
    """

    def __init__(
        self, url: str | None = None, data: str | Path | None = None, timeout: float = 60.0
    ) -> None:
        address = url or os.environ.get("VIBROIMPACT_URL")
        self._service = None if address else EmbeddedService(data)
        self._transport = Transport(address or self._embedded_url(), timeout)

    def _embedded_url(self) -> str:
        assert self._service is not None
        return self._service.url

    @property
    def url(self) -> str:
        """Address of the service."""
        return self._transport.url

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
    ) -> Result:
        """Compute impact modes, eq. 10.49-10.59 and 10.87-10.89.

        Parameters
        ----------
        system : dict
            The structure, as `chain`, `system` and their like describe it.
        frequency : array, (start, stop, num) or dict
            Where: fundamental angular frequencies Omega, or those of the triangle wave with
            ``unit="omega"``.
        outputs : sequence of str
            What is wanted: impulse, exists, reason, shape, waveform, energy.
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

    def compute(self, kind: str, request: Mapping[str, Any]) -> Result:
        """Compute anything; waits for the job where the service makes one of it."""
        headers = {"Accept": _HDF5}
        path = f"/v1/compute/{kind}"
        answer = self._transport.request("POST", path, json=dict(request), headers=headers)
        if answer.status_code == 202:
            return Job(self._transport, answer.json()).wait().result()
        return Result(answer.content)

    def submit(self, kind: str, request: Mapping[str, Any], priority: int = 0) -> Job:
        """Queue a computation; it is durable when this returns."""
        body = {"kind": kind, "request": dict(request), "priority": priority}
        return Job(self._transport, self._transport.request("POST", "/v1/jobs", json=body).json())

    def plan(self, kind: str, request: Mapping[str, Any]) -> dict[str, Any]:
        """Return what would be computed and skipped, and why, without computing it."""
        answer = self._transport.request("POST", f"/v1/plan/{kind}", json=dict(request))
        return dict(answer.json())

    def job(self, job_id: str) -> Job:
        """Return a job by its id."""
        return Job(self._transport, self._transport.request("GET", f"/v1/jobs/{job_id}").json())

    def jobs(self, state: str | None = None, kind: str | None = None) -> Iterator[Job]:
        """Return all jobs, newest first."""
        params = {key: value for key, value in (("state", state), ("kind", kind)) if value}
        while True:
            page = self._transport.request("GET", "/v1/jobs", params=params).json()
            for document in page["jobs"]:
                yield Job(self._transport, document)
            if page["next"] is None:
                return
            params["cursor"] = page["next"]

    def result(self, digest: str) -> Result:
        """Return a result by its name."""
        path = f"/v1/results/{digest}"
        return Result(self._transport.request("GET", path, headers={"Accept": _HDF5}).content)

    def version(self) -> dict[str, Any]:
        """Return what the service is and can."""
        return dict(self._transport.request("GET", "/v1/version").json())

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
        "outputs": list(outputs),
    }
    for name, indices in (("active", active), ("dofs", dofs)):
        if indices is not None:
            request[name] = [int(i) for i in indices]
    if tau is not None:
        request["tau"] = np.atleast_1d(np.asarray(tau, dtype=np.float64)).tolist()
    return request
