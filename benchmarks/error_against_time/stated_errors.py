"""What the estimate of errors takes beside the motion that it is for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from benchmarks.harness import measure, ratio
from benchmarks.peers import cases, ours
from benchmarks.peers.cases import Case
from benchmarks.tables import Goal, Table
from vibroimpact_solvers.arrays import Floats

_NUMBERS: Final = (1, 100)
_MOST: Final = 1.3
_TWICE: Final = (
    "the motion is computed twice, the one that is the result 32 times as accurately as the "
    "tolerance asks, and their distance is stated"
)
_WHY: Final = (
    "five deviations are carried along beside the state, through every free motion and every "
    "impact; without them each motion takes a few evaluations until the next impact"
)


def stated_errors() -> Table:
    """Solve prepared time histories with and without the estimate of their errors."""
    _, ten_periods = cases.short_chains()
    rigid = ten_periods, cases.long_chain(100), cases.long_chain(1000), cases.two_limiters()
    soft = cases.soft()
    rows = [row for case in (*rigid, soft) for n in _NUMBERS for row in _rows(case, n)]
    return Table(
        "What stated errors cost",
        ("case", "output times", "without [ms]", "with [ms]", "with over without", "goal"),
        rows,
        "Time of the processor, in turns; ratios are medians over the rounds. All displacements "
        "and velocities at each time, and all impacts.",
        Goal("with over without", "goal"),
        reasons={"": _WHY} | {f"{soft.label}, output times {n}": _TWICE for n in _NUMBERS},
    )


def _rows(case: Case, number: int) -> Iterator[tuple[Any, ...]]:
    end = case.scene.t_end
    times: Floats = np.linspace(end / number, end, number)
    timings = measure(
        7,
        stated=ours.prepared(case.scene, estimate=True, times=times),
        bare=ours.prepared(case.scene, estimate=False, times=times),
    )
    stated, bare = timings["stated"], timings["bare"]
    spent = bare.processor * 1e3, stated.processor * 1e3
    yield case.label, number, *spent, ratio(stated, bare), _MOST
