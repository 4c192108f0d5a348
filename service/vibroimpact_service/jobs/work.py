"""What the job queue must be given to do its work: it knows no kind of computation itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Work:
    """How a job is cut, computed and put together.

    The functions are module-level ones, because workers in other processes import them.

    Parameters
    ----------
    split : callable
        ``(store_url, kind, request, result) -> chunk names``, deterministic.
    solve : callable
        ``(store_url, kind, request, result, indices) -> None``: computes those chunks and
        stores each under its name.
    join : callable
        ``(store_url, kind, request, result, names) -> None``: stores the result.
    explain : callable
        ``(exception) -> problem document`` for a job that failed.
    """

    split: Callable[[str, str, str, str], Sequence[str]]
    solve: Callable[[str, str, str, str, Sequence[int]], None]
    join: Callable[[str, str, str, str, Sequence[str]], None]
    explain: Callable[[BaseException], dict[str, Any]]
