"""Plots of calibrations: residuals of the measurements, and intervals of the unknowns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from vibroimpact.result_file import ResultFile
from vibroimpact.style import ADMISSIBLE, OTHER, PHANTOM, SERIES, legend, new_axes, noted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDE: Final = 1.96
"""Standard deviations within which 95 of 100 residuals of a right model lie."""


def plot_of(output: str | None, result: ResultFile, ax: Axes | None) -> Axes:
    """Plot residuals, or intervals where they are asked for.

    Raises
    ------
    ValueError
        If there is no plot of that output.
    """
    if output in {None, "residual"}:
        return residuals(result, ax)
    if output == "interval":
        return intervals(result, ax)
    raise ValueError(f"a calibration has plots of residual and interval, not of {output!r}")


@noted
def residuals(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the residuals of all measurements in their order, by their standard deviations.

    Parameters
    ----------
    result : ResultFile
        Of a calibration, with its residuals.
    ax : Axes, optional
        Axes to draw in; default: those of a new figure.
    """
    ax = ax or new_axes()
    which = np.asarray(result.measurements.data)
    places = np.arange(which.size)
    outputs = [each["output"] for each in result.request["data"]]
    for data, output in enumerate(outputs):
        color = SERIES[data % len(SERIES)][0]
        chosen = which == data
        ax.plot(places[chosen], result.residual[chosen], ".", color=color, label=output)
    for side in (-_WIDE, _WIDE):
        ax.axhline(side, color=PHANTOM, linewidth=0.6, linestyle="--")
    ax.set_xlabel("measurement")
    ax.set_ylabel("(measured - computed) / sigma")
    if "p" in result:
        verdict = "not rejected" if result.p >= 0.05 else "rejected"
        ax.set_title(f"the model is {verdict}: p = {result.p:.3g}")
    legend(ax)
    return ax


@noted
def intervals(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the 95 % interval of each unknown, relative to its value.

    Parameters
    ----------
    result : ResultFile
        Of a calibration, with its intervals.
    ax : Axes, optional
        Axes to draw in; default: those of a new figure.
    """
    ax = ax or new_axes()
    sizes = np.where(result.value == 0.0, 1.0, np.abs(result.value))
    for place, name in enumerate(result.unknown):
        ends = (np.asarray(result.interval[place]) - result.value[place]) / sizes[place]
        if np.isfinite(ends).all():
            ax.plot(100.0 * ends, [place, place], "-", color=ADMISSIBLE, linewidth=2.0)
        else:
            ax.annotate(" not bounded", (0.0, place), color=OTHER, va="center")
        ax.plot([0.0], [place], "o", color=ADMISSIBLE)
        ax.annotate(str(name), (0.0, place), (0.0, 4.0), textcoords="offset points", ha="center")
    ax.set_yticks([])
    ax.set_ylim(-0.5, len(result.unknown) - 0.4)
    ax.set_xlabel("95 % interval about the value, %")
    return ax
