"""How much of the workers each user may keep busy: equal shares among those who want any."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from typing import Final

_DEEP: Final = 2  # bundles per slot given ahead, so that no worker waits for the next one


class Shares:
    """Counts the bundles that each user has with the workers.

    Parameters
    ----------
    slots : callable
        ``() -> int``: bundles that the workers compute at once.
    """

    def __init__(self, slots: Callable[[], int]) -> None:
        self._slots = slots
        self._lock = threading.Lock()
        self._flying: Counter[str] = Counter()
        self._pokes: dict[str, list[Callable[[], None]]] = {}

    def enter(self, owner: str, poke: Callable[[], None]) -> None:
        """Begin to want a share; `poke` is called when it may have become larger."""
        with self._lock:
            self._pokes.setdefault(owner, []).append(poke)

    def leave(self, owner: str, poke: Callable[[], None]) -> None:
        """End to want a share."""
        with self._lock:
            self._pokes[owner].remove(poke)
            if not self._pokes[owner]:
                del self._pokes[owner]
            pokes = [each for some in self._pokes.values() for each in some]
        for each in pokes:
            each()

    def take(self, owner: str) -> int | None:
        """Take room for one bundle; return how many the user had before, or None: no room."""
        with self._lock:
            share = _DEEP * max(1, self._slots()) // max(1, len(self._pokes))
            flying = self._flying[owner]
            if flying >= max(1, share):
                return None
            self._flying[owner] += 1
            return flying

    def give(self, owner: str) -> None:
        """Give back room for one bundle."""
        with self._lock:
            self._flying[owner] -= 1
            if not self._flying[owner]:
                del self._flying[owner]
            pokes = list(self._pokes.get(owner, ()))
        for each in pokes:
            each()
