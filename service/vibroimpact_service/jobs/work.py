"""What the job queue must be given to do its work: it knows no kind of computation itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol


class Chunk(NamedTuple):
    """One piece of a job, stored by content.

    Parameters
    ----------
    name : str
        Name of its block in the store of chunks.
    seconds : float
        Planned time; 0 where nobody knows.
    lasting : bool
        Whether other jobs may use it too, so that it outlives this one.
    chained : bool
        Whether it needs the chunk before it, so that those of a job are computed in turn.
    """

    name: str
    seconds: float = 0.0
    lasting: bool = False
    chained: bool = False


class Tick(Protocol):
    """Told how far a call is; raises `StoppedError` once nobody waits for it any more."""

    def __call__(self, done: int, total: int, /) -> None:
        """Take note; raise `StoppedError` where the call is to stop."""


class StoppedError(Exception):
    """The call was given up: nobody waits for its outcome."""


class ChunkMissingError(Exception):
    """A chunk is absent or damaged, and must be computed again before the job can be joined."""


class WorkerLostError(RuntimeError):
    """A computation killed its worker again and again."""


class DeadlineError(RuntimeError):
    """A job was not done by its deadline."""


def nothing() -> None:
    """Prepare nothing."""


@dataclass(frozen=True, slots=True)
class Work:
    """How a job is cut, computed and put together.

    The functions are module-level ones, because workers in other processes import them. All
    but `explain` run in workers; any of them can be called again after a crash.

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
        Called once in every worker as it starts, beside its work: loads what is slow to load.
    modules : tuple of str
        What is slow to load, for workers that are forked from a process that has it.
    """

    split: Callable[[str, str, str, str], Sequence[Chunk]]
    solve: Callable[[str, str, str, str, Sequence[int], Tick | None], None]
    join: Callable[[str, str, str, str, Sequence[Chunk]], None]
    explain: Callable[[BaseException], dict[str, Any]]
    prepare: Callable[[], None] = nothing
    modules: tuple[str, ...] = ()
