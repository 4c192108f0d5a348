"""Plots of attractors: Poincaré sections, and bifurcation diagrams of their sweeps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vibroimpact.motion_plots import column_of
from vibroimpact.result_file import ResultFile
from vibroimpact.style import ADMISSIBLE, SERIES, frequencies, label, legend, new_axes, noted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from vibroimpact.tables import Array


@noted
def section(result: ResultFile, dof: int | None = None, ax: Axes | None = None) -> Axes:
    """Plot the points of the Poincaré sections of all attractors.

    Displacement and velocity of one degree of freedom at the drive's phase 0, or phase of the drive
    and velocity at impacts, as the result has them. Small points belong to attractors that are not
    periodic.

    Raises
    ------
    ValueError
        If sections were not computed.
    """
    ax = ax or new_axes()
    (across, x), (up, y) = _coordinates(result, dof)
    rows, named = result.attractor, set[str]()
    for attractor, nature in enumerate(rows.nature):
        mine = result.section.attractor == attractor
        color, periodic = SERIES[attractor % len(SERIES)][0], str(nature) == "periodic"
        name = f"{rows.fraction[attractor]:.0%} {nature}"
        if periodic:
            name += f" {rows.period[attractor]}"
        ax.plot(
            x[mine], y[mine], "o", color=color, markersize=5.0 if periodic else 1.2,
            label=None if name in named else name,
        )  # fmt: skip
        named.add(name)
    ax.set_xlabel(across)
    ax.set_ylabel(up)
    legend(ax, 3)
    return ax


@noted
def bifurcation(result: ResultFile, dof: int | None = None, ax: Axes | None = None) -> Axes:
    """Plot the points of the Poincaré sections of a sweep over its axis.

    Displacements of one degree of freedom at the drive's phase 0, or velocities before impacts.

    Raises
    ------
    ValueError
        If it is no sweep of attractors over one axis, or sections were not computed.
    """
    values, heights, across, text = section_over_axis(result, dof)
    ax = ax or new_axes()
    ax.plot(values, heights, ".", color=ADMISSIBLE, markersize=1.5, markeredgewidth=0.0)
    ax.set_xlabel(across)
    ax.set_ylabel(text)
    ax.margins(x=0.01)
    return ax


def section_over_axis(result: ResultFile, dof: int | None = None) -> tuple[Array, Array, str, str]:
    """Return the points of the sections of a sweep: its axis, their heights, and both labels.

    Raises
    ------
    ValueError
        If it is no sweep of attractors over one axis, or sections were not computed.
    """
    swept = "section_count" in result
    axes = list(result.to_xarray()["status"].dims) if swept else []
    if len(axes) != 1:
        raise ValueError("a bifurcation diagram needs a sweep of attractors over one axis")
    first, second = _coordinates(result, dof)
    text, heights = first if "x" in result.section else second
    values = np.repeat(getattr(result, str(axes[0])), result.section_count)
    path = str(result.request["axes"][0]["path"])
    if path.startswith("frequency."):
        path = frequencies(result, values, "frequency of the drive")[1]
    return values, heights, path, text


def _coordinates(
    result: ResultFile, dof: int | None
) -> tuple[tuple[str, Array], tuple[str, Array]]:
    """Return the names and values of both coordinates of the points."""
    if "section" not in result:
        raise ValueError("the sections were not computed: ask for the output section")
    points = result.section
    if "x" not in points:
        velocity = label("velocity before the impact", result, "section/velocity")
        return ("phase of the drive (rad)", points.phase), (velocity, points.velocity)
    shown, column = column_of(result, dof)
    return (
        (label(rf"$x_{{{shown}}}$ at phase 0", result, "section/x"), points.x[:, column]),
        (label(rf"$\dot x_{{{shown}}}$ at phase 0", result, "section/v"), points.v[:, column]),
    )
