"""Plots of several sweeps over the same axis: up and down, as a test on a shaker goes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from vibroimpact import sweep_plots
from vibroimpact.attractor_plots import section_over_axis
from vibroimpact.result_file import ResultFile
from vibroimpact.style import ADMISSIBLE, OTHER, legend, new_axes, noted

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@noted
def hysteresis(
    up: ResultFile,
    down: ResultFile,
    output: str | None = None,
    at: Mapping[str, float] | None = None,
    dof: int | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Plot two sweeps over the same axis, one of which goes back.

    Parameters
    ----------
    up, down : ResultFile
        Results of sweeps, in any order; the values of their first axis say which way each goes.
    output : str, optional
        Name of an output; default: of attractors the points of their sections, else the first
        one computed.
    at : mapping, optional
        Dimension -> value at which it is held fixed, as for a plot of one sweep.
    dof : int, optional
        Degree of freedom of sections; default: the first.
    ax : Axes, optional
        Axes to draw in; default: those of a new figure.

    Raises
    ------
    ValueError
        If an output has other than one dimension left.
    """
    ax = ax or new_axes()
    styles = ((ADMISSIBLE, "o", 4.0), (OTHER, "x", 3.0))
    for result, (color, marker, size) in zip((up, down), styles, strict=True):
        if output is None and "section_count" in result:
            values, heights, across, text = section_over_axis(result, dof)
            line = "none"
        else:
            values, heights, across, text = sweep_plots.over_axis(result, output, at)
            line = "-"
        axis = np.asarray(getattr(result, str(result.to_xarray()["status"].dims[0])))
        name = "descending" if axis.size > 1 and axis[-1] < axis[0] else "ascending"
        ax.plot(
            values, heights, marker, linestyle=line, linewidth=0.8, color=color, markersize=size,
            fillstyle="none", markeredgewidth=0.8, label=name,
        )  # fmt: skip
        ax.set_xlabel(across)
        ax.set_ylabel(text)
    ax.margins(x=0.02)
    legend(ax)
    return ax
