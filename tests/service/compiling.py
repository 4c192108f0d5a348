"""Doubles of compilation, which processes can import quickly."""

from __future__ import annotations

import signal
import time
from pathlib import Path


def noted(notes: Path, kind: str, *, seconds: float = 0.0) -> None:
    """Take note of a kind whose kernels would be compiled now."""
    with (notes / kind).open("a") as file:
        file.write("x")
    time.sleep(seconds)


def failing(notes: Path, kind: str) -> None:
    """Fail for one of the kinds."""
    noted(notes, kind)
    if kind == "time-history":
        raise RuntimeError("this kernel cannot be compiled")


def killed(notes: Path, times: int, kind: str) -> None:
    """Be killed for one of the kinds, the first times."""
    noted(notes, kind)
    if kind == "slow-flow" and (notes / kind).stat().st_size <= times:
        signal.raise_signal(signal.SIGKILL)
