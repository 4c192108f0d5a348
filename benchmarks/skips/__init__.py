"""What plans leave out: the time with and without it.

A skip that a plan can state, and that neither these scenes nor those of the tests show, fails a
test.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from benchmarks.skips import calibrations, impact_modes, motions, natural, sweeps
from benchmarks.skips.scene import Scene, timed
from benchmarks.tables import Table


def scenes() -> Iterator[Scene]:
    """Yield the scenes."""
    for kind in (impact_modes, motions, natural, sweeps, calibrations):
        yield from kind.scenes()


def saved() -> Table:
    """Time requests as planned, and for the same answer without the plan's skips."""
    rows: list[tuple[Any, ...]] = []
    for scene in scenes():
        quick, slow = timed(scene.planned), timed(scene.without)
        skipped = ", ".join(scene.states)
        rows.append((scene.name, skipped, quick * 1e3, slow * 1e3, slow / quick))
    return Table(
        "What plans skip",
        ("scene", "the plan skips", "planned [ms]", "without skips [ms]", "times faster"),
        rows,
        "Time of the processor, of planning and solving, least of three; natural modes forgotten "
        "before each.",
    )
