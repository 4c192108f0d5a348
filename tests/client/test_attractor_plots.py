"""Plots of attractors: what is drawn, and at which axes."""

from __future__ import annotations

import numpy as np
import pytest

import vibroimpact as vi

STOP = vi.constraint(dof=0, gap={"lower": None, "upper": 0.0}, restitution=0.8)
MASS = vi.oscillator([STOP], zeta=0.05)
LOAD = [vi.drive(dof=0, amplitude=1.0)]
X, V = [[-1.0], [-0.5], [-2.0]], [[0.0], [1.0], [0.5]]


pytestmark = pytest.mark.needs("processes")


@pytest.fixture(scope="module")
def local() -> vi.Local:
    return vi.Local()


@pytest.mark.needs("compiled kernels")
def test_sections_have_the_points_of_each_attractor(local: vi.Local) -> None:
    result = local.attractors(MASS, 2.8, LOAD, X, V, points=60)
    ax = result.plot()
    (drawn,) = ax.lines
    np.testing.assert_array_equal(drawn.get_xdata(), result.section.x[:, 0])
    np.testing.assert_array_equal(drawn.get_ydata(), result.section.v[:, 0])
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["100% chaotic"]


@pytest.mark.needs("compiled kernels")
def test_sections_at_impacts_have_phases_and_velocities(local: vi.Local) -> None:
    result = local.attractors(MASS, 2.0, LOAD, X, V, section="impacts", settle=50, observe=50)
    ax = vi.plots.section(result)
    assert ax.get_xlabel() == "phase of the drive (rad)"
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), result.section.velocity)
    plain = local.attractors(MASS, 2.0, LOAD, X, V, outputs=["stability"], settle=50, observe=50)
    with pytest.raises(ValueError, match="ask for the output section"):
        plain.plot()


def test_a_sweep_is_drawn_as_a_bifurcation_diagram(local: vi.Local) -> None:
    request = vi.attractors_request(MASS, 2.0, LOAD, X, V, settle=150, observe=50)
    over = {"frequency.values.0": {"values": [2.0, 4.0]}}
    result = local.sweep("attractors", request, over)
    ax = result.plot()
    assert ax.get_xlabel().startswith("frequency of the drive")
    np.testing.assert_array_equal(ax.lines[0].get_xdata(), [2.0, 4.0, 4.0])
    with pytest.raises(ValueError, match="sweep of attractors over one axis"):
        vi.plots.bifurcation(local.attractors(MASS, 2.0, LOAD, X, V, settle=50, observe=50))


@pytest.mark.needs("compiled kernels")
def test_sweeps_up_and_down_are_drawn_over_each_other(local: vi.Local) -> None:
    wall = vi.constraint(0, {"lower": None, "upper": 0.5}, 0.8)
    base = vi.attractors_request(
        vi.oscillator([wall], zeta=0.05), 1.0, [vi.drive(0, 0.25)], initial=([0.0], [0.0]),
        settle=40, observe=32, outputs=["section"],
    )  # fmt: skip
    up, down = (
        local.sweep("attractors", base, {"frequency.values.0": values}, continued=True)
        for values in ((1.1, 1.4, 11), (1.4, 1.1, 11))
    )
    ax = vi.plots.hysteresis(up, down)
    labels = [line.get_label() for line in ax.lines]
    assert labels == ["ascending", "descending"]
    for line, result in zip(ax.lines, (up, down), strict=True):
        np.testing.assert_array_equal(line.get_ydata(), result.section.x[:, 0])
    assert not np.array_equal(up.section.x, down.section.x[::-1])
    history = vi.time_history_request(
        vi.oscillator([wall], zeta=0.05), ([0.0], [0.0]), 20.0, load=[vi.harmonic(0, 0.25, 1.2)]
    )
    back = {"load.0.amplitude": [0.5, 0.3, 0.1]}
    swept = [
        local.sweep("time-history", history, axes, outputs=["impacts"], continued=True)
        for axes in (back, {"load.0.amplitude": [0.1, 0.3, 0.5]})
    ]
    ax = vi.plots.hysteresis(swept[1], swept[0], "impact_count")
    np.testing.assert_array_equal(ax.lines[1].get_xdata(), [0.5, 0.3, 0.1])
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), swept[1].impact_count)
    with pytest.raises(ValueError, match=r"status over one axis: .* left are none"):
        vi.plots.hysteresis(*swept, "status", at={"amplitude": 0.3})
