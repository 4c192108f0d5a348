"""Cache of computed values by a hash of their input, bounded by the memory they hold."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import Final, Protocol, TypeVar, cast

import numpy as np


class Sized(Protocol):
    """A value that states the memory it holds."""

    @property
    def nbytes(self) -> int:
        """Memory held."""


Value = TypeVar("Value", bound=Sized)


class Cache:
    """Least-recently-used cache; safe to use from several threads.

    Two threads that need the same value compute it once: the second waits for the first. Values
    hold up to `limit` bytes, and `most` of them if that is given; the last one stays even if it
    alone is larger.
    """

    def __init__(self, limit: int, most: int | None = None) -> None:
        self._limit, self._most = limit, most
        self._held: OrderedDict[bytes, Sized] = OrderedDict()
        self._under_way: dict[bytes, threading.Lock] = {}
        self._lock = threading.Lock()

    def get(self, key: bytes, compute: Callable[[], Value]) -> Value:
        """Return the value of that key, computing it where it is not held."""
        with self._lock:
            if key in self._held:
                self._held.move_to_end(key)
                return cast(Value, self._held[key])
            turn = self._under_way.setdefault(key, threading.Lock())
        with turn:
            with self._lock:
                if key in self._held:
                    return cast(Value, self._held[key])
            try:
                value = compute()
                with self._lock:
                    self._held[key] = value
                    self._shrink()
            finally:
                with self._lock:
                    self._under_way.pop(key, None)
        return value

    def resize(self, limit: int) -> None:
        """Hold up to so many bytes from now on."""
        with self._lock:
            self._limit = limit
            self._shrink()

    def _shrink(self) -> None:
        if self._most is not None and len(self._held) > self._most:
            self._held.popitem(last=False)
        total = sum(value.nbytes for value in self._held.values())
        while len(self._held) > 1 and total > self._limit:
            _, oldest = self._held.popitem(last=False)
            total -= oldest.nbytes

    def clear(self) -> None:
        """Forget all values."""
        with self._lock:
            self._held.clear()

    def __contains__(self, key: bytes) -> bool:
        with self._lock:
            return key in self._held

    @property
    def nbytes(self) -> int:
        """Bytes held now."""
        with self._lock:
            return sum(value.nbytes for value in self._held.values())


def held_bytes(*values: object) -> int:
    """Return the memory of all arrays that objects of this package hold, each counted once."""
    seen: set[int] = set()
    waiting, total = list(values), 0
    while waiting:
        value = waiting.pop()
        if id(value) in seen:
            continue
        seen.add(id(value))
        match value:
            case np.ndarray():
                if isinstance(value.base, np.ndarray):
                    waiting.append(value.base)
                else:
                    total += value.nbytes
            case Mapping():
                waiting += value.values()
            case tuple() | list():
                waiting += value
            case _ if type(value).__module__.startswith(_PACKAGE):
                names = getattr(type(value), "__slots__", ())
                waiting += [getattr(value, name, None) for name in names]
                waiting += getattr(value, "__dict__", {}).values()
    return total


_PACKAGE: Final = __name__.partition(".")[0]


CACHE: Final = Cache(512 * 2**20)
"""The cache of this process."""
