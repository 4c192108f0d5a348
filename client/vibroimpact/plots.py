"""Plots of results."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from vibroimpact.result_file import ResultFile
from vibroimpact.tables import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ADMISSIBLE, PHANTOM, WALL = "#0b5394", "#b7b7b7", "#c0392b"


def axes_or_new(ax: Axes | None) -> Axes:
    """Return the given axes, or those of a new figure."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(figsize=(8.0, 4.5), layout="constrained")[1]


def _label(text: str, result: ResultFile, output: str) -> str:
    unit = result.unit(output)
    return text if unit == "1" else f"{text} ({unit})"


def impulse(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot p over Omega: admissible solutions in colour, phantoms in grey, poles left open."""
    ax = axes_or_new(ax)
    Omega, p = result.Omega, result.impulse
    order = np.argsort(Omega, kind="stable")
    exists: Array = result.exists if hasattr(result, "exists") else np.all(p > 0, axis=1)
    for column, index in enumerate(result.constraint):
        curve = _broken(p[order, column])
        name = f"p, constraint {index}" if p.shape[1] > 1 else "p"
        ax.plot(Omega[order], curve, color=PHANTOM, linewidth=1.2, zorder=2)
        shown = np.where(exists[order], curve, np.nan)
        style = "-" if column == 0 else "--"
        ax.plot(Omega[order], shown, style, color=ADMISSIBLE, linewidth=2.0, label=name, zorder=3)
    positive = p[exists] if exists.any() else np.abs(p)
    top = 1.15 * float(np.quantile(positive, 0.97)) if positive.size else 1.0
    ax.set_ylim(-0.35 * top, top)
    ax.axhline(0.0, color="black", linewidth=0.6)
    ax.set_xlabel(_label(r"fundamental frequency $\Omega$", result, "Omega"))
    ax.set_ylabel(_label(r"impulse parameter $p$", result, "impulse"))
    ax.plot([], [], color=PHANTOM, linewidth=1.2, label="phantom")
    ax.legend(frameon=False, loc="upper left")
    return ax


def frequency_energy(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot Omega over the energy of the admissible solutions, unstable ones dashed.

    Requires the output energy; uses exists and stability if they were computed.
    """
    ax = axes_or_new(ax)
    order = np.argsort(result.Omega, kind="stable")
    Omega, energy = result.Omega[order], result.energy[order]
    admissible: Array = result.exists[order] if hasattr(result, "exists") else np.isfinite(energy)
    if hasattr(result, "stability"):
        # Moduli of an elastic motion are 1, but for rounding.
        stable = admissible & (result.stability[order] <= 1.0 + 1e-6)
        branches = [(stable, "-", "stable"), (admissible & ~stable, "--", "unstable")]
    else:
        branches = [(admissible, "-", "impact modes")]
    for some, style, name in branches:
        if some.any():
            drawn = np.where(some, energy, np.nan)
            # A solution between two phantoms is a single point, which a line does not show.
            mark = "." if Omega.size < 200 else None
            ax.plot(drawn, Omega, style, marker=mark, color=ADMISSIBLE, linewidth=1.8, label=name)
    ax.set_xscale("log")
    ax.set_xlabel(_label("energy", result, "energy"))
    ax.set_ylabel(_label(r"fundamental frequency $\Omega$", result, "Omega"))
    ax.legend(frameon=False)
    return ax


def mode_plot(output: str) -> Callable[..., Axes]:
    """Return the function that plots an output of impact modes.

    Raises
    ------
    ValueError
        If there is none.
    """
    drawing: dict[str, Callable[..., Axes]] = {
        "impulse": impulse,
        "energy": frequency_energy,
        "shape": shape,
    }
    if output not in drawing:
        raise ValueError(f"impact modes: {', '.join(drawing)} can be drawn, not {output!r}")
    return drawing[output]


def bands(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the bands that are admissible, rejected despite positive impulses, and stable."""
    ax = axes_or_new(ax)
    rows = [
        ("bands", "admissible", ADMISSIBLE, None),
        ("rejected", "rejected", PHANTOM, None),
        ("stability", "stable", "#38761d", True),
        ("stability", "unstable", "#e69138", False),
    ]
    shown = [row for row in rows if hasattr(result, row[0])]
    for place, (name, _, color, stable) in enumerate(reversed(shown)):
        table = getattr(result, name)
        some = np.ones(table.start.size, dtype=bool)
        if stable is not None:
            some = (table.stable == "yes") == stable
        spans = list(zip(table.start[some], (table.stop - table.start)[some], strict=True))
        ax.broken_barh(spans, (place - 0.35, 0.7), facecolors=color)
    ax.set_yticks(range(len(shown)), [label for _, label, _, _ in reversed(shown)])
    ax.set_xlabel(_label(r"fundamental frequency $\Omega$", result, "Omega"))
    ax.margins(x=0.0)
    return ax


def resonances(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the resonance frequencies, one row per harmonic, coloured by part of the structure."""
    ax = axes_or_new(ax)
    for part in np.unique(result.part):
        mine = result.part == part
        ax.plot(result.Omega[mine], result.harmonic[mine], "|", markersize=12, label=f"part {part}")
    ax.set_yticks(np.unique(result.harmonic))
    ax.set_xlabel(_label(r"fundamental frequency $\Omega$", result, "Omega"))
    ax.set_ylabel("resonating harmonic")
    ax.legend(frameon=False)
    return ax


def response(result: ResultFile, dof: int | None = None, ax: Axes | None = None) -> Axes:
    """Plot the amplitude of periodic motions, half of peak to peak, over the drive's frequency.

    Filled marks are stable, open ones unstable motions, and small grey ones phantoms; motions
    without impacts, with one impact per period and so on have colours of their own. Where extremes
    were not computed, plot the momentum of the first impact.
    """
    ax = axes_or_new(ax)
    rows = result.solution
    exists = rows.exists if "exists" in rows else np.ones(rows.Omega.size, dtype=bool)
    if "x_max" in rows:
        dof, column = _column(result, dof)
        height = 0.5 * (rows.x_max[:, column] - rows.x_min[:, column])
        label = rf"amplitude of $x_{{{dof}}}$"
    else:
        first = np.unique(result.impact.solution, return_index=True)
        height = np.zeros(rows.Omega.size)
        height[first[0]] = result.impact.momentum[first[1]]
        label = "momentum of the first impact"
    stable = rows.stability <= 1.0 if "stability" in rows else exists
    ax.plot(rows.Omega[~exists], height[~exists], ".", color=PHANTOM, markersize=3, zorder=1)
    colors = (ADMISSIBLE, "#38761d", "#e69138", "#674ea7", WALL)
    for place, count in enumerate(np.unique(rows.impacts)):
        color = colors[place % len(colors)]
        name = "no impact" if count == 0 else f"{count} impact{'s' if count > 1 else ''} per period"
        mine = exists & (rows.impacts == count)
        for some, face in ((mine & stable, color), (mine & ~stable, "white")):
            ax.plot(
                rows.Omega[some], height[some], "o", color=color, markersize=4,
                markerfacecolor=face, markeredgewidth=0.8, zorder=2,
            )  # fmt: skip
        if mine.any():
            ax.plot([], [], "o", color=color, markersize=4, label=name)
    if "stability" in rows and (exists & ~stable).any():
        ax.plot([], [], "o", color="black", markerfacecolor="white", markersize=4, label="unstable")
    if (~exists).any():
        ax.plot([], [], ".", color=PHANTOM, label="phantom")
    if exists.any():
        low, high = float(height[exists].min()), float(height[exists].max())
        room = 0.08 * max(high - low, 1e-3 * abs(high))
        ax.set_ylim(low - room, high + 3.0 * room)
    ax.set_xlabel(_label(r"frequency of the drive $\Omega$", result, "Omega"))
    ax.set_ylabel(label)
    ax.legend(frameon=False, ncols=2, loc="upper right")
    ax.margins(x=0.02)
    return ax


def shape(result: ResultFile, index: int = 0, ax: Axes | None = None) -> Axes:
    """Plot the displacement of every computed degree of freedom at tau = 1."""
    ax = axes_or_new(ax)
    x = result.shape[index]
    ax.axhline(0.0, color="black", linewidth=0.6)
    ax.plot(result.dof, x, "-", color=ADMISSIBLE, linewidth=1.0, alpha=0.5)
    ax.vlines(result.dof, 0.0, x, color=ADMISSIBLE, linewidth=1.0, alpha=0.3)
    ax.plot(result.dof, x, "o", color=ADMISSIBLE, markersize=7)
    _walls(result, ax)
    ax.set_xlabel("degree of freedom")
    ax.set_ylabel(_label(r"displacement at $\tau = 1$", result, "shape"))
    ax.set_title(rf"impact mode at $\Omega$ = {result.Omega[index]:.6g}", fontsize="medium")
    ax.set_xticks(result.dof if result.dof.size <= 30 else ax.get_xticks())
    return ax


def history(result: ResultFile, dof: int | None = None, ax: Axes | None = None) -> Axes:
    """Plot a displacement over time, with the walls and impacts of its constraint.

    If only impacts were computed, plot their impulses over time.
    """
    ax = axes_or_new(ax)
    if not hasattr(result, "x"):
        return _impulses(result, ax)
    dof, column = _column(result, dof)
    ax.plot(result.t, result.x[:, column], color=ADMISSIBLE, linewidth=1.2)
    _impacts(result, dof, ax)
    until = result.error.predictable_until
    if until < result.t[-1]:
        ax.axvspan(until, result.t[-1], color=PHANTOM, alpha=0.25, linewidth=0.0)
        ax.annotate("not predictable", (until, 1.0), (4, -4), va="top", fontsize="small",
                    xycoords=("data", "axes fraction"), textcoords="offset points")  # fmt: skip
    ax.set_xlabel(_label("time", result, "t"))
    ax.set_ylabel(_label(rf"displacement $x_{{{dof}}}$", result, "x"))
    ax.margins(x=0.0)
    return ax


def basins(result: ResultFile, values: Array | None = None, ax: Axes | None = None) -> Axes:
    """Plot one value of each member of an ensemble over its initial state.

    Parameters
    ----------
    result : ResultFile
        Result of an ensemble whose initial states differ in one or two coordinates.
    values : array, shape (member,), optional
        Values to plot; default: the number of impacts.
    ax : Axes, optional
        Axes to draw in; default: those of a new figure.

    Raises
    ------
    ValueError
        If the states differ in no coordinate or in more than two.
    """
    ax = axes_or_new(ax)
    initial = result.request["initial"]
    x, v = np.array(initial["x"]), np.array(initial["v"])
    columns = [(rf"$x_{{{dof}}}(0)$", x[:, dof]) for dof in range(x.shape[1])]
    columns += [(rf"$v_{{{dof}}}(0)$", v[:, dof]) for dof in range(v.shape[1])]
    varying = [column for column in columns if np.ptp(column[1]) > 0.0]
    if not 1 <= len(varying) <= 2:
        raise ValueError(f"the initial states differ in {len(varying)} coordinates, not in 1 or 2")
    computed = result.status == "ok"
    label = "number of impacts" if values is None else ""
    shown = np.asarray(result.count.impacts if values is None else values, dtype=np.float64)
    (across, first), (up, second) = varying[0], varying[-1]
    if len(varying) == 1:
        order = np.argsort(first[computed], kind="stable")
        ax.plot(
            first[computed][order], shown[computed][order], "o-", color=ADMISSIBLE, markersize=3.0
        )
        ax.set_ylabel(label)
    else:
        ax.plot(first[~computed], second[~computed], "x", color=PHANTOM, markersize=3.0)
        size = float(np.clip(2e5 / max(first.size, 1), 4.0, 120.0))
        drawn = ax.scatter(
            first[computed], second[computed], size, shown[computed], marker="s", linewidths=0.0
        )
        ax.figure.colorbar(drawn, ax=ax, label=label)
        ax.set_ylabel(up)
    ax.set_xlabel(across)
    return ax


def _impulses(result: ResultFile, ax: Axes) -> Axes:
    for index in np.unique(result.impacts.constraint):
        mine = result.impacts.constraint == index
        ax.plot(result.impacts.time[mine], result.impacts.impulse[mine], ".", label=f"{index}")
    ax.set_xlabel("time")
    ax.set_ylabel("impulse of the impact")
    ax.set_ylim(0.0, 1.15 * float(result.impacts.impulse.max(initial=0.0)) or 1.0)
    if ax.lines:
        ax.legend(frameon=False, title="constraint")
    return ax


def phase_plane(result: ResultFile, dof: int | None = None, ax: Axes | None = None) -> Axes:
    """Plot the velocity over the displacement of a degree of freedom, with its walls.

    The line is interrupted at impacts, where the velocity jumps.
    """
    ax = axes_or_new(ax)
    dof, column = _column(result, dof)
    x, v = result.x[:, column], result.v[:, column]
    breaks = np.zeros(0, dtype=np.int64)
    if hasattr(result, "impacts"):
        breaks = np.unique(np.searchsorted(result.t, result.impacts.time))
        breaks = breaks[(breaks > 0) & (breaks < x.size)]
    ax.plot(
        np.insert(x, breaks, np.nan), np.insert(v, breaks, np.nan), color=ADMISSIBLE, linewidth=0.9
    )
    for wall in _gaps(result, dof):
        ax.axvline(wall, color=WALL, linewidth=2.0)
    ax.set_xlabel(_label(rf"displacement $x_{{{dof}}}$", result, "x"))
    ax.set_ylabel(_label(rf"velocity $v_{{{dof}}}$", result, "v"))
    return ax


def _column(result: ResultFile, dof: int | None) -> tuple[int, int]:
    """Return a degree of freedom, by default the first constrained one, and its column."""
    computed = [int(d) for d in result.dof]
    if dof is None:
        struck = [c.get("dof") for c in _constraints(result)]
        dof = next((d for d in struck if d in computed), computed[0])
    return dof, computed.index(dof)


def _constraints(result: ResultFile) -> list[dict[str, Any]]:
    return list(result.request.get("system", {}).get("constraints") or ())


def _gaps(result: ResultFile, dof: int) -> list[float]:
    """Return the displacements at which the walls of a degree of freedom stand."""
    walls: list[float] = []
    for constraint in _constraints(result):
        if constraint.get("dof") == dof:
            gap = constraint["gap"]
            single = isinstance(gap, int | float)
            lower, upper = (gap, gap) if single else (gap.get("lower"), gap.get("upper"))
            walls += [s * w for s, w in ((-1.0, lower), (1.0, upper)) if w is not None]
    return walls


def _impacts(result: ResultFile, dof: int, ax: Axes) -> None:
    for wall in _gaps(result, dof):
        ax.axhline(wall, color=WALL, linewidth=1.5)
    if not hasattr(result, "impacts"):
        return
    constraints = _constraints(result)
    mine = [i for i, c in enumerate(constraints) if c.get("dof") == dof]
    struck = np.isin(result.impacts.constraint, mine)
    walls = _gaps(result, dof)
    if struck.any() and walls:
        places = np.where(result.impacts.side > 0, max(walls), min(walls))
        ax.plot(result.impacts.time[struck], places[struck], ".", color=WALL, markersize=5)


def displacement(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the displacement of every computed degree of freedom over time."""
    ax = axes_or_new(ax)
    for column, dof in enumerate(result.dof):
        ax.plot(result.t, result.x[:, column], linewidth=1.2, label=f"degree of freedom {dof}")
    ax.set_xlabel(_label("time", result, "t"))
    ax.set_ylabel(_label("displacement", result, "x"))
    if result.dof.size > 1:
        ax.legend(frameon=False)
    return ax


def _walls(result: ResultFile, ax: Axes) -> None:
    for dof in {c["dof"] for c in _constraints(result) if c.get("dof") is not None}:
        ax.hlines(_gaps(result, dof), dof - 0.4, dof + 0.4, color=WALL, linewidth=3.0)


def _broken(p: Array) -> Array:
    """Return the curve with gaps at its poles, where it jumps between plus and minus infinity."""
    curve = np.array(p, dtype=np.float64)
    jump = (curve[1:] > 0) != (curve[:-1] > 0)
    # At a zero the curve is small on both sides, at a pole it is large.
    large = np.minimum(np.abs(curve[1:]), np.abs(curve[:-1])) > np.median(np.abs(curve))
    curve[1:][jump & large] = np.nan
    return curve


if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Return the colour of admissible solutions by its name in 0.1.0."""
        if name != "REAL":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        message = f"{__name__}.REAL is now {__name__}.ADMISSIBLE"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return ADMISSIBLE
