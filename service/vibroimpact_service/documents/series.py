"""Residual flexibilities in the documents of structures, in series with their constraints."""

from __future__ import annotations

from collections.abc import Sequence

from vibroimpact_solvers import flexibility
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.flexibility import FIELD
from vibroimpact_solvers.model import System

__all__ = ["FIELD", "in_series"]


def in_series(rows: Sequence[Sequence[float]], of: System) -> System:
    """Return a system with a residual flexibility between its constraints.

    Raises
    ------
    ModelError
        Naming the field, or the law of a stop.
    """
    if any(len(row) != len(rows) for row in rows):
        message = "each row needs as many numbers as there are rows"
        raise ModelError((FIELD,), message, code="wrong_length")
    return flexibility.in_series(of, rows)
