"""Nothing runs for ever: a limit of time for each part, and an end that cleans up."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

LONGEST = 240.0
"""Seconds that one table may take."""


class TooLongError(Exception):
    """A part took longer than it may."""


@contextmanager
def at_most(seconds: float = LONGEST) -> Iterator[None]:
    """Raise `TooLongError` in the block after that time, and again until it ends.

    The services that it started are stopped on the way out, as they are when the process is
    asked to terminate. Where there are no such signals, or in another thread, nothing is limited.
    """
    if not hasattr(signal, "SIGALRM") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def late(number: int, frame: FrameType | None) -> None:
        raise TooLongError(f"not done after {seconds:g} s")

    def asked(number: int, frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    alarm = signal.signal(signal.SIGALRM, late)
    end = signal.signal(signal.SIGTERM, asked)
    # What hangs while it cleans up is woken again.
    signal.setitimer(signal.ITIMER_REAL, seconds, max(1.0, 0.5 * seconds))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, alarm)
        signal.signal(signal.SIGTERM, end)
