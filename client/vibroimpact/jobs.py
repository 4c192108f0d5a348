"""A job on the service: look at it, wait for it, cancel it, take its result."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from vibroimpact.errors import JobCancelled, JobFailed, JobTimeout
from vibroimpact.results import Result
from vibroimpact.transport import Transport

_POLL = 25.0  # the service answers earlier when something changes
_HDF5 = "application/x-hdf5"


class Job:
    """A queued computation.

    Parameters
    ----------
    transport : Transport
    document : dict
        The job as the service describes it.
    """

    def __init__(self, transport: Transport, document: dict[str, Any]) -> None:
        self._transport = transport
        self.document = document

    @property
    def id(self) -> str:
        """Its id; `Client.job` finds it again by it."""
        return str(self.document["id"])

    @property
    def state(self) -> str:
        """Queued, running, succeeded, failed or cancelled, when last looked at."""
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

    def refresh(self, wait: float = 0.0) -> Job:
        """Look at it again, waiting up to so many seconds for a change."""
        params = None
        if wait > 0:
            params = {"wait": f"{wait:g}", "since": str(self.document["version"])}
        self.document = self._transport.request("GET", f"/v1/jobs/{self.id}", params=params).json()
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
        if progress:
            from vibroimpact.progress import bar

            with bar(str(self.document["kind"])) as show:
                self._wait(timeout, show)
        else:
            self._wait(timeout, None)
        if self.state == "failed":
            raise JobFailed(self.id, self.document.get("error") or {})
        if self.state == "cancelled":
            raise JobCancelled(f"job {self.id} was cancelled")
        return self

    def _wait(self, timeout: float | None, show: Callable[[dict[str, Any]], None] | None) -> None:
        deadline = None if timeout is None else time.monotonic() + timeout
        while not self.final:
            left = _POLL if deadline is None else min(_POLL, deadline - time.monotonic())
            if left <= 0:
                raise JobTimeout(f"job {self.id} is {self.state} after {timeout:g} s")
            self.refresh(wait=max(left, 0.01))
            if show is not None:
                show(self.document)

    def cancel(self) -> Job:
        """Cancel it; nothing happens to a job that ended."""
        self._transport.request("DELETE", f"/v1/jobs/{self.id}")
        return self.refresh()

    def result(self) -> Result:
        """Return the result of a job that succeeded."""
        path = f"/v1/jobs/{self.id}/result"
        return Result(self._transport.request("GET", path, headers={"Accept": _HDF5}).content)

    def __repr__(self) -> str:
        """Return id, kind and state."""
        return f"<Job {self.id} {self.document['kind']} {self.state}>"
