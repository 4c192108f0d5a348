"""Containers give back what was packed, and notice when they were damaged."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from vibroimpact_service.results.container import DamagedContainerError, pack, unpack


@settings(deadline=None)
@given(
    array=arrays.arrays(
        st.sampled_from([np.float64, np.int64, np.int8, np.bool_]),
        arrays.array_shapes(min_dims=0, max_dims=3, min_side=0),
    )
)
def test_arrays_come_back_to_the_bit(array: np.ndarray) -> None:
    found, meta = unpack(pack({"a": array, "b/c": array}, {"kind": "x", "n": 1.5}))
    assert meta == {"kind": "x", "n": 1.5}
    for name in ("a", "b/c"):
        assert found[name].dtype == array.dtype
        assert found[name].shape == array.shape
        assert found[name].tobytes() == array.tobytes()


@pytest.mark.parametrize("place", [0, 10, 40, 60, -1])
def test_a_flipped_bit_is_noticed(place: int) -> None:
    data = bytearray(pack({"a": np.arange(10.0)}, {}))
    data[place] ^= 1
    with pytest.raises(DamagedContainerError):
        unpack(bytes(data))


def test_a_truncated_container_is_noticed() -> None:
    data = pack({"a": np.arange(10.0)}, {})
    for length in (0, 3, 40, len(data) - 1):
        with pytest.raises(DamagedContainerError):
            unpack(data[:length])
