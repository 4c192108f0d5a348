"""Plots of periodic motions over the frequency of their drive, and of their branches."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from vibroimpact.branch_lines import (
    branch_lines,
    counted,
    special_points,
    stability_of,
    struck,
)
from vibroimpact.motion_plots import column_of
from vibroimpact.result_file import ResultFile
from vibroimpact.style import (
    PHANTOM,
    SERIES,
    frequencies,
    label,
    legend,
    new_axes,
    noted,
)
from vibroimpact.tables import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_OPEN_MARKS = 80  # side by side in a plot of journal width


@noted
def response(result: ResultFile, dof: int | None = None, ax: Axes | None = None) -> Axes:
    """Plot the amplitude of periodic motions, half of peak to peak, over the drive's frequency.

    Filled marks are stable, half filled ones neutral, open ones unstable motions, and small grey
    ones phantoms; motions without impacts, with one impact per period and so on have colours and
    marks of their own. Of many frequencies some are left out for unstable motions, whose marks
    would hide one another. Where extremes were not computed, plot the momentum of the first impact.
    """
    ax = ax or new_axes()
    rows = result.solution
    exists = rows.exists if "exists" in rows else np.ones(rows.Omega.size, dtype=bool)
    height, text = _height(result, dof)
    x, x_label = frequencies(result, rows.Omega, "frequency of the drive")
    states = stability_of(rows)
    apart = rows.frequency_index % max(1, round(result.Omega.size / _OPEN_MARKS)) == 0
    ax.plot(x[~exists], height[~exists], ".", color=PHANTOM, markersize=2, zorder=1)
    counts, noun = struck(rows)
    for place, count in enumerate(np.unique(counts)):
        color, mark = SERIES[place % len(SERIES)][0], "osD^v"[place % 5]
        mine = exists & (counts == count)
        for state, some, fill in (
            ("stable", mine, "full"), ("neutral", mine, "left"), ("unstable", mine & apart, "none"),
        ):  # fmt: skip
            those = some & (states == state)
            ax.plot(
                x[those], height[those], mark, color=color, markersize=3, fillstyle=fill,
                markerfacecoloralt="white", markeredgewidth=0.6, zorder=2,
            )  # fmt: skip
        if mine.any():
            ax.plot([], [], mark, color=color, markersize=3, label=counted(count, noun))
    for state, fill in (("neutral", "left"), ("unstable", "none")):
        if (exists & (states == state)).any():
            ax.plot(
                [], [], "o", color="black", fillstyle=fill, markerfacecoloralt="white",
                markersize=3, label=state,
            )  # fmt: skip
    if (~exists).any():
        ax.plot([], [], ".", color=PHANTOM, label="phantom")
    if exists.any():
        low, high = float(height[exists].min()), float(height[exists].max())
        room = 0.08 * max(high - low, 1e-3 * abs(high))
        ax.set_ylim(low - room, high + room)
    ax.set_xlabel(x_label)
    ax.set_ylabel(text)
    legend(ax)
    ax.margins(x=0.02)
    return ax


_LINES: dict[str, tuple[Any, float]] = {
    "stable": ("-", 1.6), "unstable": ("--", 1.2), "neutral": ("-.", 1.2), "phantom": (":", 0.6),
}  # fmt: skip
_MARKS = {
    "fold": ("D", "white"), "flip": ("s", "black"), "torus": ("o", "white"),
    "symmetry": ("P", "black"), "grazing": ("^", "white"), "end": ("X", "white"),
}  # fmt: skip


@noted
def branches(result: ResultFile, dof: int | None = None, ax: Axes | None = None) -> Axes:
    """Plot branches of periodic motions over their parameter, with their special points.

    Full lines are stable, dashed ones unstable, dash-dotted ones neutral motions, and dotted grey
    ones phantoms. Lines change where the special points are. The height is the amplitude, half of
    peak to peak, or the momentum of the first impact where extremes were not computed.
    """
    ax = ax or new_axes()
    rows = result.solution
    height, text = _height(result, dof)
    exists = rows.exists if "exists" in rows else np.ones(rows.parameter.size, dtype=bool)
    drawn = set[str]()
    for line in branch_lines(result, stability_of(rows), exists, height):
        if np.ptp(line.x) or np.ptp(line.y):
            drawn.add(line.state)
        style, width = _LINES[line.state]
        color = PHANTOM if line.state == "phantom" else SERIES[line.count % len(SERIES)][0]
        order = 1 if line.state == "phantom" else 2
        ax.plot(line.x, line.y, linestyle=style, linewidth=width, color=color, zorder=order)
    counts, noun = struck(rows)
    for count in np.unique(counts[exists]):
        label = counted(count, noun)
        ax.plot([], [], "-", color=SERIES[count % len(SERIES)][0], label=label)
    for state in ("neutral", "unstable"):
        if state in drawn:
            ax.plot([], [], linestyle=_LINES[state][0], color="black", linewidth=1.2, label=state)
    _mark_points(result, height, ax)
    if exists.any():
        low, high = float(height[exists].min()), float(height[exists].max())
        room = 0.08 * max(high - low, 1e-3 * abs(high))
        ax.set_ylim(low - room, high + room)
    path = str(result.request.get("path", "parameter"))
    if path.startswith("frequency."):
        path = frequencies(result, rows.Omega, "frequency of the drive")[1]
    ax.set_xlabel(path)
    ax.set_ylabel(text)
    legend(ax)
    ax.margins(x=0.02)
    return ax


def _height(result: ResultFile, dof: int | None) -> tuple[Array, str]:
    """Return the height of each periodic motion in plots, and its name."""
    rows = result.solution
    if "x_max" in rows:
        dof, column = column_of(result, dof)
        text = label(rf"amplitude of $x_{{{dof}}}$", result, "solution/x_max")
        return 0.5 * (rows.x_max[:, column] - rows.x_min[:, column]), text
    height = np.zeros(rows.Omega.size)
    if "contacts" in rows:
        solutions, first = np.unique(result.contact.solution, return_index=True)
        height[solutions] = result.contact.impulse[first]
        return height, "impulse of the first contact"
    solutions, first = np.unique(result.impact.solution, return_index=True)
    height[solutions] = result.impact.momentum[first]
    return height, label("momentum of the first impact", result, "impact/momentum")


def _mark_points(result: ResultFile, height: Array, ax: Axes) -> None:
    """Mark special points of admissible motions."""
    named = set[str]()
    for point in special_points(result, height):
        if not point.exists:
            continue
        mark, face = _MARKS[point.kind]
        ax.plot(
            point.x, point.y, mark, color="black", markerfacecolor=face, markersize=5,
            zorder=3, label=None if point.kind in named else point.kind,
        )  # fmt: skip
        named.add(point.kind)
