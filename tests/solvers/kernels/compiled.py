"""Calls functions from Python that otherwise only kernels call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return an inner function of kernels, compiled so that Python can call it."""
    plain: Any = function
    callable_one: Callable[..., Any] = numba.njit(error_model="numpy")(plain.py_func)
    return callable_one
