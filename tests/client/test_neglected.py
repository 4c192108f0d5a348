"""What of a structure has no effect on a result is said wherever the result is seen."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.colors import to_rgb

import vibroimpact as vi
from vibroimpact import plots, style, sweep_plots
from vibroimpact.kinds import KINDS, read
from vibroimpact_service import kinds as served

pytestmark = pytest.mark.needs("processes")

LOCAL = vi.Local()
ELASTIC = vi.system(np.eye(2), [[2.0, -1.0], [-1.0, 2.0]], [vi.constraint(0, 1.0)])
LOSSY = vi.system(
    np.eye(2),
    [[2.0, -1.0], [-1.0, 2.0]],
    [vi.constraint(0, 1.0, restitution=0.7)],
    C=0.1 * np.eye(2),
)
MODES = {"frequency": {"values": [1.2, 2.3]}}
START = {"x": [0.0, 0.0], "v": [2.0, 0.0]}
SOFT = {"law": "power", "exponent": 17, "stiffness": 1.0, "scale": 0.97}
DRIVEN = {
    "load": [{"dof": 0, "amplitude": 1.0}], "frequency": {"values": [1.2]},
    "sequence": [{"constraint": 0, "side": "upper"}],
}  # fmt: skip
DAMPING = "the damping C is neglected"
RESTITUTION = "the restitution of constraint 0 is taken as 1"


def _result(kind: str, system: Any, **request: Any) -> vi.Result:
    """Return a result without the warning, which a test of its own looks at."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vi.NeglectedWarning)
        return LOCAL.compute(kind, {"system": system, **request})  # type: ignore[call-overload, no-any-return]


def _sweep(system: Any, path: str, values: list[float]) -> vi.Result:
    base = {"system": system, **MODES}
    request = {"kind": "impact-modes", "base": base, "axes": [{"path": path, "values": values}]}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vi.NeglectedWarning)
        return LOCAL.compute("sweep", request)  # type: ignore[call-overload, no-any-return]


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    pyplot.close("all")


def _beginnings(result: vi.Result) -> list[str]:
    return [sentence.partition(":")[0] for sentence in result.neglected]


@pytest.mark.parametrize(
    ("kind", "request_", "said"),
    [
        ("impact-modes", MODES, [DAMPING, RESTITUTION]),
        ("existence-bands", {"frequency": {"start": 1.1, "stop": 2.5}}, [DAMPING, RESTITUTION]),
        ("resonances", {}, [DAMPING]),
        ("periodic-motions", DRIVEN, []),
        ("time-history", {"initial": START, "t_end": 3.0}, []),
        ("time-history", {"initial": START, "t_end": 3.0, "limiter": SOFT}, [RESTITUTION]),
        (
            "time-history",
            {"initial": START, "t_end": 3.0, "limiter": SOFT, "t": [0.0, 1.0], "outputs": ["x"]},
            [RESTITUTION],
        ),
        (
            "time-history",
            {"initial": START, "t_end": 3.0, "limiter": SOFT, "method": "RK45"},
            [RESTITUTION],
        ),
        (
            "ensemble",
            {"initial": {"x": [[0, 0]] * 2, "v": [[2, 0], [3, 0]]}, "t_end": 3.0, "limiter": SOFT},
            [RESTITUTION],
        ),
        ("ensemble", {"initial": {"x": [[0, 0]], "v": [[2, 0]]}, "t_end": 3.0}, []),
    ],
)  # fmt: skip
def test_a_result_names_what_it_neglects(kind: str, request_: Any, said: list[str]) -> None:
    result = _result(kind, LOSSY, **request_)
    assert _beginnings(result) == said
    assert result.to_dict().get("neglected", []) == list(result.neglected)
    assert _result(kind, ELASTIC, **request_).neglected == ()


def test_a_sweep_names_what_any_of_its_points_neglects() -> None:
    assert _beginnings(_sweep(LOSSY, "system.constraints.0.gap", [1.0, 2.0])) == [
        DAMPING,
        RESTITUTION,
    ]
    # Motions without loss do not depend on it, so that only the first point is computed.
    axis = ("system.constraints.0.restitution", [1.0, 0.7])
    assert _beginnings(_sweep(ELASTIC, *axis)) == [RESTITUTION]
    assert _sweep(ELASTIC, "system.constraints.0.gap", [1.0, 2.0]).neglected == ()


def test_the_documents_of_all_kinds_have_a_place_for_it() -> None:
    assert set(served.KINDS) == set(KINDS)
    for kind in served.KINDS.values():
        assert "neglected" in kind.result.model_fields, kind.name


def test_the_warning_is_at_the_line_that_asked() -> None:
    with pytest.warns(vi.NeglectedWarning, match=f"impact-modes: {DAMPING}") as caught:
        LOCAL.impact_modes(LOSSY, [1.2])
    assert [Path(each.filename) for each in caught] == [Path(__file__)]
    assert issubclass(vi.NeglectedWarning, UserWarning)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        LOCAL.impact_modes(ELASTIC, [1.2])
        LOCAL.time_history(LOSSY, ([0.0, 0.0], [2.0, 0.0]), 3.0)


def test_a_file_has_it_as_an_attribute(tmp_path: Path) -> None:
    result = _result("impact-modes", LOSSY, **MODES)
    path = result.to_hdf5(tmp_path / "result.h5")
    with h5py.File(path) as file:
        assert str(file.attrs["neglected"]).splitlines() == list(result.neglected)
    with pytest.warns(vi.NeglectedWarning):
        assert read(path).neglected == result.neglected
    with h5py.File(path, "r+") as file:  # results of 0.1.0 do not say it
        del file.attrs["neglected"]
    assert read(path).neglected == ()


def test_shells_and_notebooks_show_it() -> None:
    lossy, elastic = (_result("impact-modes", each, **MODES) for each in (LOSSY, ELASTIC))
    assert DAMPING in repr(lossy)
    assert RESTITUTION in repr(lossy)
    assert lossy._repr_html_().count("border-left: 4px solid #c77700") == 2
    assert RESTITUTION[1:] in lossy._repr_html_()
    assert "neglected" not in repr(elastic)
    assert "border-left" not in elastic._repr_html_()


def _noted(ax: Any) -> list[str]:
    texts = [text for text in ax.texts if text.get_gid() == "neglected"]
    assert all(to_rgb(text.get_color()) == to_rgb(style.AMBER) for text in texts)
    return [" ".join(text.get_text().split()) for text in texts]


TAU = np.linspace(-1.0, 1.0, 9).tolist()
ALL = {
    "frequency": {"start": 1.1, "stop": 2.5, "num": 12}, "tau": TAU,
    "outputs": ["impulse", "exists", "reason", "shape", "waveform", "energy", "stability",
                "harmonics"],
}  # fmt: skip


@pytest.mark.parametrize(
    "draw",
    [
        plots.momentum, plots.impulse, plots.frequency_energy, plots.stability, plots.existence,
        plots.shape, plots.waveform, plots.harmonics,
    ],
)  # fmt: skip
def test_every_plot_of_impact_modes_says_it(draw: Callable[..., Any]) -> None:
    (note,) = _noted(draw(_result("impact-modes", LOSSY, **ALL)))
    assert f"T{DAMPING[1:]}" in note
    assert f"T{RESTITUTION[1:]}" in note
    assert _noted(draw(_result("impact-modes", ELASTIC, **ALL))) == []


def test_plots_of_other_kinds_say_it() -> None:
    bands = _result("existence-bands", LOSSY, frequency={"start": 1.1, "stop": 2.5})
    assert len(_noted(bands.plot())) == 1
    assert len(_noted(_result("resonances", LOSSY).plot())) == 1
    swept = _sweep(LOSSY, "system.constraints.0.gap", [1.0, 2.0])
    assert len(_noted(sweep_plots.draw(swept, "impulse"))) == 1
    soft = {"initial": START, "t_end": 3.0, "limiter": SOFT, "t": {"num": 9}, "outputs": ["x"]}
    assert len(_noted(_result("time-history", LOSSY, **soft).plot())) == 1
    # Of several results in the same axes each sentence stands once.
    ax = bands.plot()
    (note,) = _noted(bands.plot(ax))
    assert note.count("damping") == 1


def test_the_note_is_inside_the_figure_and_below_the_axis() -> None:
    ax = _result("impact-modes", LOSSY, **ALL).plot()
    figure = ax.figure
    figure.canvas.draw()
    (note,) = [text for text in ax.texts if text.get_gid() == "neglected"]
    box = note.get_window_extent()
    assert box.y0 >= 0.0
    assert box.x1 <= figure.bbox.width
    assert box.y1 <= ax.xaxis.label.get_window_extent().y0
