"""How kernels are compiled: without the GIL, kept on disk (`cache`), IEEE arithmetic, no fast-math.

Fast-math would let the compiler reorder the sums whose rounding the error statements bound.
Fused multiply-adds are written explicitly: `fma`. Kernels run in parallel by threads
(`kernels.threads`) and not by numba's own, some layers of which fail with two callers.

With ``NUMBA_DISABLE_JIT=1`` all functions stay plain Python (`kernels.plain`), and numba is not
even imported here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar, cast

from vibroimpact_solvers.kernels import plain
from vibroimpact_solvers.kernels.plain import PLAIN, record

if not PLAIN:
    import numba

    from vibroimpact_solvers.kernels import cache, intrinsics

__all__ = [
    "bare", "fma", "inline", "inner", "is_odd_bit", "kernel", "never_inlined", "once", "product",
    "record", "sums",
]  # fmt: skip

Function = TypeVar("Function", bound=Callable[..., Any])

_FOLDER: Final = None if PLAIN else cache.folder()


def _compiled(function: Function, **options: Any) -> Function:
    if PLAIN:
        return plain.uncompiled(function)
    njit: Any = numba.njit  # its stubs do not know all options
    return cast(Function, njit(nogil=True, error_model="numpy", **options)(function))


def kernel(function: Function, **options: Any) -> Function:
    """Compile a function that Python calls, at its first call, and keep it on disk.

    Functions of other packages, such as tests, are compiled in each process.
    """
    if PLAIN:
        return plain.entered(function)
    if _FOLDER is None or function.__module__ not in cache.folders():
        return _compiled(function, **options)
    with cache.kept_in(_FOLDER):
        return _compiled(function, cache=True, **options)


def bare(function: Function) -> Function:
    """Compile a `kernel` that makes no arrays, without counts of references (`inner`)."""
    return kernel(function, _nrt=False)


def inner(function: Function) -> Function:
    """Compile a function that only kernels call, and that makes no arrays.

    It is not kept by itself, as the kernels that call it contain it, and cannot be called from
    Python: both would take half as long as compiling it. References to arrays are not counted:
    each count is an atomic operation, wherever an array gets another name, and in small structures
    they would last longer than the arithmetic.
    """
    return _compiled(function, **_INNER)


def inline(function: Function) -> Function:
    """Compile an `inner` function into its callers, so that their loops become vector loops.

    LLVM does it. Numba itself (``inline="always"``) would copy the function before types are
    known, and then infer them and lower it again in each caller.
    """
    return _compiled(function, **_INNER | {"forceinline": True})


def product(function: Function) -> Function:
    """Compile an `inner` function that consists of a matrix product by BLAS.

    Numba's own code for it counts references.
    """
    return _compiled(function, **_INNER | {"_nrt": True})


def sums(function: Function) -> Function:
    """Compile an `inline` function whose sums of positive terms may be made in any order.

    Only so can a loop over terms be a vector loop. What rounding then does to a sum of n positive
    terms, n units of its last place at most in any order, must not matter or be accounted for.
    """
    return _compiled(function, **_INNER | {"forceinline": True, "fastmath": {"reassoc"}})


def once(function: Function) -> Function:
    """Copy an `inner` function that has one caller into it, before types are known.

    LLVM would otherwise optimise everything that it calls twice.
    """
    return _compiled(function, inline="always", **_INNER)


_INNER: Final = {
    "_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True,
    # Without a word, these would be those of the function that happens to be compiled first of all
    # that call it.
    "forceinline": False, "fastmath": False,
}  # fmt: skip

fma: Callable[[float, float, float], float] = plain.fma if PLAIN else intrinsics.fma
"""``a * b + c`` rounded once."""

is_odd_bit: Callable[[float], bool] = plain.is_odd_bit if PLAIN else intrinsics.is_odd_bit
"""Whether the last bit of the significand is set."""

never_inlined: Callable[[], None] = plain.never_inlined if PLAIN else intrinsics.never_inlined
"""Called first in a function: keep it apart, where LLVM would copy it into each of its callers.

For what is long and seldom runs: each copy is optimised again, in each kernel that contains it.
"""
