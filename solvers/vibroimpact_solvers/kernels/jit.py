"""How kernels are compiled: without the GIL, cached on disk, IEEE arithmetic, no fast-math.

Fast-math would let the compiler reorder the sums whose rounding the error statements bound.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile a function at its first call."""
    return cast(Function, numba.njit(nogil=True, cache=True, error_model="numpy")(function))


def inline(function: Function) -> Function:
    """Compile a small function into its callers."""
    compiled = numba.njit(nogil=True, cache=True, error_model="numpy", inline="always")
    return cast(Function, compiled(function))
