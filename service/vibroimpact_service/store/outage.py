"""What a process knows of a server that does not answer, so that not everybody waits for it."""

from __future__ import annotations

import errno
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from vibroimpact_service.store.errors import StoreFullError, StoreUnavailableError

_LONG_SECONDS = 2.0
"""Time after which a request that failed has kept others waiting."""
_TRIAL_SECONDS = 5.0
"""Time after which the next request tries the server: the one before may wait, or be a long one."""


class Outage:
    """Translates the errors of requests to a server, and remembers that it is silent.

    While it is, a request now and then tries it, and all others fail at once: their callers can ask
    another replica, whose way to the server may be open.

    Parameters
    ----------
    patient : bool
        Whether all requests wait, as those of workers: one that failed at once would be given the
        calls of all others.
    """

    def __init__(self, *, patient: bool) -> None:
        self._patient = patient
        self._reason: str | None = None
        self._answered = float("-inf")
        self._next_trial, self._lock = 0.0, threading.Lock()

    @property
    def known(self) -> bool:
        """Whether the server is known to be silent."""
        return self._reason is not None

    def _speaks(self) -> None:
        self._answered = time.monotonic()
        self._reason = None

    def _is_trial(self) -> bool:
        with self._lock:
            now = time.monotonic()
            if now < self._next_trial:
                return False
            self._next_trial = now + _TRIAL_SECONDS
            return True

    @contextmanager
    def requests(self) -> Iterator[None]:
        """Translate all errors of an object store into `StoreUnavailableError`."""
        reason = self._reason
        if reason is not None and not self._is_trial():
            raise StoreUnavailableError(errno.EIO, reason)
        started = time.monotonic()
        try:
            yield
            self._speaks()
        except FileNotFoundError:
            self._speaks()
            raise
        except (StoreFullError, StoreUnavailableError):
            raise
        except Exception as error:
            reason = f"the store cannot be reached: {type(error).__name__}"
            long = time.monotonic() - started > _LONG_SECONDS
            if not long or self._patient:
                self._reason = None
            elif started > self._answered:  # else it has spoken to another one since
                self._reason = reason
            raise StoreUnavailableError(errno.EIO, reason) from error
