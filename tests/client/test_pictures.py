"""Plots: every output has one, nothing is hidden, and colour scales show all values."""

from __future__ import annotations

import io
import types
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.collections import PathCollection, QuadMesh

import vibroimpact as vi
from vibroimpact import plots
from vibroimpact.sweep_plots import _scale

mpl.use("Agg")


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([0.0, 1.0, 2.0], (0.0, 2.0, "viridis")),
        ([-2.0, -1.0], (-2.0, 0.0, "viridis")),
        ([-2.0, 1.0], (-2.0, 2.0, "RdBu_r")),
        ([np.nan, np.nan], (0.0, 1.0, "viridis")),
    ],
)
def test_scales_of_maps(values: list[float], expected: tuple[float, float, str]) -> None:
    scale, colours = _scale(np.ma.masked_invalid(values))
    assert (scale.vmin, scale.vmax, colours) == expected


def test_no_value_is_beyond_the_scale() -> None:
    """Beside a pole the scale turns logarithmic instead of giving its neighbours one colour."""
    values = np.ma.masked_invalid([0.1, 0.2, 0.3, *[0.25] * 40, 900.0])
    scale, _ = _scale(values)
    assert (scale.vmin, scale.vmax) == (0.0, 900.0)
    places = np.asarray(scale(values[:3]))
    assert np.diff(places).min() > 0.05


class Modes:
    """Impact modes of two limiters that are struck alike, with given outputs."""

    kind = "impact-modes"
    neglected = ()

    def __init__(self, **request: Any) -> None:
        Omega = np.array([1.0, 2.0, 3.0, 4.0])
        self.request = {"system": {"constraints": [{"dof": 0, "gap": 1.0}]}, **request}
        self.Omega, self.omega = Omega, 2.0 / np.pi * Omega
        self.constraint, self.dof = np.array([0, 1]), np.array([0, 1, 2])
        self.impulse = np.ones((4, 2)) * Omega[:, np.newaxis]
        self.exists = np.array([True, True, False, True])
        self.reason = np.array(["ok", "ok", "penetration", "ok"])
        self.tau, self.harmonic = np.linspace(-1.0, 1.0, 5), np.array([1, 3, 5])
        self.waveform = np.ones((4, 5, 3))
        self.harmonics = np.ones((4, 3, 3))
        self.shape, self.stability = np.ones((4, 3)), np.ones(4)

    def unit(self, name: str) -> str:
        return {"momentum": "kg m/s", "Omega": "rad/s"}.get(name, "1")

    def in_unit(self, Omega: Any, unit: str) -> Any:
        assert unit == "Hz"
        return Omega / (2.0 * np.pi)


def modes(**request: Any) -> Any:
    return Modes(**request)


def test_the_momentum_is_shown_with_its_unit() -> None:
    ax = plots.momentum(modes())
    assert ax.get_ylabel() == "momentum per impact (kg m/s)"
    # p = Omega, hence 2 p/omega = pi at every frequency.
    np.testing.assert_allclose(ax.lines[2].get_ydata()[:2], np.pi)


def test_equal_curves_show_each_other() -> None:
    """The later one is narrower and dashed, in another colour."""
    first, second = (line for line in plots.momentum(modes()).lines if line.get_zorder() == 3)
    assert second.get_linewidth() < first.get_linewidth()
    assert second.get_color() != first.get_color()
    assert second.is_dashed()
    assert not first.is_dashed()


def test_frequencies_are_shown_as_they_were_asked_for() -> None:
    ax = plots.momentum(modes(frequency={"unit": "Hz"}))
    assert ax.get_xlabel() == "fundamental frequency (Hz)"
    np.testing.assert_allclose(ax.lines[1].get_xdata(), np.arange(1, 5) / (2.0 * np.pi))


@pytest.mark.parametrize("output", ["waveform", "harmonics", "stability", "exists", "reason"])
def test_every_output_of_impact_modes_has_a_plot(output: str) -> None:
    ax = plots.mode_plot(output)(modes())
    assert ax.get_xlabel()
    assert ax.lines
    file = io.BytesIO()
    ax.figure.savefig(file)
    assert file.getbuffer().nbytes > 1000


def test_legends_hide_no_curve() -> None:
    ax = plots.momentum(modes())
    ax.figure.draw_without_rendering()
    assert ax.get_legend().get_window_extent().y0 >= ax.get_window_extent().y1 - 1.0


def test_an_ensemble_on_a_grid_has_no_stripes() -> None:
    """States on a grid become cells that touch; others stay single marks."""
    x, v = (grid.ravel()[:, np.newaxis] for grid in np.meshgrid([0.0, 0.1, 0.4], [1.0, 2.0]))
    result = types.SimpleNamespace(
        request={"initial": {"x": x.tolist(), "v": v.tolist()}},
        status=np.array(["ok"] * 6),
        neglected=(),
        count=types.SimpleNamespace(impacts=np.arange(6)),
    )
    (cells,) = plots.basins(result).collections  # type: ignore[arg-type]
    assert isinstance(cells, QuadMesh)
    np.testing.assert_array_equal(cells.get_array(), [[0, 1, 2], [3, 4, 5]])
    result.request["initial"]["x"][0][0] = 0.05
    (marks,) = plots.basins(result).collections  # type: ignore[arg-type]
    assert isinstance(marks, PathCollection)


@pytest.mark.parametrize(("index", "name"), [(1, "impact mode"), (2, "phantom")])
def test_a_phantom_is_not_called_an_impact_mode(index: int, name: str) -> None:
    assert plots.shape(modes(), index).get_title().startswith(f"{name} at ")


def branches(path: str, **frequency: Any) -> Any:
    """Return one branch of motions without impacts."""
    Omega, none = np.array([1.0, 2.0]), np.zeros(0)
    solution = {"branch": np.zeros(2), "parameter": Omega, "Omega": Omega}
    solution |= {"impacts": np.zeros(2, dtype=int), "x_max": np.ones((2, 1))}
    rows, points = Rows(**solution, x_min=-np.ones((2, 1))), dict.fromkeys(
        ("branch", "parameter", "type", "exists"), none
    )  # fmt: skip
    request = {"path": path, "base": {"frequency": frequency, "system": {"constraints": []}}}
    return types.SimpleNamespace(
        request=request, solution=rows, points=Rows(**points), dof=np.array([0]), neglected=(),
        unit=lambda _: "1", in_unit=lambda Omega, _: Omega / (2.0 * np.pi),
    )  # fmt: skip


class Rows(types.SimpleNamespace):
    """A table, in which names of columns are."""

    def __contains__(self, name: str) -> bool:
        return hasattr(self, name)


def test_the_axis_of_branches_says_what_varies() -> None:
    over = plots.branches(branches("frequency.values.0"))
    assert over.get_xlabel() == r"frequency of the drive $\Omega$"
    over = plots.branches(branches("frequency.values.0", unit="Hz"))
    assert over.get_xlabel() == "frequency of the drive (Hz)"
    gap = "system.constraints.0.gap"
    assert plots.branches(branches(gap)).get_xlabel() == gap


POUNDING = {
    "constraints": [
        {
            "direction": {"dofs": [2, 0], "weights": [1.0, -0.5]},
            "gap": {"lower": None, "upper": 0.75},
        }
    ]
}


def history(**outputs: Any) -> Any:
    """Return a history of a structure with a gap between two coordinates, which close it once."""
    t = np.linspace(0.0, 1.0, 5)
    x = np.stack([-t, np.zeros(5), t], axis=1)
    return types.SimpleNamespace(
        request={"system": POUNDING}, t=t, x=x, v=x, dof=np.array([0, 1, 2]), neglected=(),
        error=types.SimpleNamespace(predictable_until=np.inf), unit=lambda _: "1", **outputs,
    )  # fmt: skip


def test_a_history_shows_the_gap_that_closes() -> None:
    """By default the coordinate of the first constraint, also where it lies between two others."""
    struck = types.SimpleNamespace(
        time=np.array([0.5]), constraint=np.array([0]), side=np.array([1])
    )
    ax = plots.history(history(impacts=struck))
    curve, wall, mark = ax.lines
    np.testing.assert_array_equal(curve.get_ydata(), 1.5 * np.linspace(0.0, 1.0, 5))
    assert wall.get_ydata() == [0.75, 0.75]
    assert (mark.get_xdata().tolist(), mark.get_ydata().tolist()) == ([0.5], [0.75])
    assert ax.get_ylabel() == "displacement $x_{2}-0.5x_{0}$"
    alone = plots.history(history(impacts=struck), dof=1)
    assert len(alone.lines) == 1
    assert alone.get_ylabel() == "displacement $x_{1}$"


def test_the_force_of_a_stop_is_drawn_beside_its_gap() -> None:
    ax = plots.history(history(force=1e7 * np.arange(5.0)[:, np.newaxis]))
    ax.figure.draw_without_rendering()
    (_, right) = ax.figure.axes
    assert right.get_ylabel() == "force of the stop"
    assert right.yaxis.get_offset_text().get_size() == ax.yaxis.get_ticklabels()[0].get_size()


def test_a_phase_plane_shows_the_gap_that_closes() -> None:
    ax = plots.phase_plane(history())
    assert ax.get_ylabel() == "velocity $v_{2}-0.5v_{0}$"
    assert [line.get_xdata()[0] for line in ax.lines] == [0.0, 0.75]


def test_legends_stand_above_the_power_of_ten() -> None:
    large = modes()
    large.impulse = 1e9 * large.impulse
    ax = plots.momentum(large)
    ax.figure.draw_without_rendering()
    power = ax.yaxis.get_offset_text()
    assert power.get_text()
    assert ax.get_legend().get_window_extent().y0 >= power.get_window_extent().y0 + 5.0


@pytest.mark.needs("compiled kernels")
def test_an_ensemble_of_single_states_is_drawn_over_them() -> None:
    mass = vi.oscillator([vi.constraint(0, 1.0)])
    states = [{"x": [0.0], "v": [v]} for v in (0.5, 2.0, 3.0)]
    result = vi.Local().ensemble(mass, initial=states, t_end=5.0)
    (drawn,) = result.plot().lines
    np.testing.assert_array_equal(drawn.get_xdata(), [0.5, 2.0, 3.0])
    np.testing.assert_array_equal(drawn.get_ydata(), result.count.impacts)
    on_mode = vi.Local().ensemble(mass, initial=1.5, t_end=5.0)
    with pytest.raises(ValueError, match="start on impact modes"):
        on_mode.plot()
