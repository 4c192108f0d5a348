"""The interface between the job queue and the computations: chunks, ticks, functions of a job."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from vibroimpact_solvers import meter

_CANCELLED_SECONDS: Final = 0.05


class Chunk(NamedTuple):
    """A part of a job that is computed by itself, stored by content.

    Parameters
    ----------
    name : str
        Name of its block in the store of chunks.
    seconds : float
        Planned time; 0 where it is unknown.
    lasting : bool
        Whether other jobs can use it too, so that it is kept when this job ends.
    chained : bool
        Whether it needs the chunk before it, so that the chunks are computed one after another.
    """

    name: str
    seconds: float = 0.0
    lasting: bool = False
    chained: bool = False


Tick = Callable[[int, int], None]
"""Called by a computation with its progress, done and total; raises `StoppedError` to stop it."""


TRANSIENT_ERRORS: Final = (OSError,)
"""Errors that are not the job's fault but of what is around it: it is tried again later."""


class StoppedError(Exception):
    """The computation took too long, or was cancelled."""


class LimitPassedError(Exception):
    """The computation passed a limit while it ran; its text says which, and what is kept."""


class StopSignal:
    """Stops a computation from outside or after some time; the `Tick` of all of them.

    Parameters
    ----------
    seconds : float
        Time allowed after the first progress. What came before, such as the compilation of
        kernels, does not count.
    cancelled : callable, optional
        Returns whether the computation was cancelled; called every 50 ms at most.
    enforce : callable, optional
        ``(seconds) -> None``: has the operating system end the process where the computation
        takes more processor time and does not notice.
    """

    def __init__(
        self,
        seconds: float = math.inf,
        cancelled: Callable[[], bool] | None = None,
        enforce: Callable[[float], None] | None = None,
    ) -> None:
        self._seconds, self._cancelled, self._enforce = seconds, cancelled, enforce
        self._began: float | None = None
        self._processor_began, self._processor_end = math.inf, math.inf
        self._next_check = time.monotonic() + _CANCELLED_SECONDS
        self.stopped = False
        self.wanted = True
        self.shares: list[float] = []
        """Processor times at which parts of the call ended; see `end_share`."""

    @property
    def used_seconds(self) -> float:
        """Processor time of this thread, which computes, since the first progress."""
        return meter.processor_time() - self._processor_began

    def end_share(self) -> None:
        """Take note that one of several jobs has ended: what follows is used for the next."""
        self.shares.append(meter.processor_time())

    def stop(self) -> None:
        """Stop the computation at its next progress."""
        self.stopped = True

    def allow(self, seconds: float) -> None:
        """Allow so much processor time of this thread, and of those that help it, from now on."""
        self._processor_end = meter.processor_time() + seconds
        if self._enforce is not None:
            self._enforce(seconds)

    def while_wanted(self, done: int, total: int) -> None:
        """As a call of this, and raise `StoppedError` where nobody wants the outcome any more."""
        if not self.wanted:
            raise StoppedError
        self(done, total)

    def __call__(self, _done: int, _total: int) -> None:
        """Raise `StoppedError` or `LimitPassedError` where the computation is to stop."""
        if meter.processor_time() > self._processor_end:
            raise LimitPassedError
        now = time.monotonic()
        if self._began is None:
            self._began, self._processor_began = now, meter.processor_time()
        if self._cancelled is not None and now >= self._next_check:
            self._next_check = now + _CANCELLED_SECONDS
            self.stopped = self.stopped or self._cancelled()
        if self.stopped or now > self._began + self._seconds:
            raise StoppedError


class ChunkMissingError(Exception):
    """A chunk is absent or damaged, and must be computed again before the job can be joined."""


class WorkerLostError(RuntimeError):
    """The worker process of a computation died.

    Parameters
    ----------
    worker : str
        Its address.
    why : str
    own : bool
        Whether the computation can have brought it about: by a fault, or by its need of memory.
    guilty : bool
        Whether it is known to have done so: the worker was ended for its processor time.
    """

    def __init__(
        self, worker: str = "", why: str = "", *, own: bool = True, guilty: bool = False
    ) -> None:
        super().__init__(worker, why)
        self.worker, self.why, self.own, self.guilty = worker, why, own, guilty


class DeadlineError(RuntimeError):
    """A job was not done by its deadline."""


def nothing() -> None:
    """Prepare nothing."""


@dataclass(frozen=True, slots=True)
class Work:
    """How jobs are split, computed and joined: functions for all kinds of computations.

    They are functions of modules, because worker processes import them. All but `explain` run in
    workers; each of them may be called again after a crash.

    Parameters
    ----------
    split : callable
        ``(store_url, kind, request, result) -> chunks``, deterministic.
    solve : callable
        ``(store_url, kind, request, result, indices, tick) -> None``: computes those chunks
        and stores each under its name. Calls `tick` often.
    join : callable
        ``(store_url, kind, request, result, chunks) -> None``: stores the result; raises
        `ChunkMissingError` where a chunk cannot be read.
    explain : callable
        ``(exception) -> problem document`` for a job that failed.
    prepare : callable
        Called once in every worker as it starts, in a thread: imports modules that load slowly.
    modules : tuple of str
        Modules that load slowly, imported by the process from which workers are forked.
    """

    split: Callable[[str, str, str, str], Sequence[Chunk]]
    solve: Callable[[str, str, str, str, Sequence[int], Tick | None], None]
    join: Callable[[str, str, str, str, Sequence[Chunk]], None]
    explain: Callable[[BaseException], dict[str, Any]]
    prepare: Callable[[], None] = nothing
    modules: tuple[str, ...] = ()
