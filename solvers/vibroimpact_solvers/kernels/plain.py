"""Kernels as plain Python, where ``NUMBA_DISABLE_JIT=1``: for debuggers and for tests of logic.

Nothing is compiled then. What compiled code has and Python has not is supplied here: the
intrinsics, records whose fields are attributes, and arithmetic that goes on after an overflow.
"""

from __future__ import annotations

import functools
import math
import operator
import os
import struct
import types
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, Final, TypeVar, cast

import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])

PLAIN: Final = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
"""Whether kernels run as plain Python in this process."""

_SPLIT: Final = 2.0**27 + 1.0
_LEAST: Final = 2.0**-900
_MOST: Final = 2.0**900
"""Magnitudes between which products of parts neither overflow nor lose bits."""


def record(fields: Sequence[tuple[Any, ...]]) -> np.dtype[np.void]:
    """Return the type of records, whose fields are attributes in kernels, compiled or not.

    Parameters
    ----------
    fields : sequence of tuple
        Name and type of each field.
    """
    if not PLAIN:
        return np.dtype(list(fields))
    # Fields of `numpy.recarray` do not hide what all scalars have, such as their size.
    kind = type("Record", (np.void,), {name: _attribute(name) for name, *_ in fields})
    return np.dtype((kind, list(fields)))


def _attribute(name: str) -> property:
    def change(row: np.void, value: float) -> None:
        row[name] = value

    return property(operator.itemgetter(name), change)


def never_inlined() -> None:
    """Do nothing: in Python, functions are apart from their callers."""


class _Functions:
    """The module `math` with results beyond the finite numbers in place of exceptions."""

    def __getattr__(self, name: str) -> Any:
        """Return a constant or a function of `math`; the functions return doubles of numpy."""
        there = getattr(math, name)
        if not callable(there) or not hasattr(np, name):
            return there
        beyond = getattr(np, name)

        def value(*given: float) -> Any:
            try:
                result = there(*given)
            except (ValueError, OverflowError):
                result = beyond(*given)
            return np.float64(result) if isinstance(result, float) else result

        setattr(self, name, value)
        return value


_FUNCTIONS: Final = _Functions()
_NAME: Final = "math_of_kernels"


def uncompiled(function: Function) -> Function:
    """Return a function that only kernels call, in the arithmetic of compiled code.

    Doubles of numpy are divided by zero and overflow as IEEE says, those of Python raise
    exceptions: what such a function calls `math` returns doubles of numpy. Other functions of its
    module have the usual one.
    """
    code, names = function.__code__, function.__globals__
    if names.get("math") is not math or "math" not in code.co_names:
        return function
    names[_NAME] = _FUNCTIONS
    called = tuple(_NAME if name == "math" else name for name in code.co_names)
    changed = types.FunctionType(
        code.replace(co_names=called), names, code.co_name, function.__defaults__
    )
    return cast(Function, functools.update_wrapper(changed, function))


def entered(function: Function) -> Function:
    """Return a kernel that Python calls, in the arithmetic of compiled code (`uncompiled`)."""
    inside = uncompiled(function)

    @functools.wraps(function)
    def kernel(*given: Any) -> Any:
        with np.errstate(all="ignore"):
            return inside(*(_in_doubles(each) for each in given))

    return cast(Function, kernel)


def _in_doubles(given: Any) -> Any:
    """Return an argument whose floats are doubles of numpy."""
    if isinstance(given, float):
        return np.float64(given)
    if isinstance(given, tuple):
        parts = [_in_doubles(part) for part in given]
        return type(given)(*parts) if hasattr(given, "_fields") else tuple(parts)
    return given


def fma(a: float, b: float, c: float) -> float:
    """Return ``a * b + c`` rounded once, as the instruction does: also beyond the finite numbers.

    The product is made exactly as the sum of two numbers (Dekker), and so are its sums with c
    (Knuth). What remains of them decides only where their rounded sum was a tie.
    """
    a, b, c = float(a), float(b), float(c)
    p = a * b
    if not (_LEAST < abs(p) < _MOST and abs(c) < _MOST and abs(a) < _MOST and abs(b) < _MOST):
        return np.float64(_far(a, b, c))
    high = _SPLIT * a
    a1 = high - (high - a)
    high = _SPLIT * b
    b1 = high - (high - b)
    a2, b2 = a - a1, b - b1
    p_rest = ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2
    low, low_rest = _two_sum(c, p_rest)
    total, rest = _two_sum(p, low)
    more, last = _two_sum(low_rest, rest)
    result, off = _two_sum(total, more)
    if (last > 0.0 and off > 0.0) or (last < 0.0 and off < 0.0):
        next_one = math.nextafter(result, math.copysign(math.inf, off))
        if next_one - result == 2.0 * off:  # a tie but for the last part, which is beyond it
            return np.float64(next_one)
    return np.float64(result)


def _far(a: float, b: float, c: float) -> float:
    """Return `fma` of numbers of any magnitude."""
    if not (math.isfinite(a) and math.isfinite(b)) or a == 0.0 or b == 0.0:
        return a * b + c
    if not math.isfinite(c):
        return c
    exact = Fraction(a) * Fraction(b) + Fraction(c)
    try:
        return float(exact)
    except OverflowError:
        return math.inf if exact > 0 else -math.inf


def _two_sum(a: float, b: float) -> tuple[float, float]:
    """Return the sum of two numbers and what rounding took from it."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def is_odd_bit(a: float) -> bool:
    """Return whether the last bit of the significand is set."""
    return bool(struct.pack("<d", a)[0] & 1)
