"""Documents of grids: how many points they claim, and which they refuse."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from vibroimpact_schema import grids

GRID: TypeAdapter[Any] = TypeAdapter(grids.FrequencyGrid)


@pytest.mark.parametrize(
    ("document", "count"),
    [
        ({"values": [3, 1, 2]}, 3),
        ({"start": 0.6, "stop": 2.4, "num": 7}, 7),
        ({"start": 1, "stop": 1, "num": 1}, 1),
        ({"start": 1, "stop": 2, "step": 0.1}, 11),
        ({"start": 1, "stop": 1.99, "step": 0.1}, 10),
        ({"start": 1, "stop": 1, "step": 0.1}, 1),
        ({"start": 1e6, "stop": 1e6 + 1, "step": 0.1}, 11),
        ({"start": 1, "stop": 2, "step": 5e-324}, 2**53 - 1),
    ],
)
def test_points_are_counted_without_making_them(document: Any, count: int) -> None:
    assert GRID.validate_python(document).count == count


@given(st.integers(1, 3000), st.integers(1, 10**6), st.integers(1, 10**4))
@settings(deadline=None, max_examples=200)
def test_a_step_that_divides_the_range_meets_its_end(steps: int, start: int, parts: int) -> None:
    step = 1 / parts
    grid = GRID.validate_python({"start": start, "stop": start + steps / parts, "step": step})
    assert grid.count == steps + 1


@pytest.mark.parametrize(
    ("document", "kind", "place"),
    [
        ({"values": []}, "too_short", ("values",)),
        ({"values": [1, 0]}, "greater_than", ("values", 1)),
        ({"values": [1, float("nan")]}, "finite_number", ("values", 1)),
        ({"values": ["1"]}, "float_type", ("values", 0)),
        ({"start": 2, "stop": 1, "num": 5}, "reversed_grid", ("stop",)),
        ({"start": 2, "stop": 1, "step": 0.1}, "reversed_grid", ("stop",)),
        ({"start": 1, "stop": 1, "num": 5}, "empty_grid", ("num",)),
        ({"start": 1, "stop": 2, "num": 0}, "greater_than_equal", ("num",)),
        ({"start": 1, "stop": 2, "step": 0}, "greater_than", ("step",)),
        ({"start": 1, "stop": 2, "step": -0.1}, "greater_than", ("step",)),
        ({"start": 1, "stop": 2}, "missing", ("num",)),
        ({"stop": 2, "num": 5}, "missing", ("start",)),
        ({"start": 2, "num": 5}, "missing", ("stop",)),
        ({"stop": 2, "step": 0.1}, "missing", ("start",)),
        ({"start": 1, "stop": 2, "num": 3, "step": 1}, "extra_forbidden", ("num",)),
        ({"start": 1, "stop": 2, "num": 3, "unit": "Bq"}, "literal_error", ("unit",)),
        ([1, 0], "greater_than", (1,)),
        ([], "too_short", ()),
        (1.5, "frequency_form", ()),
    ],
)
def test_faults_name_their_place(document: Any, kind: str, place: tuple[Any, ...]) -> None:
    with pytest.raises(ValidationError) as caught:
        GRID.validate_python(document)
    first = caught.value.errors()[0]
    found = tuple(part for part in first["loc"] if not str(part).startswith("@"))
    assert (first["type"], found) == (kind, place)


def test_a_list_stands_for_the_object_with_these_values() -> None:
    listed, written = (GRID.validate_python(each) for each in ([2, 1.5], {"values": [2, 1.5]}))
    assert listed == written
    assert GRID.dump_json(listed) == GRID.dump_json(written)
    assert GRID.dump_python(listed) == {"unit": "Omega", "values": [2.0, 1.5]}


def test_a_pair_stands_for_a_range() -> None:
    band: TypeAdapter[Any] = TypeAdapter(grids.FrequencyBand)
    assert band.validate_python([1, 2]) == band.validate_python({"start": 1, "stop": 2})
    for wrong, kind in (([2, 1], "reversed_grid"), ([1], "too_short"), ([1, 2, 3], "too_long")):
        with pytest.raises(ValidationError) as caught:
            band.validate_python(wrong)
        assert caught.value.errors()[0]["type"] == kind
