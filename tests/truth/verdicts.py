"""What comparing a result with a reference gives: failures, and ratios of stated to true errors."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flint import arb

from vibroimpact_solvers.arrays import declared
from vibroimpact_solvers.plan import Plan

ROUNDING = 2.0**-52

COMPILED = 120.0  # seconds of the processor in which kernels are compiled, or read
OVERDUE = 10.0  # times the price of its plan: a computation that takes longer hangs


@dataclass(frozen=True)
class Case:
    """A random case: its kind in words, and the whole of its data, fit for JSON."""

    name: str
    document: dict[str, Any]


@dataclass
class Report:
    """What the cases of one set gave."""

    counts: Counter[str] = field(default_factory=Counter)
    failures: list[tuple[str, str]] = field(default_factory=list)
    ratios: dict[str, list[float]] = field(default_factory=dict)
    tell: Callable[..., None] | None = None

    def phase(self, name: str, limit: float | None = None) -> None:
        """Tell who is at work, the solver or the reference, and how many seconds it may take."""
        if self.tell is not None:
            self.tell(name, limit)

    def work(self, plan: Plan) -> None:
        """Tell that the solver follows a plan, which its price limits."""
        self.phase("solver", COMPILED + OVERDUE * plan.seconds)

    def plain(self, name: str) -> dict[str, Any]:
        """Return all of it, fit for JSON."""
        counts, ratios = dict(self.counts), self.ratios
        return {"name": name, "counts": counts, "failures": self.failures, "ratios": ratios}

    def count(self, what: str, times: int = 1) -> None:
        """Count something that is no failure."""
        self.counts[what] += times

    def fail(self, kind: str, message: str) -> None:
        """Note a failure."""
        self.failures.append((kind, message))

    def compare(self, what: str, stated: Iterable[Any], true: Sequence[Any], error: Any) -> None:
        """Compare numbers with their enclosures and stated absolute errors.

        The smallest ratio of stated to true error goes into the table of pessimism; below one it is
        a failure. Numbers that are exact, or nearly so, count in the table only where all are, as
        wrong by a quarter of a unit in the last place, the mean of rounding: nothing could be
        stated below that.
        """
        errors = np.broadcast_to(np.asarray(error, dtype=np.float64), (len(true),))
        worst, at_best, message = math.inf, math.inf, ""
        for k, (value, exact, bound) in enumerate(zip(stated, true, errors, strict=True)):
            if math.isnan(bound) or bound == math.inf:
                self.count(f"{what}: no error stated")
                continue
            if not math.isfinite(value):
                self.fail(what, f"{value!r}")
                return
            off = float((arb(float(value)) - exact).abs_lower())
            bound = float(bound)
            least = 0.25 * ROUNDING * abs(float(value))
            if off > max(bound, least) or (off >= least and off > 0.0):
                if bound / off < worst:
                    worst = bound / off
                    message = f"[{k}] {float(value)!r}, true {exact.str(20, radius=False)}, "
                    message += f"off by {off:.3g}, stated {bound:.3g}"
            elif least > 0.0:
                at_best = min(at_best, max(1.0, bound / least))
            elif bound == 0.0:
                at_best = 1.0  # zero, and stated to be exact
        self.ratios.setdefault(what, []).append(min(worst, 1e30) if worst < math.inf else at_best)
        if worst < 1.0:
            self.fail(what, message)


def stated_error(result: Any, name: str) -> Any:
    """Return the absolute error of an output, that its declaration names."""
    fields = declared(type(result))
    paths = {entry.path: field_name for field_name, entry in fields.items()}
    return getattr(result, paths[fields[name].quantity.error])
