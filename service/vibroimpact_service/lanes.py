"""Lanes: processes that compute what is answered at once.

A computation that does not look at its signal cannot be stopped in a thread, and the memory that it
takes is missing for everything else. A lane is ended instead, and another one takes its place.
"""

from __future__ import annotations

import asyncio
import os
import pickle
import queue
import signal as signals
import threading
import time
import traceback
from asyncio.events import TimerHandle
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Final

import structlog

from vibroimpact_service import loading, logs, problems
from vibroimpact_service.jobs import forkserver, process_limits
from vibroimpact_service.jobs.work import StoppedError, StopSignal
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

log = structlog.get_logger("vibroimpact.lanes")

Work = Callable[[Settings, Store, StopSignal], Any]
"""What a lane computes; it goes to another process."""

_LOOK_SECONDS: Final = 0.05
_GRACE_SECONDS: Final = 0.4
"""Time in which a computation that is stopped has to notice; then its lane is ended."""
_LATE_SECONDS: Final = 0.5
"""More than any plan of what is answered at once, before it makes room for one that waits."""
_MISSING_SECONDS: Final = 1.0
"""Time in which lanes that ended are replaced."""
_RETRY_SECONDS: Final = 0.5
_LARGE_WORK: Final = 2**15
"""Bytes above which work is sent in a thread: the process has to read it meanwhile."""

_STOP: Final = "stop"
_WANTED: Final = {True: "wanted", False: "unwanted"}


@dataclass(eq=False, slots=True)
class _Call:
    """Something to compute, and who waits for it."""

    work: Work
    signal: StopSignal
    size: int
    outcome: asyncio.Future[Any]
    handed: float
    """When it came, by the clock of the event loop."""
    timer: TimerHandle | None = None
    began: float = 0.0
    wanted: bool = True

    def fail(self, error: BaseException) -> None:
        """Tell those who wait that there is no result, if they still wait."""
        if not self.outcome.done():
            self.outcome.set_exception(error)


class _Lane:
    """A process that computes one call after another."""

    def __init__(self, settings: Settings) -> None:
        context = get_context("forkserver")
        self.calls, calls = context.Pipe()
        # Nothing is written to it: its end tells the process that this one has ended.
        alive, self._alive = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_serve, args=(calls, alive, settings), daemon=True, name="lane"
        )
        self._process.start()
        calls.close()
        alive.close()
        self.number = 0
        """Of the last call."""
        self.call: _Call | None = None
        self.stopping: TimerHandle | None = None
        """Set while a call that was given up may notice."""

    def kill(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self.calls.close()
        self._alive.close()


class Lanes:
    """All lanes of a service. Calls wait in a row for the first that is free.

    Parameters
    ----------
    settings : Settings

    Attributes
    ----------
    unfinished : int
        Calls that are computed or wait.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._late_seconds = settings.inline_seconds + _LATE_SECONDS
        self._lanes: set[_Lane] = set()
        self._free: list[_Lane] = []
        self._row: dict[_Call, None] = {}
        self._wanted: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._closed = False
        self._missing = 0.0
        self._failure = "starting"
        self.unfinished = 0

    def start(self) -> None:
        """Begin to start the processes, and to replace those that end."""
        self._loop = asyncio.get_running_loop()
        for _ in range(self._settings.inline_threads):
            self._wanted.put(True)
        threading.Thread(target=self._fill, name="lanes", daemon=True).start()

    def close(self) -> None:
        """End all processes."""
        self._closed = True
        self._wanted.put(False)
        for call in list(self._row):
            call.fail(StoppedError())
        for lane in list(self._lanes):
            self._remove(lane)

    @property
    def state(self) -> str:
        """Whether there are lanes: ``ok``, or why there have been none for a while."""
        if self._lanes or time.monotonic() - self._missing < _MISSING_SECONDS:
            return "ok"
        return f"none is free: {self._failure}"

    @property
    def saturated(self) -> bool:
        """Whether the first in the row has waited for too long, or the row is too long."""
        if self.unfinished >= self._settings.max_waiting:
            return True
        first = next(iter(self._row), None)
        waited = 0.0 if first is None else self._loop.time() - first.handed
        return waited > self._settings.max_waiting_seconds

    def compute(self, work: Work, signal: StopSignal, size: int = 0) -> asyncio.Future[Any]:
        """Return what some work returns in a lane; it has `StoppedError` where there is no result.

        It is given up where the signal says so, or where it takes longer than anything that is
        answered at once while somebody waits for a lane.

        Parameters
        ----------
        work : callable
            Its process is ended where it does not look at its signal soon.
        signal : StopSignal
        size : int
            Bytes of the work, about.

        Raises
        ------
        ProblemError
            503 where too many wait, or for too long.
        StoppedError
            Where there are no lanes.
        """
        if self.saturated:
            raise problems.overloaded(self.unfinished)
        if self.state != "ok":
            raise StoppedError
        call = _Call(work, signal, size, self._loop.create_future(), self._loop.time())
        self.unfinished += 1
        call.outcome.add_done_callback(lambda _: self._ended(call))
        if self._free:
            # The last one to be used knows the kernels and structures of its last requests.
            self._begin(self._free.pop(), call)
        else:
            self._row[call] = None
            call.timer = self._loop.call_later(
                self._settings.max_waiting_seconds, self._give_up, call
            )
        return call.outcome

    def _give_up(self, call: _Call) -> None:
        call.fail(problems.overloaded(self.unfinished) if self._lanes else StoppedError())

    def _ended(self, call: _Call) -> None:
        """Take note that nobody waits for a call any more."""
        self.unfinished -= 1
        self._row.pop(call, None)
        if call.timer is not None:
            call.timer.cancel()

    def _begin(self, lane: _Lane, call: _Call) -> None:
        if call.timer is not None:
            call.timer.cancel()
        lane.number += 1
        lane.call, call.began = call, self._loop.time()
        call.timer = self._loop.call_later(_LOOK_SECONDS, self._look, lane, call)
        message = lane.number, call.work
        if call.size > _LARGE_WORK:
            threading.Thread(target=_send, args=(lane, message), daemon=True).start()
        else:
            _send(lane, message)

    def _look(self, lane: _Lane, call: _Call) -> None:
        """Look whether a call is to go on."""
        try:
            call.signal(0, 1)
        except StoppedError:
            self._stop(lane, call)
            return
        if self._row and self._loop.time() - call.began > self._late_seconds:
            log.info("makes room for others")
            self._stop(lane, call)
            return
        if call.signal.wanted != call.wanted:
            call.wanted = call.signal.wanted
            _send(lane, (lane.number, _WANTED[call.wanted]))
        call.timer = self._loop.call_later(_LOOK_SECONDS, self._look, lane, call)

    def _stop(self, lane: _Lane, call: _Call) -> None:
        """Have a lane give up what it computes."""
        call.fail(StoppedError())
        lane.call = None
        _send(lane, (lane.number, _STOP))
        lane.stopping = self._loop.call_later(_GRACE_SECONDS, self._end, lane)

    def _end(self, lane: _Lane) -> None:
        """End a lane that did not notice, unless this process is late itself."""
        if lane.calls.poll():
            self._receive(lane)
            return
        log.warning("a computation did not stop: its lane is replaced")
        self._remove(lane)

    def _receive(self, lane: _Lane) -> None:
        """Pass on what a lane has computed, and let it go on with the next call."""
        try:
            _, succeeded, value = lane.calls.recv()
        except (EOFError, OSError):
            log.warning("the process of a lane ended")
            self._remove(lane)
            return
        call, lane.call = lane.call, None
        if lane.stopping is not None:
            lane.stopping.cancel()
            lane.stopping = None
        if call is not None and not call.outcome.done():
            if succeeded:
                call.outcome.set_result(value)
            else:
                call.outcome.set_exception(value)
        self._next(lane)

    def _next(self, lane: _Lane) -> None:
        for call in self._row:
            del self._row[call]
            self._begin(lane, call)
            return
        self._free.append(lane)

    def _remove(self, lane: _Lane) -> None:
        """Take leave of a lane; what it computed is begun again elsewhere."""
        self._loop.remove_reader(lane.calls.fileno())
        if lane.stopping is not None:
            lane.stopping.cancel()
        lane.kill()
        self._lanes.discard(lane)
        if lane in self._free:
            self._free.remove(lane)
        if lane.call is not None:
            lane.call.fail(StoppedError())
        if not self._lanes:
            self._missing = time.monotonic()
        if not self._closed:
            self._wanted.put(True)

    def _add(self, lane: _Lane) -> None:
        if self._closed:
            lane.kill()
            return
        self._lanes.add(lane)
        self._loop.add_reader(lane.calls.fileno(), self._receive, lane)
        self._next(lane)

    def _fill(self) -> None:
        """Start processes that are missing, until the end. A start may hang with the forkserver."""
        with suppress(OSError):
            forkserver.start(loading.NUMERICAL)
        while self._wanted.get() and not self._closed:
            try:
                lane = _Lane(self._settings)
                self._loop.call_soon_threadsafe(self._add, lane)
            except (OSError, EOFError) as error:  # no memory, no descriptor, no forkserver
                self._failure = f"{type(error).__name__}: {error}"
                log.warning("a lane cannot be started", reason=self._failure)
                time.sleep(_RETRY_SECONDS)
                self._wanted.put(True)
            except RuntimeError:  # the event loop has ended
                return


def _send(lane: _Lane, message: tuple[Any, ...]) -> None:
    # The end of a process is noticed where its answer is read.
    with suppress(OSError):
        lane.calls.send(message)


def _serve(calls: Connection, alive: Connection, settings: Settings) -> None:
    """Answer calls, in a process of its own, until the process that asks ends."""
    signals.signal(signals.SIGINT, signals.SIG_IGN)  # the asking process ends this one
    logs.to_stderr()
    threading.Thread(target=_end_with, args=(alive,), name="alive", daemon=True).start()
    process_limits.limit_memory(process_limits.memory_in_use() + settings.inline_memory_bytes)
    store = Store(settings.store_url, patient=False)
    while True:
        try:
            number, work = calls.recv()
            if not isinstance(work, str):  # a wish about a call that has ended
                calls.send((number, *_answer(calls, settings, store, number, work)))
        except (EOFError, OSError):
            return


def _end_with(alive: Connection) -> None:
    """End this process, whatever it computes, when the other end of a pipe does."""
    with suppress(EOFError, OSError):
        alive.recv()
    os._exit(0)


def _answer(
    calls: Connection, settings: Settings, store: Store, number: int, work: Work
) -> tuple[bool, Any]:
    """Return whether a call succeeded, and its value or why it did not."""

    def stopped() -> bool:
        while calls.poll():
            of, wish = calls.recv()
            if of == number and wish == _STOP:
                return True
            signal.wanted = wish == _WANTED[True]
        return False

    signal = StopSignal(settings.inline_overrun_seconds, cancelled=stopped)
    try:
        return True, work(settings, store, signal)
    except MemoryError:
        return False, StoppedError()  # a worker may have more
    except Exception as error:
        return False, _portable(error)


def _portable(error: Exception) -> Exception:
    """Return an error, or one with its traceback where it cannot go to another process."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError("".join(traceback.format_exception(error)))
    return error
