"""What can be wrong with a store, and what a process knows of a server that does not answer."""

from __future__ import annotations

import errno
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

_LONG_SECONDS = 2.0
"""Time after which a request that failed has kept others waiting."""
_TRIAL_SECONDS = 5.0
"""Time after which the next request tries the server: the one before may wait, or be a long one."""


class StoreFullError(OSError):
    """The store has no room for another block."""


class StoreUnavailableError(ConnectionError):
    """The store cannot be reached, cannot be read or written at the moment, or refuses."""


def fail(error: OSError) -> NoReturn:
    """Raise what an error of the file system means for the store."""
    # Never from itself: Dask follows the causes of an error to their end.
    if isinstance(error, StoreFullError | StoreUnavailableError):
        raise error
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        raise StoreFullError(error.errno, "the store is full") from error
    reason = (error.strerror or type(error).__name__).lower()
    number = error.errno or errno.EIO
    raise StoreUnavailableError(number, f"the store does not work: {reason}") from error


@contextmanager
def bucket_needed() -> Iterator[None]:
    """Say of a write to a bucket that is not there that the store is not."""
    try:
        yield
    except FileNotFoundError as error:
        raise StoreUnavailableError(errno.ENOENT, "there is no such store") from error


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


class Outage:
    """Translates the errors of requests to a server, and remembers that it is silent.

    Parameters
    ----------
    patient : bool
        Whether all requests wait, as those of workers: one that failed at once would be given the
        calls of all others.
    """

    def __init__(self, *, patient: bool) -> None:
        self._patient, self._silence = patient, Silence()
        self._reason = ""

    @property
    def known(self) -> bool:
        """Whether the server is known to be silent."""
        return self._silence.known

    @contextmanager
    def requests(self) -> Iterator[None]:
        """Translate all errors of an object store into `StoreUnavailableError`."""
        if not self._silence.admits():
            raise StoreUnavailableError(errno.EIO, self._reason)
        started = time.monotonic()
        try:
            yield
            self._silence.spoke()
        except FileNotFoundError:
            self._silence.spoke()
            raise
        except (StoreFullError, StoreUnavailableError):
            raise
        except Exception as error:
            self._reason = f"the store cannot be reached: {type(error).__name__}"
            if not self._patient:
                self._silence.failed(started)
            raise StoreUnavailableError(errno.EIO, self._reason) from error
