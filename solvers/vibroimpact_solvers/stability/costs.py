"""Which method finds the multipliers of impact modes, and what it costs."""

from __future__ import annotations

from enum import StrEnum


class Method(StrEnum):
    """Methods for the multipliers of impact modes."""

    SUM = "sum over the modes"
    MAP = "half-period map"


def choose(impacts: int) -> Method:
    """Return the method where so many impacts make up half a period, or a period not mirrored."""
    return Method.SUM if impacts == 1 else Method.MAP


def reason(method: Method) -> str:
    """Return how the method works."""
    if method is Method.MAP:
        return "multipliers of the map over half a period, from saltation matrices"
    return (
        "multipliers as zeros of a sum over the modes, which one impact joins; where a mode grows "
        "by itself or the sum tells little, by the map over half a period"
    )


def flops(n: int, method: Method) -> float:
    """Return the operations for one motion, which takes time however small it is."""
    if method is Method.SUM:
        return 5e4 + 40.0 * float(n) ** 2
    rows = 2.0 * n
    return 2e5 + 400.0 * rows**2 + 2.0 * rows**3
