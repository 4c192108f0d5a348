"""Checks of problems that are common to several kinds."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from vibroimpact_solvers.arrays import Integers
from vibroimpact_solvers.errors import ModelError


def check_outputs(requested: frozenset[str], known: Collection[str]) -> None:
    """Raise `ModelError` unless at least one output is requested, and only known ones."""
    if not requested or not requested <= set(known):
        message = f"available outputs are {', '.join(known)}"
        raise ModelError(("outputs",), message, code="unknown_output")


def check_tolerance(tolerance: float | None) -> None:
    """Raise `ModelError` unless a relative tolerance, if given, lies between 0 and 1."""
    if tolerance is not None and not 0.0 < tolerance < 1.0:
        message = f"the tolerance is {tolerance!r}, not between 0 and 1"
        raise ModelError(("tolerance",), message, code="out_of_range")


def check_indices(name: str, indices: Integers, limit: int) -> None:
    """Raise `ModelError` unless indices are at least 0, below a limit, and distinct."""
    outside = (indices < 0) | (indices >= limit)
    if outside.any():
        place = int(outside.argmax())
        message = f"{int(indices[place])} is not below {limit}"
        raise ModelError((name, place), message, code="index_out_of_range")
    if indices.size > 1 and np.bincount(indices, minlength=limit).max() > 1:
        raise ModelError((name,), "an index is given twice", code="duplicate_index")
