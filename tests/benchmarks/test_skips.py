"""What plans leave out is left out: counters, not times."""

from __future__ import annotations

import pytest

from benchmarks.skips import Scene, counted, scenes

MODES, RESPONSES = "natural modes", "responses of modes"
WALKS, PLACES = "walks along a limit", "displacements"
FACTORS, FLOWS = "factorizations", "places of slow flows"

# With the plan's skips. 400 frequencies; the constraint of the chain of 13 masses hears 12 modes,
# the one in the middle 7; 33 times of one waveform.
PLANNED = (
    {MODES: 100, RESPONSES: 400 * 100},
    # One of M for the series above the spectrum, 118 of waves of displacements there.
    {MODES: 100, RESPONSES: 2 * 400 * 100, PLACES: 400 * 33, FACTORS: 119},
    {MODES: 13, RESPONSES: 400 * 7},
    # Members that are followed are solved once more, for the amplitudes of their modes.
    {MODES: 13, RESPONSES: (400 + 2 * 156) * 12, WALKS: 156},
    {MODES: 100, RESPONSES: 10 * 40 * 100},
    {MODES: 100, RESPONSES: 400 * 100},
    # M twice, to count modes and to solve, and the shifts of two cells.
    {FACTORS: 4},
    {FLOWS: 1000},
)
# Without them.
WITHOUT = (
    # All outputs: a shape, 33 times and no saving on degrees of freedom.
    {MODES: 100, RESPONSES: 2 * 400 * 100, WALKS: 161, PLACES: 400 * 100 * 34, FACTORS: 710},
    {MODES: 100, RESPONSES: 2 * 400 * 100, PLACES: 400 * 33 * 100, FACTORS: 119},
    {MODES: 13, RESPONSES: 400 * 13},
    {MODES: 13, RESPONSES: 2 * 400 * 12, WALKS: 400},
    {MODES: 1000, RESPONSES: 10 * 40 * 100},
    {MODES: 100, RESPONSES: 50 * 400 * 100},
    # Two harmonics at each of a hundred frequencies.
    {FACTORS: 201},
    # The exact motion at the same times, both at its 26 impacts.
    {FLOWS: 2026},
)
SCENES = scenes()


@pytest.mark.parametrize(
    ("scene", "planned", "without"),
    list(zip(SCENES, PLANNED, WITHOUT, strict=True)),
    ids=[scene.name for scene in SCENES],
)
def test_counters(scene: Scene, planned: dict[str, int], without: dict[str, int]) -> None:
    found, _ = counted(scene.planned)
    all_of_it, _ = counted(scene.without)
    assert dict(found) == planned
    assert dict(all_of_it) == without
    assert any(found[what] < all_of_it[what] for what in all_of_it)
