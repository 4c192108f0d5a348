"""Equal shares of the workers for all users who have chunks to compute."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from typing import Final

BATCHES_PER_WORKER: Final = 2  # one is computed, one waits, so that no worker idles between them


class FairShare:
    """Limits how many batches of chunks each user has at the workers at a time.

    Parameters
    ----------
    workers : callable
        ``() -> int``: batches that the workers compute at once.
    """

    def __init__(self, workers: Callable[[], int]) -> None:
        self._workers = workers
        self._lock = threading.Lock()
        self._batches: Counter[str] = Counter()
        self._listeners: dict[str, list[Callable[[], None]]] = {}

    def join(self, owner: str, grown: Callable[[], None]) -> None:
        """Begin to share; `grown` is called when the user's share may have become larger."""
        with self._lock:
            self._listeners.setdefault(owner, []).append(grown)

    def leave(self, owner: str, grown: Callable[[], None]) -> None:
        """Stop sharing, with the arguments of `join`."""
        with self._lock:
            self._listeners[owner].remove(grown)
            if not self._listeners[owner]:
                del self._listeners[owner]
            listeners = [each for some in self._listeners.values() for each in some]
        for listener in listeners:
            listener()

    def acquire(self, owner: str) -> int | None:
        """Reserve a place for one batch; return how many the user had before, or None: no place."""
        with self._lock:
            users = max(1, len(self._listeners))
            share = BATCHES_PER_WORKER * max(1, self._workers()) // users
            batches = self._batches[owner]
            if batches >= max(1, share):
                return None
            self._batches[owner] += 1
            return batches

    def release(self, owner: str) -> None:
        """Free the place of one batch."""
        with self._lock:
            self._batches[owner] -= 1
            if not self._batches[owner]:
                del self._batches[owner]
            listeners = list(self._listeners.get(owner, ()))
        for listener in listeners:
            listener()
