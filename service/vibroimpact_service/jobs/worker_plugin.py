"""What runs in a worker process beside its calls: loading of modules, stopping of calls."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Final

from distributed import WorkerPlugin

from vibroimpact_service.jobs.death_watch import TOPIC
from vibroimpact_service.jobs.process_limits import call_ended, limit_call, limit_memory
from vibroimpact_service.jobs.work import StopSignal

_running: Final[set[str]] = set()
"""Keys of the calls that threads of this process execute."""
_tell: Final[list[Callable[[str], None]]] = []
"""How the services learn which call a worker is ended for."""
_cancelled: Final[set[str]] = set()
"""Keys of those among them that the scheduler does not want any more."""


class ServicePlugin(WorkerPlugin):  # type: ignore[misc]
    """Prepares each worker, and takes note when the scheduler cancels a call that it executes.

    Parameters
    ----------
    prepare : callable
        Called once in every worker as it starts, in a thread of its own.
    """

    name = "vibroimpact"
    idempotent = True  # services that share a scheduler register it once

    def __init__(self, prepare: Callable[[], None]) -> None:
        self._prepare = prepare

    def setup(self, worker: Any) -> None:
        """Limit the memory of the worker, and begin to prepare it."""
        limit_memory(worker.memory_manager.memory_limit)

        def tell(key: str) -> None:
            event = {"worker": worker.address, "slow": key}
            worker.loop.add_callback(worker.log_event, TOPIC, event)

        _tell[:] = [tell]
        threading.Thread(target=self._prepare, name="prepare", daemon=True).start()

    def transition(self, key: Any, start: str, finish: str, **_: Any) -> None:
        """Take note of a new state of a call."""
        # What counts is that a call was taken away, not that it was never seen to be assigned:
        # a worker may execute calls of a scheduler that restarted before it has this plugin.
        if finish == "executing":
            _cancelled.discard(key)
        elif start == "executing" and key in _running:
            _cancelled.add(key)


def execute(function: Callable[..., Any], key: str, *args: Any) -> Any:
    """Call a function in a worker, with a `StopSignal` for a cancelled call as last argument."""
    _running.add(key)

    def limit(seconds: float) -> None:
        limit_call(key, seconds, _tell[0] if _tell else None)

    try:
        signal = StopSignal(cancelled=lambda: key in _cancelled, enforce=limit)
        return function(*args, signal)
    finally:
        call_ended()
        _running.discard(key)
        _cancelled.discard(key)


def running_calls() -> list[str]:
    """Return the keys of the calls that threads of this worker execute, cancelled ones included."""
    return list(_running)
