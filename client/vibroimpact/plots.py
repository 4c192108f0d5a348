"""Pictures of results."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from vibroimpact.results import Array, Result

REAL, PHANTOM, WALL = "#0b5394", "#b7b7b7", "#c0392b"


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(figsize=(8.0, 4.5), layout="constrained")[1]


def impulse(result: Result, ax: Axes | None = None) -> Axes:
    """Draw p over Omega: real members in colour, phantoms in grey, no lines through poles."""
    ax = _axes(ax)
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
    ax.set_xlabel(r"fundamental frequency $\Omega$")
    ax.set_ylabel(r"impulse parameter $p$")
    ax.plot([], [], color=PHANTOM, linewidth=1.2, label="phantom")
    ax.legend(frameon=False, loc="upper left")
    return ax


def shape(result: Result, index: int = 0, ax: Axes | None = None) -> Axes:
    """Draw the displacement of every computed degree of freedom at tau = 1."""
    ax = _axes(ax)
    x = result.shape[index]
    ax.axhline(0.0, color="black", linewidth=0.6)
    ax.plot(result.dof, x, "-", color=REAL, linewidth=1.0, alpha=0.5)
    ax.vlines(result.dof, 0.0, x, color=REAL, linewidth=1.0, alpha=0.3)
    ax.plot(result.dof, x, "o", color=REAL, markersize=7)
    _walls(result, ax)
    ax.set_xlabel("degree of freedom")
    ax.set_ylabel(r"displacement at $\tau = 1$")
    ax.set_title(rf"impact mode at $\Omega$ = {result.Omega[index]:.6g}", fontsize="medium")
    ax.set_xticks(result.dof if result.dof.size <= 30 else ax.get_xticks())
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
