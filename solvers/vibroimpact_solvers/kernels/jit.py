"""How kernels are compiled: without the GIL, kept on disk (`cache`), IEEE arithmetic, no fast-math.

Fast-math would let the compiler reorder the sums whose rounding the error statements bound.
Fused multiply-adds are written explicitly: `fma`. Kernels run in parallel by threads
(`kernels.threads`) and not by numba's own, some layers of which fail with two callers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar, cast

import numba
from numba import types
from numba.extending import intrinsic

from vibroimpact_solvers.kernels import cache

Function = TypeVar("Function", bound=Callable[..., Any])


_FOLDER: Final = cache.folder()


def _compiled(function: Function, **options: Any) -> Function:
    njit: Any = numba.njit  # its stubs do not know all options
    return cast(Function, njit(nogil=True, error_model="numpy", **options)(function))


def kernel(function: Function, **options: Any) -> Function:
    """Compile a function that Python calls, at its first call, and keep it on disk."""
    if _FOLDER is None:
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
    return _compiled(function, forceinline=True, **_INNER)


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
    return _compiled(function, forceinline=True, fastmath={"reassoc"}, **_INNER)


def once(function: Function) -> Function:
    """Copy an `inner` function that has one caller into it, before types are known.

    LLVM would otherwise optimise everything that it calls twice.
    """
    return _compiled(function, inline="always", **_INNER)


_INNER: Final = {"_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def _fused(typing: Any, a: Any, b: Any, c: Any) -> tuple[Any, Callable[..., Any]]:
    """Emit one instruction for ``a * b + c`` with a single rounding."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


def _lowest_bit(typing: Any, a: Any) -> tuple[Any, Callable[..., Any]]:
    """Emit a test of the last bit of a number's significand."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        number = context.get_value_type(types.int64)
        bits = builder.bitcast(arguments[0], number)
        return builder.trunc(bits, context.get_value_type(types.boolean))

    return types.boolean(types.float64), generate


is_odd_bit = cast(Callable[[float], bool], intrinsic(_lowest_bit))
"""Whether the last bit of the significand is set; only inside kernels."""

fma = cast(Callable[[float, float, float], float], intrinsic(_fused))
"""``a * b + c`` rounded once; only inside kernels."""
