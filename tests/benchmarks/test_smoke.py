"""Every table has its function, in a module that can be loaded."""

from __future__ import annotations

import pytest

from benchmarks import registry
from benchmarks.registry import Part

PARTS = [part for one in registry.BENCHMARKS for part in one.parts]


@pytest.mark.parametrize("part", PARTS, ids=[part.label for part in PARTS])
def test_every_table_can_be_loaded(part: Part) -> None:
    assert part.function().__doc__


def test_names_are_unlike() -> None:
    assert len({part.label for part in PARTS}) == len(PARTS)
