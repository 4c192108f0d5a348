"""What plans leave out: counters with and without it, and the time saved.

To add a scene: append it to the ``scenes`` of the module of its kind. A skip that a plan can
state, and that no scene shows, fails a test.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from benchmarks.skips import (
    existence_bands,
    impact_modes,
    many,
    resonances,
    slow_flows,
    time_histories,
)
from benchmarks.skips.scene import Scene, counted, timed
from benchmarks.tables import Table

_KINDS: Final = (impact_modes, existence_bands, resonances, time_histories, slow_flows, many)


def scenes() -> Iterator[Scene]:
    """Yield the scenes whose counters are shown and tested."""
    for kind in _KINDS:
        yield from kind.scenes()


def counters() -> Table:
    """Count what is computed as planned, and for the same answer without the plan's skips.

    What is counted, `benchmarks.counters.counting` says.
    """
    rows: list[tuple[Any, ...]] = []
    for scene in scenes():
        planned, without = counted(scene.planned), counted(scene.without)
        quick, slow = timed(scene.planned), timed(scene.without)
        for what in sorted(without | planned):
            if planned[what] != without[what]:
                cells = (scene.name, what, planned[what], without[what], quick * 1e3, slow * 1e3)
                rows.append(cells)
    return Table(
        "What plans skip",
        ("scene", "counted", "planned", "without skips", "planned [ms]", "without [ms]"),
        rows,
        "Time of the processor, of planning and solving, least of three; natural modes forgotten "
        "before each. What is the same on both sides is not listed.",
    )
