"""The lives of worker processes, near and far: what watches them, and what a service knows of them.

Beside each worker process runs what says that it lives, and why it died. A worker that stands
still, as after SIGSTOP, is killed: its calls are then repeated elsewhere. Its own heartbeats cannot
tell, because a busy worker may be as silent.
"""

from __future__ import annotations

import asyncio
import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

from distributed import NannyPlugin

from vibroimpact_service.jobs.work import WorkerLostError

TOPIC: Final = "vibroimpact-workers"
"""Topic of the events: ``{"worker": address}`` while it lives, else also why, own and cause.

A worker that is ended for the processor time of a call says so before, by its key as ``slow``.
"""
ALIVE_SECONDS: Final = 4

_STOPPED: Final = "it was stopped"
_STARTING_SECONDS: Final = 0.05
_STANDING_SECONDS: Final = 8
_NO_PARENT: Final = 255
"""Status of a process whose forkserver has ended."""
_OWN_FAULTS: Final = frozenset(
    (
        signal.SIGSEGV,
        signal.SIGBUS,
        signal.SIGFPE,
        signal.SIGILL,
        signal.SIGABRT,
        signal.SIGSYS,
        signal.SIGXCPU,
    )
)
"""Signals that the work of a process itself brings about."""
_WAIT_SECONDS: Final = 2.0
_SILENT_SECONDS: Final = 13.0
_CHECK_SECONDS: Final = 4.0
_MOST: Final = 1000

_Value = TypeVar("_Value")


class DeathWatch(NannyPlugin):  # type: ignore[misc]
    """Watches one worker process and its successors."""

    name = "vibroimpact-deaths"
    idempotent = True  # services that share a scheduler register it once

    def setup(self, nanny: Any) -> None:
        """Begin to watch."""
        self._watching = asyncio.ensure_future(_watch(nanny))

    def teardown(self, nanny: Any) -> None:
        """Stop watching."""
        self._watching.cancel()


async def _watch(nanny: Any) -> None:
    last = None
    while True:
        process = _process(nanny)
        if process is None or process.pid is None or process.exitcode is not None:
            await asyncio.sleep(_STARTING_SECONDS)
            continue
        why, own, address = await _death(nanny, process, last)
        last = nanny.worker_address
        # Its nanny's address stands for one that died before its own was known.
        worker = address or nanny.address
        sort = "stopped" if why == _STOPPED else "fault" if own else "killed"
        nanny.log_event(TOPIC, {"worker": worker, "why": why, "own": own, "cause": sort})


def _process(nanny: Any) -> Any:
    """Return the process of the worker, an `AsyncProcess`; distributed 2024.1 to 2026.8."""
    return None if nanny.process is None else nanny.process.process


async def _death(nanny: Any, process: Any, last: str | None) -> tuple[str, bool, str | None]:
    """Wait until a process has ended; return why, whether by its own fault, and its address.

    Until its address is known, the nanny tells that of the last one.
    """
    kills, standing, address, seconds = out_of_memory_kills(), 0, None, 0
    while True:
        try:
            await process.join(1.0 if address else _STARTING_SECONDS)
            break
        except TimeoutError:
            if address is None:
                address = None if nanny.worker_address == last else nanny.worker_address
                continue
            seconds += 1
        except ValueError:  # the process is closed
            break
        if seconds % ALIVE_SECONDS == 0:
            nanny.log_event(TOPIC, {"worker": address})
        standing = standing + 1 if stands_still(process.pid) else 0
        if standing == _STANDING_SECONDS:
            os.kill(process.pid, signal.SIGKILL)
    if standing >= _STANDING_SECONDS:
        return f"it stood still for {_STANDING_SECONDS} s", False, address
    why, own = cause(process.exitcode, out_of_memory=out_of_memory_kills() > kills)
    return why, own, address


def cause(exitcode: int | None, *, out_of_memory: bool) -> tuple[str, bool]:
    """Return why a process ended, and whether its own work brought that about."""
    if not exitcode:
        return _STOPPED, False
    if exitcode == _NO_PARENT:
        return "the process that had started it ended", False
    if exitcode > 0:
        return f"it ended with status {exitcode}", True
    number = -exitcode
    if number == signal.SIGKILL and out_of_memory:
        return "the machine had no memory left", True
    return f"it was killed by {signal.Signals(number).name}", number in _OWN_FAULTS


def stands_still(process: int) -> bool:
    """Whether a process was stopped by a signal or a debugger."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except (OSError, IndexError):
        return False
    return state in "Tt"


def out_of_memory_kills() -> int:
    """Return how many processes of this machine were killed because it had no memory left."""
    try:
        counts = dict(line.split() for line in Path("/proc/vmstat").read_text().splitlines())
    except OSError:
        return 0
    return int(counts.get("oom_kill", 0))


class Deaths:
    """Collects the events of all `DeathWatch`.

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
                keep(self._deaths, message["worker"], (message["why"], message["own"]))
                self._changed.notify_all()
            elif "slow" in message:
                keep(self._slow, message["worker"], message["slow"])
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


def keep(known: dict[str, _Value], worker: str, value: _Value) -> None:
    """Note something of a worker; what was noted first goes where there is too much."""
    known[worker] = value
    if len(known) > _MOST:
        del known[next(iter(known))]
