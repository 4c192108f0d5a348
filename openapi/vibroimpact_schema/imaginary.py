"""Imaginary parts, which numbers of structures here do not have."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

LOST: Final = (
    "would be lost: numbers are real here. Structural damping, K (1 + i eta), is viscous damping "
    "C = eta K / Omega at one frequency"
)
"""What is said of imaginary parts."""


def real(name: str, given: Any) -> Any:
    """Return numbers, an array or a sparse matrix, without imaginary parts that are 0.

    Raises
    ------
    ValueError
        If an imaginary part is not 0.
    """
    values = given if hasattr(given, "tocoo") else np.asarray(given)
    if values.dtype.kind != "c":
        return values
    imaginary = values.imag
    largest = abs(imaginary.tocoo() if hasattr(imaginary, "tocoo") else imaginary).max()
    if largest != 0.0:
        raise ValueError(f"{name} has imaginary parts, the largest {largest:.3g}, which {LOST}")
    return values.real
