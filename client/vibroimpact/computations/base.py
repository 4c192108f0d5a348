"""What the computations of all kinds have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any


class AnyComputation(ABC):
    """Answers requests: by results, by awaitable ones, or by the requests themselves."""

    @abstractmethod
    def _compute(self, kind: str, request: Mapping[str, Any], *, progress: bool = False) -> Any:
        """Return the answer to a request."""
