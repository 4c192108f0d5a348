"""How many output times cost: beside heyoka, whose dense output gives them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.harness import measure, ratio
from benchmarks.peers import cases, ours
from benchmarks.peers.cases import Case
from benchmarks.peers.integrators import heyoka_events
from benchmarks.peers.scene import Outcome
from benchmarks.tables import Goal, Table
from vibroimpact_solvers.arrays import Floats

_TOLERANCE: Final = 2.0**-52
_NUMBERS: Final = (1, 10, 100, 1000)
_PREPARED, _WHOLE, _NEW = "prepared", "whole call", "new structure"
_GOALS: Final = {
    (13, _PREPARED): 5.0,
    (13, _WHOLE): 3.0,
    (100, _PREPARED): 4.0,
    (1000, _PREPARED): 2.5,
    (12, _PREPARED): 3.0,
}
"""Times faster than heyoka at ten output times, by the number of masses and the way."""
_WHY: Final = (
    "a whole call makes and checks problem, plan and result, objects of Python, in 0.1 ms, and "
    "estimates errors; prepared motions of few masses take most of their time from one impact to "
    "the next, those of many for products with the matrix of modes"
)


def outputs() -> Table:
    """Ask for the whole state at more and more times, of the same motions.

    heyoka is prepared, and at its tightest tolerance, where its error is ours. A whole call is
    problem, plan and solution with estimates of errors; for a new structure natural modes and all
    else are computed in the call.
    """
    _, ten_periods = cases.short_chains()
    longer = cases.long_chain(100), cases.long_chain(1000), cases.two_limiters()
    return Table(
        "Against heyoka at many output times",
        ("case", "output times", "way", "heyoka [ms]", "Vibroimpact [ms]", "times faster", "goal"),
        [row for case in (ten_periods, *longer) for n in _NUMBERS for row in _rows(case, n)],
        "Time of the processor, in turns; ratios are medians over the rounds. All displacements "
        "and velocities at each time, and all impacts.",
        Goal("times faster", "goal", at_least=True),
        reasons={"": _WHY},
    )


def _rows(case: Case, number: int) -> Iterator[tuple[Any, ...]]:
    scene = case.scene
    times: Floats = np.linspace(scene.t_end / number, scene.t_end, number)
    solve = heyoka_events(scene, times)

    def new() -> Outcome:
        return ours.whole(replace(scene, system=replace(scene.system)), times=times)

    ways: dict[str, Any] = {
        _PREPARED: ours.prepared(scene, times=times),
        _WHOLE: partial(ours.whole, scene, times=times),
        _NEW: new,
    }
    timings = measure(5, **ways, heyoka=lambda: solve(scene, _TOLERANCE))
    peer = timings["heyoka"]
    for way in ways:
        goal = _GOALS.get((scene.n, way)) if number == 10 else None
        spent = peer.processor * 1e3, timings[way].processor * 1e3
        yield (case.label, number, way, *spent, ratio(peer, timings[way]), goal)
