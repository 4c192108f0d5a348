"""Plots of motions: displacements over time, phase planes, and ensembles over initial states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vibroimpact.result_file import ResultFile
from vibroimpact.style import (
    ADMISSIBLE,
    OTHER,
    PHANTOM,
    SERIES,
    WALL,
    colorbar,
    label,
    legend,
    new_axes,
    noted,
)
from vibroimpact.tables import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_NAMED_TERMS: Final = 3
"""Terms of a sum that fit the label of an axis."""


@noted
def history(result: ResultFile, dof: int | None = None, ax: Axes | None = None) -> Axes:
    """Plot a displacement over time, by default that of the first constraint, with its walls.

    Impacts are marked at the walls. Stops of finite stiffness: with their force, on an axis at the
    right, or with the times at which they push. If only impacts or contacts were computed, plot
    their impulses over time.
    """
    ax = ax or new_axes()
    if not hasattr(result, "x"):
        return _impulses(result, ax)
    shown = coordinate_of(result, dof)
    ax.plot(result.t, shown.of(result.x), color=ADMISSIBLE, linewidth=1.2)
    for wall in shown.walls:
        ax.axhline(wall, color=WALL, linewidth=1.2)
    _impacts(result, shown, ax)
    _forces(result, shown, ax)
    until = result.error.predictable_until
    if until < result.t[-1]:
        ax.axvspan(until, result.t[-1], color=PHANTOM, alpha=0.25, linewidth=0.0)
        ax.annotate("not predictable", (until, 1.0), (4, -4), va="top", fontsize=7.0,
                    xycoords=("data", "axes fraction"), textcoords="offset points")  # fmt: skip
    ax.set_xlabel(label("time", result, "t"))
    ax.set_ylabel(label(f"displacement {shown.name('x')}", result, "x"))
    ax.margins(x=0.0)
    return ax


@noted
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
        If the states differ in no coordinate or in more than two, or are impact modes.
    """
    ax = ax or new_axes()
    x, v = _initial_states(result.request["initial"])
    columns = [(rf"$x_{{{dof}}}(0)$", x[:, dof]) for dof in range(x.shape[1])]
    columns += [(rf"$v_{{{dof}}}(0)$", v[:, dof]) for dof in range(v.shape[1])]
    varying = [column for column in columns if np.ptp(column[1]) > 0.0]
    if not 1 <= len(varying) <= 2:
        raise ValueError(f"the initial states differ in {len(varying)} coordinates, not in 1 or 2")
    computed = result.status == "ok"
    text = "number of impacts" if values is None else ""
    shown = np.asarray(result.count.impacts if values is None else values, dtype=np.float64)
    (across, first), (up, second) = varying[0], varying[-1]
    if len(varying) == 1:
        order = np.argsort(first[computed], kind="stable")
        ax.plot(
            first[computed][order], shown[computed][order], "o-", color=ADMISSIBLE, markersize=3.0
        )
        ax.set_ylabel(text)
    else:
        drawn = _cells(first, second, np.where(computed, shown, np.nan), ax)
        colorbar(drawn, ax, text)
        ax.set_ylabel(up)
    ax.set_xlabel(across)
    return ax


def _initial_states(initial: Any) -> tuple[Array, Array]:
    """Return displacements and velocities of a request, each shape (motion, dof)."""
    several = initial if isinstance(initial, list) else [initial]
    if any("x" not in each for each in several):
        raise ValueError("motions that start on impact modes have no initial states to draw over")
    x, v = (np.concatenate([np.atleast_2d(each[name]) for each in several]) for name in ("x", "v"))
    return x, v


def _cells(x: Array, y: Array, values: Array, ax: Axes) -> Any:
    """Colour the cells around states that form a grid, or else a mark at each state."""
    (across, column), (up, row) = (
        np.unique(x, return_inverse=True),
        np.unique(y, return_inverse=True),
    )
    if across.size * up.size != x.size or len(set(zip(row, column, strict=True))) != x.size:
        ax.plot(x[np.isnan(values)], y[np.isnan(values)], "x", color=PHANTOM, markersize=3.0)
        size = float(np.clip(2e4 / x.size, 1.0, 40.0))
        return ax.scatter(x, y, size, values, linewidths=0.0, cmap="viridis")
    grid = np.full((up.size, across.size), np.nan)
    grid[row, column] = values
    ax.set_facecolor(PHANTOM)  # where there is no motion
    return ax.pcolormesh(
        across, up, np.ma.masked_invalid(grid), shading="nearest", cmap="viridis", rasterized=True
    )


def _impulses(result: ResultFile, ax: Axes) -> Axes:
    struck = hasattr(result, "impacts")
    table, name = (result.impacts, "impacts") if struck else (result.contacts, "contacts")
    times, time = (table.time, "time") if struck else (table.start, "start")
    for index in np.unique(table.constraint):
        mine, color = table.constraint == index, SERIES[int(index) % len(SERIES)][0]
        ax.plot(
            times[mine], table.impulse[mine], "os^Dv"[int(index) % 5],
            color=color, markersize=2.5, label=f"constraint {index}",
        )  # fmt: skip
    ax.set_xlabel(label("time", result, f"{name}/{time}"))
    ax.set_ylabel(label(f"momentum of the {name[:-1]}", result, f"{name}/impulse"))
    ax.set_ylim(0.0, 1.15 * float(table.impulse.max(initial=0.0)) or 1.0)
    legend(ax)
    return ax


def _forces(result: ResultFile, shown: Coordinate, ax: Axes) -> None:
    """Draw the force of the stop at a coordinate, or the times at which it pushes."""
    if not shown.constraints:
        return
    if hasattr(result, "force"):
        right, force = ax.twinx(), result.force[:, shown.constraints[0]]
        right.fill_between(result.t, force, color=OTHER, alpha=0.35, linewidth=0.0)
        right.set_ylim(0.0, 3.0 * float(force.max(initial=0.0)) or 1.0)
        sizes = ax.yaxis.label.get_fontsize(), ax.yaxis.get_ticklabels()[0].get_fontsize()
        right.set_ylabel(label("force of the stop", result, "force"), fontsize=sizes[0])
        right.tick_params(labelsize=sizes[1])
        right.ticklabel_format(axis="y", useMathText=True)
        right.yaxis.get_offset_text().set_fontsize(sizes[1])
        right.spines["top"].set_visible(False)
    elif hasattr(result, "contacts") and hasattr(result.contacts, "peak_force"):
        pushing = result.contacts.constraint == shown.constraints[0]
        spans = zip(result.contacts.start[pushing], result.contacts.stop[pushing], strict=True)
        for start, stop in spans:
            ax.axvspan(start, stop, color=OTHER, alpha=0.25, linewidth=0.0)


@noted
def phase_plane(result: ResultFile, dof: int | None = None, ax: Axes | None = None) -> Axes:
    """Plot the velocity over the displacement, by default of the first constraint, with its walls.

    The line is interrupted at impacts, where the velocity jumps.
    """
    ax = ax or new_axes()
    shown = coordinate_of(result, dof)
    x, v = shown.of(result.x), shown.of(result.v)
    breaks = np.zeros(0, dtype=np.int64)
    if hasattr(result, "impacts"):
        breaks = np.unique(np.searchsorted(result.t, result.impacts.time))
        breaks = breaks[(breaks > 0) & (breaks < x.size)]
    ax.plot(
        np.insert(x, breaks, np.nan), np.insert(v, breaks, np.nan), color=ADMISSIBLE, linewidth=0.9
    )
    for wall in shown.walls:
        ax.axvline(wall, color=WALL, linewidth=1.5)
    ax.locator_params(axis="x", nbins=5)
    ax.set_xlabel(label(f"displacement {shown.name('x')}", result, "x"))
    ax.set_ylabel(label(f"velocity {shown.name('v')}", result, "v"))
    return ax


@dataclass(frozen=True, slots=True)
class Coordinate:
    """A degree of freedom, or the sum of several that a constraint limits.

    Parameters
    ----------
    weights : dict
        Column of the result -> weight.
    dofs : tuple of int
        Degrees of freedom of these columns.
    constraints : tuple of int
        Constraints that limit it.
    walls : tuple of float
        Where they do.
    """

    weights: dict[int, float]
    dofs: tuple[int, ...]
    constraints: tuple[int, ...]
    walls: tuple[float, ...]

    def of(self, values: Array) -> Array:
        """Return its values over time from those of all columns, shape (time, column)."""
        shown: Array = values[:, list(self.weights)] @ np.array([*self.weights.values()])
        return shown

    def name(self, symbol: str) -> str:
        """Return its name, such as x_2 - x_5, or that of its constraint where it has many terms."""
        if len(self.dofs) > _NAMED_TERMS:
            return f"of constraint {self.constraints[0]}"
        terms = zip(self.weights.values(), self.dofs, strict=True)
        text = "".join(
            f"{'-' if w < 0.0 else '+'}{'' if abs(w) == 1.0 else f'{abs(w):.3g}'}{symbol}_{{{dof}}}"
            for w, dof in terms
        )
        return f"${text.removeprefix('+')}$"


def coordinate_of(result: ResultFile, dof: int | None) -> Coordinate:
    """Return a degree of freedom, by default what the first constraint limits."""
    computed = [int(each) for each in result.dof]
    limited = [_weights(each) for each in constraints_of(result)]
    if dof is None:
        whole = (each for each in limited if each and each.keys() <= set(computed))
        weights = next(whole, {computed[0]: 1.0})
    else:
        weights = {dof: 1.0}
    mine = [index for index, each in enumerate(limited) if each == weights]
    return Coordinate(
        {computed.index(each): weight for each, weight in weights.items()},
        tuple(weights),
        tuple(mine),
        tuple(wall for index in mine for wall in _walls(constraints_of(result)[index])),
    )


def column_of(result: ResultFile, dof: int | None) -> tuple[int, int]:
    """Return a degree of freedom, by default the first constrained one, and its column."""
    computed = [int(d) for d in result.dof]
    if dof is None:
        struck = (d for each in constraints_of(result) for d in _weights(each))
        dof = next((d for d in struck if d in computed), computed[0])
    return dof, computed.index(dof)


def constraints_of(result: ResultFile) -> list[dict[str, Any]]:
    """Return the documents of the limiters; none of a stored structure."""
    return list(result.request.get("system", {}).get("constraints") or ())


def _weights(constraint: dict[str, Any]) -> dict[int, float]:
    """Return the weights of the degrees of freedom in the coordinate of a constraint."""
    direction = constraint.get("direction")
    if direction:
        return dict(zip(direction["dofs"], direction["weights"], strict=True))
    return {constraint.get("dof", -1): 1.0}


def _walls(constraint: dict[str, Any]) -> list[float]:
    """Return the displacements at which the walls of a constraint stand."""
    gap = constraint["gap"]
    single = isinstance(gap, int | float)
    lower, upper = (gap, gap) if single else (gap.get("lower"), gap.get("upper"))
    return [s * w for s, w in ((-1.0, lower), (1.0, upper)) if w is not None]


def _impacts(result: ResultFile, shown: Coordinate, ax: Axes) -> None:
    """Mark the impacts at the walls of a coordinate."""
    if not hasattr(result, "impacts") or not shown.walls:
        return
    struck = np.isin(result.impacts.constraint, shown.constraints)
    if struck.any():
        places = np.where(result.impacts.side > 0, max(shown.walls), min(shown.walls))
        ax.plot(result.impacts.time[struck], places[struck], "o", color=OTHER, markersize=2.5)


@noted
def displacement(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the displacement of every computed degree of freedom over time."""
    ax = ax or new_axes()
    for column, dof in enumerate(result.dof):
        color, style = SERIES[column % len(SERIES)]
        name = f"$x_{{{dof}}}$"
        ax.plot(result.t, result.x[:, column], linestyle=style, color=color, lw=1.2, label=name)
    ax.set_xlabel(label("time", result, "t"))
    ax.set_ylabel(label("displacement", result, "x"))
    if result.dof.size > 1:
        legend(ax, 5)
    return ax
