"""The interface between the job queue and the computations: chunks, functions of a job."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from vibroimpact_solvers.plan import Tick


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


TRANSIENT_ERRORS: Final = (OSError,)
"""Errors that are not the job's fault but of what is around it: it is tried again later."""


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
