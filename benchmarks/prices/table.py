"""The table of ratios of estimates and measured times, by kind."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby

import numpy as np

from benchmarks.prices.measured import Measured


def ratio(row: Measured, longest: float) -> float | None:
    """Return the estimate over the time; None where both are more than was waited for."""
    if math.isfinite(row.measured):
        return row.estimate / row.measured
    return None if row.estimate > longest else row.estimate / longest


def text(rows: Sequence[Measured], longest: float) -> str:
    """Return the table in Markdown: how far estimates are off, whichever way, and both ways."""
    lines = [
        "| kind | requests | median | 95 % | most too high | most too low | plan, median |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, group in groupby(rows, lambda row: row.name):
        some = [(row, ratio(row, longest)) for row in group]
        ratios = np.array([value for _, value in some if value is not None])
        factors = np.exp(np.abs(np.log(ratios)))
        plans = float(np.median([row.planning for row, _ in some]))
        lines.append(
            f"| {name} | {ratios.size} | {np.median(factors):.3g} | "
            f"{np.percentile(factors, 95.0):.3g} | {max(ratios.max(), 1.0):.3g} | "
            f"{max(1.0 / ratios.min(), 1.0):.3g} | {1e3 * plans:.2g} ms |"
        )
    return "\n".join(lines)
