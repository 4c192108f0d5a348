"""What a notebook draws of a result."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vibroimpact import notebook


def _modes(**fields: Any) -> Any:
    system = {"preset": "chain", "n": 5, "constraints": [{"dof": 3, "gap": 0.2}]}
    return SimpleNamespace(
        kind="impact-modes",
        request={"system": system},
        Omega=np.array([2.0, 2.5]),
        dof=np.array([1, 3]),
        tau=np.array([0.0, 1.0]),
        waveform=np.array([[[0.0, 0.0], [0.1, 0.2]], [[0.0, 0.0], [0.05, 0.2]]]),
        **fields,
    )


def test_modes_move_between_both_walls() -> None:
    scene = notebook.scene(_modes())
    assert scene["geometry"]["n"] == 2
    assert scene["geometry"]["fixed"] == [True, True]
    # The constrained coordinate is the second one of those that were computed.
    assert scene["stops"] == [{"dof": 1, "relativeTo": None, "lower": 0.2, "upper": 0.2}]
    rows = np.array(scene["motions"][0]["rows"])
    np.testing.assert_allclose(rows[0], [-0.1, -0.2], rtol=0, atol=1e-15)
    np.testing.assert_allclose(rows[-1], [0.1, 0.2], rtol=0, atol=1e-15)
    assert [motion["title"] for motion in scene["motions"]] == ["Ω = 2", "Ω = 2.5"]


def test_a_stop_at_a_coordinate_that_was_not_computed_is_left_out() -> None:
    result = _modes()
    result.dof = np.array([0, 1])
    assert notebook.scene(result)["stops"] == []


def test_relative_and_one_sided_stops() -> None:
    result = _modes()
    direction = {"dofs": [3, 1], "weights": [1, -1]}
    gap = {"lower": None, "upper": 0.1}
    result.request["system"]["constraints"] = [{"direction": direction, "gap": gap}]
    with pytest.raises(ValueError, match="tau from -1 to 1"):
        notebook.scene(result)
    result.tau = np.array([-1.0, 1.0])
    stop = {"dof": 1, "relativeTo": 0, "lower": None, "upper": 0.1}
    assert notebook.scene(result)["stops"] == [stop]


def test_a_result_without_displacements_says_what_to_ask_for() -> None:
    result = _modes()
    del result.waveform
    with pytest.raises(ValueError, match="waveform with tau"):
        notebook.scene(result)


def test_the_drawing_is_one_module() -> None:
    source = notebook.module()
    assert "export class Shape" in source
    assert "import {" not in source
    assert source.rstrip().endswith("export default { render };")


def test_without_the_extra_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "anywidget", None)
    with pytest.raises(ImportError, match=r"vibroimpact\[notebook\]"):
        notebook.show(_modes())
