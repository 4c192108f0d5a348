"""What a service knows of the lives of worker processes, near and far."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Final, TypeVar

from vibroimpact_service.jobs.work import WorkerLostError

_WAIT_SECONDS: Final = 2.0
_SILENT_SECONDS: Final = 13.0
_CHECK_SECONDS: Final = 4.0
_MOST: Final = 1000

_Value = TypeVar("_Value")


class Deaths:
    """Collects the events of `death_watch`.

    Parameters
    ----------
    counted : callable
        ``(cause) -> None``: called for each death; see `jobs.metrics.DEATHS`.
    """

    def __init__(self, counted: Callable[[str], None]) -> None:
        self._counted = counted
        self._deaths: dict[str, tuple[str, bool]] = {}
        self._alive: dict[str, float] = {}
        self._slow: dict[str, str] = {}
        self._changed = threading.Condition()
        self._checked = time.monotonic()

    def note(self, event: tuple[float, dict[str, Any]]) -> None:
        """Take note of an event."""
        message = event[1]
        with self._changed:
            if "why" in message:
                self._counted(message["cause"])
                self._alive.pop(message["worker"], None)
                _keep(self._deaths, message["worker"], (message["why"], message["own"]))
                self._changed.notify_all()
            elif "slow" in message:
                _keep(self._slow, message["worker"], message["slow"])
            else:
                self._alive[message["worker"]] = time.monotonic()

    def of(self, worker: str, nanny: str | None, key: str = "") -> WorkerLostError:
        """Return what became of a worker that its calls have lost, to one of them by its key."""
        with self._changed:
            self._changed.wait_for(lambda: self._deaths.keys() & {worker, nanny}, _WAIT_SECONDS)
            if worker not in self._deaths and nanny in self._deaths:
                self._deaths[worker] = self._deaths.pop(nanny)
            why, own = self._deaths.get(worker, ("its connection ended", False))
            slow = self._slow.get(worker)
        if slow is None:
            return WorkerLostError(worker, why, own=own)
        return WorkerLostError(worker, why, own=slow == key, guilty=slow == key)

    def silent(self) -> list[str]:
        """Return the workers whose machines have not said for a while that they live."""
        now = time.monotonic()
        with self._changed:
            late = now - self._checked > _CHECK_SECONDS
            self._checked = now
            if late:  # this process stood still, and the events are still to come
                self._alive = dict.fromkeys(self._alive, now)
            silent = [each for each, at in self._alive.items() if now - at > _SILENT_SECONDS]
            for each in silent:
                del self._alive[each]
                self._counted("silent")
        return silent


def _keep(known: dict[str, _Value], worker: str, value: _Value) -> None:
    """Note something of a worker; what was noted first goes where there is too much."""
    known[worker] = value
    if len(known) > _MOST:
        del known[next(iter(known))]
