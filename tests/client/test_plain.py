"""Requests may hold numpy arrays and numbers wherever they hold lists and numbers."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import vibroimpact as vi
from vibroimpact.plain import plain


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"x": np.arange(3)}, {"x": [0, 1, 2]}),
        ({"a": {"b": [np.float64(0.5), np.ones(2)]}}, {"a": {"b": [0.5, [1.0, 1.0]]}}),
        ([{"values": np.eye(2)}], [{"values": [[1.0, 0.0], [0.0, 1.0]]}]),
        ({"dofs": [0, np.int64(3)]}, {"dofs": [0, 3]}),
        ({"gap": [None, 0.1, np.float32(0.5)]}, {"gap": [None, 0.1, 0.5]}),
        ({"values": [1.0, np.array(2.0)]}, {"values": [1.0, 2.0]}),
        ({"M": ((1, 2), (2, 1))}, {"M": [(1, 2), (2, 1)]}),
        ({"text": "x", "none": None, "empty": []}, {"text": "x", "none": None, "empty": []}),
    ],
)
def test_arrays_become_lists(given: Any, expected: Any) -> None:
    assert plain(given) == expected
    json.dumps(plain(given))


@pytest.mark.needs("compiled kernels")
def test_documents_with_arrays_are_computed() -> None:
    """Here in the process of the program; over HTTP they are JSON of the same document."""
    structure = vi.chain(3, [vi.constraint(dof=1, gap=0.2)])
    start = {"x": np.zeros(3), "v": np.array([0.0, 1.0, 0.0])}
    local = vi.Local()
    arrays = local.time_history(structure, start, 5.0)
    lists = local.time_history(structure, (start["x"], start["v"]), 5.0)
    assert arrays.impacts["time"].tolist() == lists.impacts["time"].tolist()
    assert arrays.impacts["time"].size > 1
    request = {
        "system": {
            "M": np.eye(2),
            "K": np.diag([1.0, 2.0]),
            "constraints": [{"dof": np.int64(1), "gap": np.float64(0.1)}],
        },
        "frequency": {"values": np.linspace(1.5, 2.5, 5)},
    }
    assert local.compute("impact-modes", request).impulse.shape == (5, 1)
