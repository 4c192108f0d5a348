"""The memory for request bodies that are being received, shared by all requests."""

from __future__ import annotations

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

    def take(self, size: int) -> None:
        """Reserve some bytes, which whoever took them adds to `left` again.

        Raises
        ------
        ProblemError
            503 where there are none left.
        """
        if size > self.left:
            detail = "Too many large requests are arriving at once."
            raise ProblemError(problems.UNAVAILABLE, detail, headers={"Retry-After": "2"})
        self.left -= size
