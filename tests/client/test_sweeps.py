"""Requests for sweeps from numbers and arrays; pictures of what comes back."""

from __future__ import annotations

import io
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import xarray

import vibroimpact as vi
from vibroimpact import sweep_request
from vibroimpact.grids import axes
from vibroimpact.sweep_plots import draw
from vibroimpact_schema.sweeps import SweepRequest

mpl.use("Agg")

BASE = {
    "system": {"preset": "chain", "n": 3, "constraints": [{"dof": 0, "gap": 0.1}]},
    "frequency": {"values": [1.0]},
}


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (np.array([1.0, 2.0]), {"values": [1.0, 2.0]}),
        ([3], {"values": [3.0]}),
        (4.0, {"values": [4.0]}),
        ((1.0, 2, 3), {"start": 1.0, "stop": 2.0, "num": 3}),
        (
            {"start": 1, "stop": 2, "step": 0.5, "name": "k"},
            {"start": 1, "stop": 2, "step": 0.5, "name": "k"},
        ),
    ],
)
def test_axes_from_what_is_at_hand(given: Any, expected: dict[str, Any]) -> None:
    document = {"path": "system.stiffness"} | expected
    assert axes({"system.stiffness": given}) == [document]
    assert axes([document]) == [document]  # as over HTTP


def test_axes_without_paths_are_refused() -> None:
    for given in ([{"values": [1.0]}], [("system.stiffness", [1.0])]):
        with pytest.raises(TypeError, match="map paths to values, or be dictionaries with a path"):
            axes(given)  # type: ignore[arg-type]


def test_requests_fit_the_contract() -> None:
    given = {"system.constraints.0.gap": (0.1, 0.2, 3), "system.stiffness": [1.0, 2.0]}
    request = sweep_request("impact-modes", BASE, given, ["impulse"])
    checked = SweepRequest.model_validate(request)
    assert [a.path for a in checked.root.axes] == list(given)
    assert checked.points == 6
    assert "outputs" not in sweep_request("impact-modes", BASE, given)
    assert sweep_request("impact-modes", BASE, request["axes"], ["impulse"]) == request


class Played:
    """A result with given arrays."""

    neglected = ()

    def __init__(self, **arrays: Any) -> None:
        self.data = xarray.Dataset(
            arrays, coords={"gap": [0.3, 0.1, 0.2], "k": [1.0, 2.0], "Omega": [1.0, 1.5, 2.0, 2.5]}
        )
        self.data["gap"].attrs = {"units": "m", "long_name": "gap, system.constraints.0.gap"}

    def to_xarray(self) -> xarray.Dataset:
        return self.data


def played() -> Any:
    impulse = np.arange(24.0).reshape(3, 2, 4, 1)
    exists = (("gap", "k", "Omega"), (np.arange(24) % 2).astype(np.int8).reshape(3, 2, 4))
    flags = {"flag_meanings": "phantom admissible"}
    return Played(impulse=(("gap", "k", "Omega", "constraint"), impulse), exists=(*exists, flags))


@pytest.mark.needs("compiled kernels")
def test_a_map_over_two_axes_in_ascending_order() -> None:
    ax = draw(played(), at={"Omega": 1.4})
    (mesh,) = ax.collections
    values = mesh.get_array()
    # Omega = 1.5 is the nearest, column 1; rows gap 0.1, 0.2, 0.3.
    np.testing.assert_array_equal(values, [[9.0, 13.0], [17.0, 21.0], [1.0, 5.0]])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("k", "gap (m)")
    assert ax.get_title() == "Omega = 1.5"


def test_phantoms_are_left_out_of_maps() -> None:
    ax = draw(played(), at={"k": 1.0})
    values = ax.collections[0].get_array()
    assert values.mask[:, ::2].all()
    assert not values.mask[:, 1::2].any()


def test_lines_over_one_axis() -> None:
    ax = draw(played(), at={"Omega": 2.5, "k": 2.0})
    grey, colour = ax.lines
    np.testing.assert_array_equal(grey.get_xdata(), [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(colour.get_ydata(), [15.0, 23.0, 7.0])


@pytest.mark.needs("compiled kernels")
def test_counts_of_events_are_named_after_what_they_count() -> None:
    oscillator = vi.oscillator([vi.constraint(0, 1.0)])
    base = vi.time_history_request(oscillator, ([0.0], [2.0]), 5.0, outputs=["impacts"])
    axes = {"initial.v.0": [2.0, 3.0]}
    result = vi.Local().sweep("time-history", base, axes)
    # It moves as v sin t and is at the wall after arcsin 1/v, then after twice that each time.
    first = np.arcsin([1 / 2, 1 / 3])
    expected = 1 + (5.0 - first) // (2 * first)
    assert result.impact_count.tolist() == expected.tolist()
    assert result.plot(output="impact_count").get_ylabel() == "number of impacts at each point"


def test_codes_are_drawn_with_their_meanings() -> None:
    ax = draw(played(), "exists", {"k": 1.0})
    bar = ax.figure.axes[-1]
    assert [text.get_text() for text in bar.get_yticklabels()] == ["phantom", "admissible"]
    ax = draw(played(), "exists", {"k": 1.0, "gap": 0.2})
    assert [text.get_text() for text in ax.get_yticklabels()] == ["phantom", "admissible"]


def test_a_slice_is_chosen_where_too_many_dimensions_are_left() -> None:
    ax = draw(played())
    # The two longest axes are drawn; the third is held in its middle, as the title says.
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Omega", "gap (m)")
    assert ax.get_title() == "k = 2"
    given = draw(played(), at={"k": 2.0})
    np.testing.assert_array_equal(
        ax.collections[0].get_array().filled(-1), given.collections[0].get_array().filled(-1)
    )


def test_one_value_is_no_picture() -> None:
    with pytest.raises(ValueError, match=r"impulse has one value: \d"):
        draw(played(), at={"gap": 0.1, "k": 1.0, "Omega": 1.0})


def test_the_picture_can_be_written() -> None:
    file = io.BytesIO()
    draw(played(), at={"k": 1.0}).figure.savefig(file)
    assert file.getbuffer().nbytes > 1000
