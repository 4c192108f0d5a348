"""Calls functions from Python that otherwise only kernels call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that Python can call, in place of an inner function of kernels."""

    def call(*arguments: Any) -> Any:
        return function(*arguments)

    wrapped: Callable[..., Any] = numba.njit(error_model="numpy")(call)
    return wrapped
