"""Colour scales of maps: zero is white if values of both signs occur, else an end of the scale."""

from __future__ import annotations

import numpy as np
import pytest

from vibroimpact.sweep_plots import _range


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([0.0, 1.0, 2.0], (0.0, 2.0, "viridis")),
        ([-2.0, -1.0], (-2.0, 0.0, "viridis")),
        ([-2.0, 1.0], (-2.0, 2.0, "RdBu_r")),
        ([np.nan, np.nan], (0.0, 2.0, "viridis")),
    ],
)
def test_scales_of_maps(values: list[float], expected: tuple[float, float, str]) -> None:
    assert _range(np.ma.masked_invalid(values), 2.0) == expected
