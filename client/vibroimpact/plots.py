"""Pictures of results."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from vibroimpact.results import Array, Result

REAL, PHANTOM, WALL = "#0b5394", "#b7b7b7", "#c0392b"


def axes_or_new(ax: Axes | None) -> Axes:
    """Return the axes to draw in; where none are given, those of a new figure."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(figsize=(8.0, 4.5), layout="constrained")[1]


def _label(text: str, result: Result, output: str) -> str:
    unit = result.unit(output)
    return text if unit == "1" else f"{text} ({unit})"


def impulse(result: Result, ax: Axes | None = None) -> Axes:
    """Draw p over Omega: real members in colour, phantoms in grey, no lines through poles."""
    ax = axes_or_new(ax)
    Omega, p = result.Omega, result.impulse
    order = np.argsort(Omega, kind="stable")
    exists: Array = result.exists if "exists" in dir(result) else np.all(p > 0, axis=1)
    for column, index in enumerate(result.constraint):
        curve = _broken(p[order, column])
        name = f"p, constraint {index}" if p.shape[1] > 1 else "p"
        ax.plot(Omega[order], curve, color=PHANTOM, linewidth=1.2, zorder=2)
        shown = np.where(exists[order], curve, np.nan)
        style = "-" if column == 0 else "--"
        ax.plot(Omega[order], shown, style, color=REAL, linewidth=2.0, label=name, zorder=3)
    positive = p[exists] if exists.any() else np.abs(p)
    top = 1.15 * float(np.quantile(positive, 0.97)) if positive.size else 1.0
    ax.set_ylim(-0.35 * top, top)
    ax.axhline(0.0, color="black", linewidth=0.6)
    ax.set_xlabel(_label(r"fundamental frequency $\Omega$", result, "Omega"))
    ax.set_ylabel(_label(r"impulse parameter $p$", result, "impulse"))
    ax.plot([], [], color=PHANTOM, linewidth=1.2, label="phantom")
    ax.legend(frameon=False, loc="upper left")
    return ax


def frequency_energy(result: Result, ax: Axes | None = None) -> Axes:
    """Draw Omega over the energy of the members that exist, those known to be unstable dashed.

    Needs the output energy; exists and stability are heeded where they were computed.
    """
    ax = axes_or_new(ax)
    order = np.argsort(result.Omega, kind="stable")
    Omega, energy = result.Omega[order], result.energy[order]
    there: Array = result.exists[order] if "exists" in dir(result) else np.isfinite(energy)
    if "stability" in dir(result):
        # Moduli of an elastic motion are 1, but for rounding.
        stable = there & (result.stability[order] <= 1.0 + 1e-6)
        lanes = [(stable, "-", "stable"), (there & ~stable, "--", "unstable")]
    else:
        lanes = [(there, "-", "impact modes")]
    for some, style, name in lanes:
        if some.any():
            drawn = np.where(some, energy, np.nan)
            # A member whose neighbours are phantoms is a point.
            mark = "." if Omega.size < 200 else None
            ax.plot(drawn, Omega, style, marker=mark, color=REAL, linewidth=1.8, label=name)
    ax.set_xscale("log")
    ax.set_xlabel(_label("energy", result, "energy"))
    ax.set_ylabel(_label(r"fundamental frequency $\Omega$", result, "Omega"))
    ax.legend(frameon=False)
    return ax


def mode_plot(output: str) -> Callable[..., Axes]:
    """Return what draws an output of impact modes.

    Raises
    ------
    ValueError
        Where nothing does.
    """
    drawing: dict[str, Callable[..., Axes]] = {
        "impulse": impulse,
        "energy": frequency_energy,
        "shape": shape,
    }
    if output not in drawing:
        raise ValueError(f"of impact modes {', '.join(drawing)} can be drawn, not {output!r}")
    return drawing[output]


def bands(result: Result, ax: Axes | None = None) -> Axes:
    """Draw where members exist, where they fail despite positive impulses, and where stable."""
    ax = axes_or_new(ax)
    lanes = [
        ("bands", "real", REAL, None),
        ("rejected", "rejected", PHANTOM, None),
        ("stability", "stable", "#38761d", True),
        ("stability", "unstable", "#e69138", False),
    ]
    shown = [lane for lane in lanes if lane[0] in dir(result)]
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


def resonances(result: Result, ax: Axes | None = None) -> Axes:
    """Draw the frequencies of resonance, a row for each harmonic, coloured by part."""
    ax = axes_or_new(ax)
    for part in np.unique(result.part):
        mine = result.part == part
        ax.plot(result.Omega[mine], result.harmonic[mine], "|", markersize=12, label=f"part {part}")
    ax.set_yticks(np.unique(result.harmonic))
    ax.set_xlabel(_label(r"fundamental frequency $\Omega$", result, "Omega"))
    ax.set_ylabel("resonating harmonic")
    ax.legend(frameon=False)
    return ax


def shape(result: Result, index: int = 0, ax: Axes | None = None) -> Axes:
    """Draw the displacement of every computed degree of freedom at tau = 1."""
    ax = axes_or_new(ax)
    x = result.shape[index]
    ax.axhline(0.0, color="black", linewidth=0.6)
    ax.plot(result.dof, x, "-", color=REAL, linewidth=1.0, alpha=0.5)
    ax.vlines(result.dof, 0.0, x, color=REAL, linewidth=1.0, alpha=0.3)
    ax.plot(result.dof, x, "o", color=REAL, markersize=7)
    _walls(result, ax)
    ax.set_xlabel("degree of freedom")
    ax.set_ylabel(_label(r"displacement at $\tau = 1$", result, "shape"))
    ax.set_title(rf"impact mode at $\Omega$ = {result.Omega[index]:.6g}", fontsize="medium")
    ax.set_xticks(result.dof if result.dof.size <= 30 else ax.get_xticks())
    return ax


def history(result: Result, dof: int | None = None, ax: Axes | None = None) -> Axes:
    """Draw a coordinate over time, with its walls and the impacts of its constraint.

    Where only impacts were computed: their impulses over time.
    """
    ax = axes_or_new(ax)
    if "x" not in dir(result):
        return _impulses(result, ax)
    dof, column = _column(result, dof)
    ax.plot(result.t, result.x[:, column], color=REAL, linewidth=1.2)
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


def basins(result: Result, values: Array | None = None, ax: Axes | None = None) -> Axes:
    """Draw a number of every member of an ensemble over its initial state.

    Parameters
    ----------
    result : Result
        Of an ensemble whose initial states differ in one or two coordinates.
    values : array, shape (member,), optional
        What is drawn; absent: the number of impacts.
    ax : Axes, optional
        Where to draw; absent: a new figure.

    Raises
    ------
    ValueError
        Where the states differ in more coordinates.
    """
    ax = axes_or_new(ax)
    initial = result.request["initial"]
    x, v = np.array(initial["x"]), np.array(initial["v"])
    columns = [(rf"$x_{{{dof}}}(0)$", x[:, dof]) for dof in range(x.shape[1])]
    columns += [(rf"$v_{{{dof}}}(0)$", v[:, dof]) for dof in range(v.shape[1])]
    varying = [column for column in columns if np.ptp(column[1]) > 0.0]
    if not 1 <= len(varying) <= 2:
        raise ValueError(f"the initial states differ in {len(varying)} coordinates, not in 1 or 2")
    there = result.status == "ok"
    counted = "number of impacts" if values is None else ""
    shown = np.asarray(result.count.impacts if values is None else values, dtype=np.float64)
    (across, first), (up, second) = varying[0], varying[-1]
    if len(varying) == 1:
        order = np.argsort(first[there], kind="stable")
        ax.plot(first[there][order], shown[there][order], "o-", color=REAL, markersize=3.0)
        ax.set_ylabel(counted)
    else:
        ax.plot(first[~there], second[~there], "x", color=PHANTOM, markersize=3.0)
        size = float(np.clip(2e5 / max(first.size, 1), 4.0, 120.0))
        drawn = ax.scatter(
            first[there], second[there], size, shown[there], marker="s", linewidths=0.0
        )
        ax.figure.colorbar(drawn, ax=ax, label=counted)
        ax.set_ylabel(up)
    ax.set_xlabel(across)
    return ax


def _impulses(result: Result, ax: Axes) -> Axes:
    for index in np.unique(result.impacts.constraint):
        mine = result.impacts.constraint == index
        ax.plot(result.impacts.time[mine], result.impacts.impulse[mine], ".", label=f"{index}")
    ax.set_xlabel("time")
    ax.set_ylabel("impulse of the impact")
    ax.set_ylim(0.0, 1.15 * float(result.impacts.impulse.max(initial=0.0)) or 1.0)
    if ax.lines:
        ax.legend(frameon=False, title="constraint")
    return ax


def phase_plane(result: Result, dof: int | None = None, ax: Axes | None = None) -> Axes:
    """Draw velocity over displacement of a degree of freedom, with the walls it strikes.

    The line breaks at impacts, where the velocity jumps.
    """
    ax = axes_or_new(ax)
    dof, column = _column(result, dof)
    x, v = result.x[:, column], result.v[:, column]
    breaks = np.zeros(0, dtype=np.int64)
    if "impacts" in dir(result):
        breaks = np.unique(np.searchsorted(result.t, result.impacts.time))
        breaks = breaks[(breaks > 0) & (breaks < x.size)]
    ax.plot(np.insert(x, breaks, np.nan), np.insert(v, breaks, np.nan), color=REAL, linewidth=0.9)
    for wall in _gaps(result, dof):
        ax.axvline(wall, color=WALL, linewidth=2.0)
    ax.set_xlabel(_label(rf"displacement $x_{{{dof}}}$", result, "x"))
    ax.set_ylabel(_label(rf"velocity $v_{{{dof}}}$", result, "v"))
    return ax


def _column(result: Result, dof: int | None) -> tuple[int, int]:
    """Return a degree of freedom and its column: the first constrained one, if none is named."""
    there = [int(d) for d in result.dof]
    if dof is None:
        struck = [c.get("dof") for c in result.request["system"].get("constraints") or ()]
        dof = next((d for d in struck if d in there), there[0])
    return dof, there.index(dof)


def _gaps(result: Result, dof: int) -> list[float]:
    """Return the places of the walls of a degree of freedom."""
    walls: list[float] = []
    for constraint in result.request["system"].get("constraints") or ():
        if constraint.get("dof") == dof:
            gap = constraint["gap"]
            single = isinstance(gap, int | float)
            lower, upper = (gap, gap) if single else (gap.get("lower"), gap.get("upper"))
            walls += [s * w for s, w in ((-1.0, lower), (1.0, upper)) if w is not None]
    return walls


def _impacts(result: Result, dof: int, ax: Axes) -> None:
    for wall in _gaps(result, dof):
        ax.axhline(wall, color=WALL, linewidth=1.5)
    if "impacts" not in dir(result):
        return
    constraints = result.request["system"].get("constraints") or ()
    mine = [i for i, c in enumerate(constraints) if c.get("dof") == dof]
    struck = np.isin(result.impacts.constraint, mine)
    walls = _gaps(result, dof)
    if struck.any() and walls:
        places = np.where(result.impacts.side > 0, max(walls), min(walls))
        ax.plot(result.impacts.time[struck], places[struck], ".", color=WALL, markersize=5)


def displacement(result: Result, ax: Axes | None = None) -> Axes:
    """Draw every computed degree of freedom over time."""
    ax = axes_or_new(ax)
    for column, dof in enumerate(result.dof):
        ax.plot(result.t, result.x[:, column], linewidth=1.2, label=f"degree of freedom {dof}")
    ax.set_xlabel(_label("time", result, "t"))
    ax.set_ylabel(_label("displacement", result, "x"))
    if result.dof.size > 1:
        ax.legend(frameon=False)
    return ax


def _walls(result: Result, ax: Axes) -> None:
    for constraint in result.request.get("system", {}).get("constraints", ()):
        gap, dof = constraint.get("gap"), constraint.get("dof")
        if dof is None:
            continue
        walls = (gap, gap) if isinstance(gap, float | int) else (gap.get("lower"), gap.get("upper"))
        for sign, wall in zip((-1.0, 1.0), walls, strict=True):
            if wall is not None:
                ax.hlines(sign * wall, dof - 0.4, dof + 0.4, color=WALL, linewidth=3.0)


def _broken(p: Array) -> Array:
    """Return the curve without the points beside which it jumps from one infinity to the other."""
    curve = np.array(p, dtype=np.float64)
    jump = (curve[1:] > 0) != (curve[:-1] > 0)
    # At a zero the curve is small on both sides, at a pole it is large.
    large = np.minimum(np.abs(curve[1:]), np.abs(curve[:-1])) > np.median(np.abs(curve))
    curve[1:][jump & large] = np.nan
    return curve
