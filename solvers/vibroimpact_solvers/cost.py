"""What a plan costs on this machine: seconds from operations and memory written."""

from __future__ import annotations

from typing import Final

from vibroimpact_solvers.plan import Plan

FLOPS_PER_SECOND: Final = 1.0e9
"""Rate of the kernels on one core; conservative, so that estimates err to the long side."""
BYTES_PER_SECOND: Final = 5.0e8
OVERHEAD_SECONDS: Final = 1e-4


def seconds(plan: Plan) -> float:
    """Return the estimated time of a plan on one core."""
    return OVERHEAD_SECONDS + plan.flops / FLOPS_PER_SECOND + plan.bytes / BYTES_PER_SECOND
