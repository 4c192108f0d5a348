"""What a process knows of a server that does not answer, so that not everybody waits for it."""

from __future__ import annotations

import threading
import time

_LONG_SECONDS = 2.0
"""Time after which a request that failed has kept others waiting."""
_TRIAL_SECONDS = 5.0
"""Time after which the next request tries the server: the one before may wait, or be a long one."""


class Silence:
    """Remembers that a server is silent.

    While it is, a request now and then tries it, and all others are to fail at once: their callers
    can ask another replica, whose way to the server may be open.
    """

    def __init__(self) -> None:
        self.known = False
        """Whether the server is known to be silent."""
        self._answered = float("-inf")
        self._next_trial, self._lock = 0.0, threading.Lock()

    def admits(self) -> bool:
        """Whether a request may be made now; of a silent server, it is the one that tries."""
        if not self.known:
            return True
        with self._lock:
            now = time.monotonic()
            if now < self._next_trial:
                return False
            self._next_trial = now + _TRIAL_SECONDS
            return True

    def spoke(self) -> None:
        """Remember that the server answered."""
        self._answered = time.monotonic()
        self.known = False

    def failed(self, started: float) -> None:
        """Remember that a request, begun at that time of the monotonic clock, had no answer."""
        if time.monotonic() - started <= _LONG_SECONDS:
            self.known = False  # nobody is kept waiting
        elif started > self._answered:  # else it has spoken to another one since
            self.known = True
