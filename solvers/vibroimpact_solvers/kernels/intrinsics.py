"""What Python has no operator for: instructions, and words to LLVM; only in compiled kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from numba import types
from numba.extending import intrinsic


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


def _no_inlining(typing: Any) -> tuple[Any, Callable[..., Any]]:
    """Tell LLVM of the function that is being compiled, and emit nothing."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.none(), generate


never_inlined = cast(Callable[[], None], intrinsic(_no_inlining))
"""Keep the function that calls this apart from its callers."""

is_odd_bit = cast(Callable[[float], bool], intrinsic(_lowest_bit))
"""Whether the last bit of the significand is set."""

fma = cast(Callable[[float, float, float], float], intrinsic(_fused))
"""``a * b + c`` rounded once."""
