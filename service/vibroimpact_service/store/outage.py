"""Errors of requests to an object store, and what is known of its server."""

from __future__ import annotations

import errno
import time
from collections.abc import Iterator
from contextlib import contextmanager

from vibroimpact_service.store.errors import StoreFullError, StoreUnavailableError
from vibroimpact_service.store.silence import Silence


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
