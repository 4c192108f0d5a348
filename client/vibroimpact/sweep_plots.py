"""Pictures of sweeps: lines over one axis, a map over two."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vibroimpact.plots import PHANTOM, REAL, axes_or_new

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

    from vibroimpact.results import Result


def draw(
    result: Result,
    output: str | None = None,
    at: Mapping[str, float] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw an output of a sweep over the one or two dimensions that are left.

    Where `exists` was computed too, what belongs to phantoms is left grey.

    Parameters
    ----------
    result : Result
        Of a sweep.
    output : str, optional
        Absent: the first that was computed.
    at : mapping, optional
        Dimension -> where to stand on it; the nearest value is taken. Dimensions of one value
        need not be named.
    ax : Axes, optional
        Where to draw; absent: a new figure.

    Raises
    ------
    ValueError
        Where other than one or two dimensions are left.
    """
    data = result.to_xarray()
    chosen = output or _first(data)
    shown = _selected(data[chosen], at or {})
    real = _real(data, chosen, at or {})
    if shown.ndim not in (1, 2):
        left = ", ".join(str(dim) for dim in shown.dims) or "none"
        raise ValueError(f"one or two dimensions can be drawn; left are: {left}. Name some in at")
    target = axes_or_new(ax)
    if shown.ndim == 1:
        _line(shown, real, target)
    else:
        _map(shown if real is None else shown.where(real), target)
    fixed = [f"{name} = {float(shown[name]):.4g}" for name in at or {} if name in shown.coords]
    target.set_title(", ".join(fixed), fontsize="medium")
    return target


def _first(data: xarray.Dataset) -> str:
    """Return the first variable that is a computed quantity."""
    plain = [str(name) for name in data.data_vars if name != "status"]
    return next((name for name in ("impulse", *plain) if name in plain), "status")


def _real(data: xarray.Dataset, output: str, at: Mapping[str, float]) -> xarray.DataArray | None:
    """Return where the members drawn are motions, None where that is not known."""
    if "exists" not in data or "flag_meanings" in data[output].attrs:
        return None
    dims = data["exists"].dims
    if not set(dims) <= set(data[output].dims):
        return None
    return _selected(data["exists"] == 1, {dim: v for dim, v in at.items() if dim in dims})


def _selected(shown: xarray.DataArray, at: Mapping[str, float]) -> xarray.DataArray:
    for dim, value in at.items():
        # Dimensions without values of their own are counted.
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


def _line(shown: xarray.DataArray, real: xarray.DataArray | None, ax: Axes) -> None:
    x, label = _coordinate(shown, shown.dims[0])
    order = np.argsort(x, kind="stable")
    style = "-" if x.size > 60 else "o-"
    y = shown.values[order]
    if real is not None and real.values.any():
        ax.plot(x[order], y, style, color=PHANTOM, markersize=3.0, linewidth=1.0)
        y = np.where(real.values[order], y, np.nan)
        low, high = np.nanmin(y), np.nanmax(y)
        ax.set_ylim(low - 0.3 * (high - low), high + 0.1 * (high - low) or 1.0)
    ax.plot(x[order], y, style, color=REAL, markersize=3.5, linewidth=1.5)
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
    ax.set_facecolor(PHANTOM)  # seen where there is no value
    meanings = str(shown.attrs.get("flag_meanings", "")).split()
    if meanings:
        _codes(x[columns], y[rows], values, meanings, ax)
    else:
        top = float(np.quantile(np.abs(values.compressed()), 0.98)) if values.count() else 1.0
        low, high, colours = _range(values, top or 1.0)
        drawn = ax.pcolormesh(
            x[columns], y[rows], values, shading="nearest", cmap=colours, vmin=low, vmax=high
        )
        ax.figure.colorbar(drawn, ax=ax, label=_label(shown), extend="both")
    ax.set_xlabel(x_label)
    ax.set_ylabel(y_label)


def _range(values: Any, top: float) -> tuple[float, float, str]:
    """Return the ends of the scale and its colours: white is zero where both signs are there."""
    if not values.count() or values.min() >= 0:
        return 0.0, top, "viridis"
    if values.max() <= 0:
        return -top, 0.0, "viridis"
    return -top, top, "RdBu_r"


def _codes(x: Any, y: Any, values: Any, meanings: list[str], ax: Axes) -> None:
    """Draw codes, each in its colour, with what they mean beside."""
    from matplotlib import colormaps
    from matplotlib.colors import BoundaryNorm, ListedColormap

    bounds = np.arange(len(meanings) + 1) - 0.5
    palette = ListedColormap(colormaps["Set2"].colors[: len(meanings)])  # type: ignore[attr-defined]
    norm = BoundaryNorm(bounds, palette.N)
    drawn = ax.pcolormesh(x, y, values, shading="nearest", cmap=palette, norm=norm)
    bar = ax.figure.colorbar(drawn, ax=ax, ticks=range(len(meanings)))
    bar.ax.set_yticklabels(meanings)
