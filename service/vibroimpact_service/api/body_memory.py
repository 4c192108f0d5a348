"""The memory for request bodies that are being received, shared by all requests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from vibroimpact_service import problems
from vibroimpact_service.problems import ProblemError


class BodyMemory:
    """Counts the bytes of bodies in memory and refuses those beyond a limit.

    Parameters
    ----------
    size : int
        Bytes.
    """

    def __init__(self, size: int) -> None:
        self.left = size

    @contextmanager
    def reserving(self) -> Iterator[Reservation]:
        """Give a reservation that grows with one body and is released at the end."""
        reservation = Reservation(self)
        try:
            yield reservation
        finally:
            self.left += reservation.size


class Reservation:
    """The memory of one body."""

    def __init__(self, memory: BodyMemory) -> None:
        self._memory, self.size = memory, 0

    def grow(self, size: int) -> None:
        """Reserve more bytes.

        Raises
        ------
        ProblemError
            503 where there are none left.
        """
        if size > self._memory.left:
            detail = "Too many large requests are arriving at once."
            raise ProblemError(problems.UNAVAILABLE, detail, headers={"Retry-After": "2"})
        self._memory.left -= size
        self.size += size
