"""Calls functions from Python that otherwise only kernels call."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Final

from vibroimpact_solvers.kernels.plain import PLAIN, entered

if not PLAIN:
    import numba

    from vibroimpact_solvers.kernels.cache import folder, kept_in

    _FOLDER: Final = folder()


@cache
def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return an inner function of kernels, compiled so that Python can call it.

    It is kept beside the kernels, and compiled anew where one of them changed. Where kernels run
    as plain Python, it is not compiled.
    """
    if PLAIN:
        return entered(function)
    inner: Any = function
    if _FOLDER is None:
        plain: Callable[..., Any] = numba.njit(error_model="numpy")(inner.py_func)
        return plain
    with kept_in(_FOLDER):
        kept: Callable[..., Any] = numba.njit(error_model="numpy", cache=True)(inner.py_func)
    return kept
