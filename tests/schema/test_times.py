"""Grids of times."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from vibroimpact_schema import grids

GRID: TypeAdapter[grids.TimeValues | grids.TimePoints] = TypeAdapter(grids.TimeGrid)
TIMES: TypeAdapter[grids.TimeValues | grids.TimePoints] = TypeAdapter(grids.Times)


@pytest.mark.parametrize(
    ("document", "count"),
    [
        ({"values": [0, 2.5, 1]}, 3),
        ({"stop": 10, "num": 11}, 11),
        ({"start": 5, "stop": 10, "num": 2}, 2),
        ({"stop": 1, "step": 0.1}, 11),
        ({"start": 0.5, "stop": 1, "step": 0.2}, 3),
    ],
)
def test_all_forms_everywhere(document: Any, count: int) -> None:
    for of in (GRID, TIMES):
        grid = of.validate_python(document)
        assert grid.count == count
        assert of.validate_python(grid.model_dump()) == grid


def test_lists_and_numbers_of_times() -> None:
    assert GRID.validate_python([0, 1.5]) == TIMES.validate_python([0, 1.5]) == [0.0, 1.5]
    assert TIMES.validate_python({"num": 3}).count == 3


@pytest.mark.parametrize(
    ("document", "kind", "place"),
    [
        ({"values": []}, "too_short", ("values",)),
        ({"values": [1, -1]}, "greater_than_equal", ("values", 1)),
        ({"values": [float("nan")]}, "finite_number", ("values", 0)),
        ({"start": 2, "stop": 1, "num": 5}, "reversed_grid", ("stop",)),
        ({"start": 2, "stop": 2, "num": 5}, "reversed_grid", ("stop",)),
        ({"stop": 1, "num": 1}, "greater_than_equal", ("num",)),
        ({"num": 3}, "missing", ("stop",)),
        (3, "time_form", ()),
    ],
)
def test_faults_name_their_place(document: Any, kind: str, place: tuple[Any, ...]) -> None:
    with pytest.raises(ValidationError) as caught:
        GRID.validate_python(document)
    first = caught.value.errors()[0]
    found = tuple(part for part in first["loc"] if not str(part).startswith("@"))
    assert (first["type"], found) == (kind, place)
