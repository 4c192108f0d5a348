"""Estimated time of a plan from its operations and the memory that it writes.

The rates are those of one core of a machine of 2024.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from vibroimpact_solvers.plan import Plan, Stage

FLOPS_PER_SECOND: Final = 1.0e9
"""Rate of the kernels; low, so that estimates are rather too long."""
RATES: Final[Mapping[Stage, float]] = {
    # LAPACK, with blocks or with a few vectors of a band.
    Stage.SPECTRUM: 3.0e9,
    # A path check ends where a limit is exceeded, mostly long before its bound.
    Stage.EXISTENCE: 8.0e9,
    # Products of matrices and formulas over whole arrays.
    Stage.HISTORY: 5.0e9,
    Stage.SLOW_FLOW: 1.0e10,
}
"""Operations per second of stages that have rates of their own."""
BYTES_PER_SECOND: Final = 5.0e8
OVERHEAD_SECONDS: Final = 4e-4
POINT_SECONDS: Final = 1e-3
"""For constructing the problem of one point of a sweep and collecting its result."""


def seconds(plan: Plan) -> float:
    """Return the estimated time of a plan on one core."""
    work = sum(step.flops / RATES.get(step.stage, FLOPS_PER_SECOND) for step in plan.steps)
    overhead = OVERHEAD_SECONDS + POINT_SECONDS * plan.points
    return overhead + work + plan.bytes / BYTES_PER_SECOND
