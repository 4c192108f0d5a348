"""Shared code of the gallery scripts: the style of all plots, and modes with soft limiters."""

from __future__ import annotations

import string

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

import vibroimpact as vi
from vibroimpact.style import ADMISSIBLE as BLUE
from vibroimpact.style import GREEN as OTHER
from vibroimpact.style import OTHER as SOFT
from vibroimpact.style import PHANTOM, SHEET, WALL, legend, small

__all__ = ["BLUE", "OTHER", "PHANTOM", "SOFT", "WALL", "legend", "line", "np", "panels", "vi"]

_STYLES = {SOFT: (0, (5, 1.5)), OTHER: (0, (1, 1)), "black": (0, (5, 1, 1, 1))}


def panels(rows: int = 1, columns: int = 1, size: tuple[float, float] = (7.0, 3.0)):
    """Return a figure as wide as a page and its axes, with the letters of the chapter."""
    with mpl.rc_context(SHEET):
        figure = Figure(figsize=size, layout="constrained", dpi=SHEET["figure.dpi"])
        axes = figure.subplots(rows, columns)
        several = list(np.ravel(axes))
        for letter, ax in zip(string.ascii_lowercase, several, strict=False):
            small(ax)
            if len(several) > 1:
                ax.annotate(
                    f"({letter})", (0.0, 1.0), (-4, 2), ha="right", va="bottom", weight="bold",
                    xycoords="axes fraction", textcoords="offset points",
                )  # fmt: skip
    return figure, axes


def line(ax, x, y, color, label="", **options):
    """Plot a curve in a colour, and in the line style that goes with it."""
    settings = {"linestyle": _STYLES.get(color, "-"), "linewidth": 1.1, "label": label}
    ax.plot(x, y, color=color, **(settings | options))


def say(ax, text):
    """Write the title of a panel."""
    ax.set_title(text, fontsize=SHEET["axes.titlesize"])


def profile(ax, x, walls=None, label="", color=BLUE, marker="o"):
    """Plot the displacements of the masses of a chain, counted from 1."""
    masses = np.arange(1, len(x) + 1)
    ax.axhline(0.0, color="black", linewidth=0.5)
    line(ax, masses, x, color, label, marker=marker, markersize=4)
    for mass, wall in (walls or {}).items():
        ax.hlines([-wall, wall], mass - 0.35, mass + 0.35, color=WALL, linewidth=3.0)
    ax.set_xticks(masses)
    ax.set_xlabel("mass")
    ax.set_ylabel("displacement")


def impulses(ax, modes, natural, top, index=0, color=BLUE, label="p"):
    """Plot p over Omega, phantoms in grey, natural frequencies as dots."""
    p = modes.impulse[:, index].copy()
    p[np.abs(p) > 20 * top] = np.nan
    width = 2.0 if index == 0 else 1.3
    ax.plot(modes.Omega, p, color=PHANTOM, linewidth=0.8, label="" if index else "phantom")
    line(ax, modes.Omega, np.where(modes.exists, p, np.nan), color, label, linewidth=width)
    name = "" if index else "natural frequencies"
    ax.plot(natural, np.zeros(len(natural)), "o", color=WALL, markersize=3.5, label=name)
    ax.axhline(0.0, color="black", linewidth=0.5)
    ax.set_ylim(-0.35 * top, top)
    ax.set_xlim(modes.Omega[0], modes.Omega[-1])
    ax.set_xlabel(r"fundamental frequency $\Omega$")


def tracks(result, impacts):
    """Yield the rows of the first, and of the second solution with so many impacts.

    One row for each frequency, -1 where there is none: both are smooth over the frequency, and
    they meet where the solutions end.
    """
    rows = result.solution
    mine = np.flatnonzero(rows.impacts == impacts)
    first = np.append(True, np.diff(rows.frequency_index[mine]) > 0)
    for some in (mine[first], mine[~first]):
        track = np.full(result.Omega.size, -1)
        track[rows.frequency_index[some]] = some
        yield track


def states(ax, x, y, exists, stability, color, label="", width=1.8):
    """Plot a curve of periodic motions: full, dashed where unstable, dotted for phantoms.

    Where y is nan, there is none.
    """
    stable, there = exists & (stability <= 1.0), np.isfinite(y)
    looks = (
        (stable, color, "-", width), (exists & ~stable, color, (0, (3, 1.5)), 0.6 * width),
        (there & ~exists, PHANTOM, (0, (1, 1.5)), 0.8),
    )  # fmt: skip
    for some, shade, style, thick in looks:
        # A segment has the state of its first point, so that lines do not end before a change.
        shown = some | np.append(False, some[:-1])
        ax.plot(x, np.where(shown, y, np.nan), linestyle=style, color=shade, linewidth=thick)
    if label:
        ax.plot([], [], "-", color=color, linewidth=width, label=label)


_WIDTHS = (2.2, 1.5)  # of motions without impacts, and with one
_MARKS = {"grazing": "^", "flip": "s", "fold": "D", "end": "X", "torus": "o", "symmetry": "P"}


def branches(ax, result, height, colors):
    """Plot branches of admissible motions and phantoms, and their special points.

    `colors` are those of motions without impacts, and with one.
    """
    rows, points = result.solution, result.points
    x = rows.parameter
    named = set()
    for branch in np.unique(rows.branch):
        mine = np.flatnonzero(rows.branch == branch)
        count = int(rows.impacts[mine[0]])
        name = ("no impact", "one impact")[count]
        states(
            ax, x[mine], height[mine], rows.exists[mine], rows.stability[mine], colors[count],
            "" if name in named else name, width=_WIDTHS[count],
        )  # fmt: skip
        named.add(name)
    state_keys(ax)
    for row in np.flatnonzero(points.exists):
        branch, at, kind = points.branch[row], points.parameter[row], points.type[row]
        mine = np.flatnonzero((rows.branch == branch) & rows.exists)
        near = mine[np.argmin(np.abs(rows.parameter[mine] - at))]
        ax.plot(
            at, height[near], _MARKS[str(kind)], color="black", markersize=4.5, zorder=3,
            markerfacecolor="white", markeredgewidth=0.8, label="" if kind in named else str(kind),
        )  # fmt: skip
        named.add(kind)


def state_keys(ax):
    """List the line styles of `states` in the legend."""
    ax.plot([], [], linestyle=(0, (3, 1.5)), color="black", linewidth=1.1, label="unstable")
    ax.plot([], [], linestyle=(0, (1, 1.5)), color=PHANTOM, linewidth=0.8, label="phantom")


def mode(client, system, omega, p, dof, t_end, around, **law):
    """Return an impact mode, after checks, and the motion between soft limiters from its start.

    `p` are the expected impulses; the force law is that of `vibroimpact.soft`. The third value is
    the index of the turning point of that motion: the row with the largest displacement of `dof`
    at times within 30 % of `around`.
    """
    result = client.impact_modes(
        system, [omega], unit="omega", outputs=("impulse", "exists", "shape")
    )
    close(result.impulse[0], p)
    assert result.exists[0]
    # The exact free motion over the first quarter, too short for errors to grow.
    quarter = 1 / omega
    exact = client.time_history(
        system, float(result.Omega[0]), quarter, t=[0.0, quarter * (1 - 1e-12)], outputs=("x", "v")
    )
    assert np.abs(exact.x[1] - result.shape[0]).max() < 1e-9 * np.abs(result.shape).max()
    motion = client.time_history(
        system, (exact.x[0], exact.v[0]), t_end, t=6_001, outputs=("x", "energy"),
        limiter=vi.soft(**law),
    )  # fmt: skip
    assert np.abs(motion.energy / motion.energy[0] - 1).max() < 1e-6
    near = np.abs(motion.t / around - 1.0) < 0.3
    return result, motion, int(np.flatnonzero(near)[np.argmax(motion.x[near, dof])])


def close(computed, expected, relative=1e-12) -> None:
    """Assert that numbers agree."""
    np.testing.assert_allclose(computed, expected, rtol=relative, atol=0)
