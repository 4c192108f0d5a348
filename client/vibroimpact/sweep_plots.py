"""Plots of sweeps: a line over one axis, a colour map over two."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vibroimpact.result_file import ResultFile
from vibroimpact.style import ADMISSIBLE, PHANTOM, colorbar, new_axes, noted, title

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes


@noted
def draw(
    result: ResultFile,
    output: str | None = None,
    at: Mapping[str, float] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Plot an output of a sweep over the one or two dimensions that are left.

    If `exists` was computed as well, phantoms are grey.

    Parameters
    ----------
    result : ResultFile
        Result of a sweep.
    output : str, optional
        Name of the output; default: the first one computed.
    at : mapping, optional
        Dimension -> value at which it is held fixed; the nearest one computed is taken.
        Dimensions of size one may be left out. Where more than two are left, the axes with most
        values are drawn, the others held in their middle, which the title says.
    ax : Axes, optional
        Axes to draw in; default: those of a new figure.

    Raises
    ------
    ValueError
        If no dimension is left.
    """
    data = result.to_xarray()
    chosen = output or _first(data)
    held = {**_slice(data[chosen], at or {}), **(at or {})}
    shown = _selected(data[chosen], held)
    admissible = _admissible(data, chosen, held)
    if shown.ndim == 0:
        raise ValueError(
            f"a plot has one or two dimensions; {chosen} has one value: {shown.item()}"
        )
    target = ax or new_axes()
    if shown.ndim == 1:
        _line(shown, admissible, target)
    else:
        _map(shown if admissible is None else shown.where(admissible), target)
    fixed = [
        f"{name} = {float(shown[name]) if name in shown.coords else value:.4g}"
        for name, value in held.items()
    ]
    title(target, ", ".join(fixed))
    return target


def over_axis(
    result: ResultFile, output: str | None = None, at: Mapping[str, float] | None = None
) -> tuple[Any, Any, str, str]:
    """Return an output over the one dimension that is left, in its order, and both labels.

    Raises
    ------
    ValueError
        If another number of dimensions is left.
    """
    data = result.to_xarray()
    chosen = output or _first(data)
    shown = _selected(data[chosen], at or {})
    if shown.ndim != 1:
        left = ", ".join(map(str, shown.dims)) or "none"
        raise ValueError(f"{chosen} over one axis: hold the others fixed by at; left are {left}")
    x, label = _coordinate(shown, shown.dims[0])
    return x, shown.values, label, _label(shown)


def _slice(shown: xarray.DataArray, at: Mapping[str, float]) -> dict[str, float]:
    """Return what to hold fixed where more than two dimensions are left: value of each.

    Drawn are those with coordinates before those without, and among them the longest.
    """
    left = [dim for dim in shown.dims if dim not in at and shown.sizes[dim] > 1]
    order = sorted(left, key=lambda dim: (dim in shown.indexes, shown.sizes[dim]))
    return {
        str(dim): float(np.sort(shown[dim].values)[shown.sizes[dim] // 2])
        if dim in shown.indexes
        else 0.0
        for dim in order[:-2]
    }


def _first(data: xarray.Dataset) -> str:
    """Return the momentum of the impacts if it was computed, else the first output."""
    computed = [str(name) for name in data.data_vars if name != "status"]
    return next((name for name in ("momentum", "impulse", *computed) if name in computed), "status")


def _admissible(
    data: xarray.Dataset, output: str, at: Mapping[str, float]
) -> xarray.DataArray | None:
    """Return which of the plotted solutions are admissible, None if that is not known."""
    if "exists" not in data or "flag_meanings" in data[output].attrs:
        return None
    dims = data["exists"].dims
    if not set(dims) <= set(data[output].dims):
        return None
    return _selected(data["exists"] == 1, {dim: v for dim, v in at.items() if dim in dims})


def _selected(shown: xarray.DataArray, at: Mapping[str, float]) -> xarray.DataArray:
    for dim, value in at.items():
        # A dimension without a coordinate is selected by index.
        place = int(value)
        if dim in shown.indexes:
            place = int(np.abs(shown[dim].values - value).argmin())
        shown = shown.isel({dim: place})
    single = [dim for dim in shown.dims if shown.sizes[dim] == 1]
    return shown.squeeze(single)


def _label(values: xarray.DataArray) -> str:
    unit = values.attrs.get("units", "1")
    name = str(values.attrs.get("long_name", values.name)).partition(",")[0]
    return name if unit == "1" else f"{name} ({unit})"


def _coordinate(shown: xarray.DataArray, dim: Any) -> tuple[np.ndarray[Any, Any], str]:
    if dim in shown.coords:
        return np.asarray(shown[dim].values), _label(shown[dim])
    return np.arange(shown.sizes[dim]), str(dim)


def _line(shown: xarray.DataArray, admissible: xarray.DataArray | None, ax: Axes) -> None:
    x, label = _coordinate(shown, shown.dims[0])
    order = np.argsort(x, kind="stable")
    style = "-" if x.size > 60 else "o-"
    y = shown.values[order]
    if admissible is not None and admissible.values.any():
        ax.plot(x[order], y, style, color=PHANTOM, markersize=3.0, linewidth=1.0)
        y = np.where(admissible.values[order], y, np.nan)
        low, high = np.nanmin(y), np.nanmax(y)
        ax.set_ylim(low - 0.3 * (high - low), high + 0.1 * (high - low) or 1.0)
    ax.plot(x[order], y, style, color=ADMISSIBLE, markersize=3.5, linewidth=1.5)
    ax.set_xlabel(label)
    ax.set_ylabel(_label(shown))
    meanings = shown.attrs.get("flag_meanings")
    if meanings is not None:
        ax.set_yticks(range(len(meanings.split())), meanings.split())


def _map(shown: xarray.DataArray, ax: Axes) -> None:
    down, across = shown.dims
    (y, y_label), (x, x_label) = _coordinate(shown, down), _coordinate(shown, across)
    rows, columns = np.argsort(y, kind="stable"), np.argsort(x, kind="stable")
    values = np.ma.masked_invalid(shown.values.astype(np.float64)[np.ix_(rows, columns)])
    ax.set_facecolor(PHANTOM)  # shows where there is no value
    meanings = str(shown.attrs.get("flag_meanings", "")).split()
    if meanings:
        _codes(x[columns], y[rows], values, meanings, ax)
    else:
        scale, colours = _scale(values)
        drawn = ax.pcolormesh(
            x[columns],
            y[rows],
            values,
            shading="nearest",
            cmap=colours,
            norm=scale,
            rasterized=True,
        )
        colorbar(drawn, ax, _label(shown))
    ax.set_xlabel(x_label)
    ax.set_ylabel(y_label)


_PEAK = 20.0
"""Values so many times larger than most are peaks, beside which the others would look alike."""


def _scale(values: Any) -> tuple[Any, str]:
    """Return a colour scale that shows all values, and its map.

    Values of both signs get one that is white at zero. Where poles make few values far larger
    than the others, the scale is logarithmic from the size of most of them on.
    """
    from matplotlib.colors import Normalize, SymLogNorm

    sizes = np.abs(values.compressed())
    top = float(sizes.max(initial=0.0)) or 1.0
    both = bool(values.count()) and values.min() < 0.0 < values.max()
    low = -top if both or (values.count() and values.max() <= 0.0 and values.min() < 0.0) else 0.0
    high = top if both or low == 0.0 else 0.0
    most = float(np.quantile(sizes, 0.9)) if sizes.size else 0.0
    colours = "RdBu_r" if both else "viridis"
    if most > 0.0 and top > _PEAK * most:
        return SymLogNorm(most, vmin=low, vmax=high), colours
    return Normalize(low, high), colours


def _codes(x: Any, y: Any, values: Any, meanings: list[str], ax: Axes) -> None:
    """Plot codes, one colour each, with their meanings beside the colour bar."""
    from matplotlib import colormaps
    from matplotlib.colors import BoundaryNorm, ListedColormap

    bounds = np.arange(len(meanings) + 1) - 0.5
    palette = ListedColormap(colormaps["cividis"](np.linspace(0.05, 0.95, len(meanings))))
    norm = BoundaryNorm(bounds, palette.N)
    drawn = ax.pcolormesh(x, y, values, shading="nearest", cmap=palette, norm=norm)
    bar = colorbar(drawn, ax, "", ticks=range(len(meanings)))
    bar.ax.set_yticklabels([word.replace("_", " ") for word in meanings])
