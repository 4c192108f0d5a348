"""Draws tables, as vector graphics whose ink follows the reader's light or dark mode."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from benchmarks.tables import Plot, Table, Trend, exponent, written

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Points = Sequence[tuple[float, float]]

_INK, _GRID, _FAINT = "#1a1b1c", "#d9dadb", "#8a8b8c"
_MODES: Final = f"""<style>
:root {{ --ink: {_INK}; --grid: {_GRID}; --faint: #6b6c6d; }}
@media (prefers-color-scheme: dark) {{
  :root {{ --ink: #e8e9ea; --grid: #484a54; --faint: #a5a6a8; }}
}}
</style>"""
# Okabe and Ito: distinct with every kind of colour vision, and readable in both modes.
_COLOURS: Final = ("#d55e00", "#0083c9", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c7ae6")
_PEERS: Final = ("heyoka", "DOP853", "LSODA", "CVODE", "diffrax", "Siconos", "numpy", "mpmath")
"""Other programs, which have the same colour on all pictures."""
_MARKERS: Final = "osD^vPX<>"
_LINES: Final = ("-", "--", ":", "-.")
_STYLE: Final[dict[Any, Any]] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "vibroimpact",
    "font.family": "sans-serif",
    "font.size": 11.0,
    "axes.titlesize": 11.0,
    "axes.labelsize": 11.0,
    "legend.fontsize": 10.0,
    "text.color": _INK,
    "axes.edgecolor": _INK,
    "axes.labelcolor": _INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": _INK,
    "ytick.color": _INK,
    "grid.color": _GRID,
    "grid.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "legend.frameon": False,
}


def draw(table: Table, plot: Plot, path: Path) -> None:
    """Write the picture of a table."""
    panels = [None] if plot.panel is None else _values(table.column(plot.panel))
    styles = _styles(table, plot)
    with _figure(len(panels), path) as (figure, every_axes):
        for axes, panel in zip(every_axes, panels, strict=True):
            where = None if plot.panel is None or panel is None else (plot.panel, panel)
            for name, points in table.curves(plot.x, plot.y, plot.by, where).items():
                if points:
                    trend = _trend(table, plot, name)
                    _curve(axes, points, styles[name], name, trend)
            axes.set(xlabel=plot.x, ylabel=_named(plot.y), title=panel or "")
            axes.loglog()
            _widen(axes)
        if plot.by or any(_trend(table, plot, name) for name in styles):
            _legend(figure, every_axes)


def _widen(axes: Axes) -> None:
    """Give logarithmic axes room for two powers of ten: their labels would overlap otherwise."""
    for axis in (axes.xaxis, axes.yaxis):
        low, high = axis.get_view_interval()
        if high < 100.0 * low:
            middle = math.sqrt(low * high)
            axis.set_view_interval(0.1 * middle, 10.0 * middle, ignore=True)


def _named(column: str) -> str:
    return f"{column} (less is better)" if "error" in column else column


def _values(cells: Iterable[Any]) -> list[str]:
    return list(dict.fromkeys(map(written, cells)))


@contextmanager
def _figure(count: int, path: Path) -> Iterator[tuple[Figure, list[Axes]]]:
    """Give a figure with so many panels and write it to a file."""
    import matplotlib
    from matplotlib.figure import Figure

    columns = min(count, 2)
    rows = math.ceil(count / columns)
    with matplotlib.rc_context(_STYLE):
        size = (9.6, (3.7 if columns == 2 else 4.4) * rows + 0.5)
        figure = Figure(figsize=size, layout="constrained")
        every_axes = [figure.add_subplot(rows, columns, place + 1) for place in range(count)]
        yield figure, every_axes
        text = io.StringIO()
        figure.savefig(text, format="svg", transparent=True, metadata={"Date": None})
    drawn = text.getvalue()
    for colour, name in ((_INK, "ink"), (_GRID, "grid"), (_FAINT, "faint")):
        drawn = drawn.replace(colour, f"var(--{name})")
    head, tag, rest = drawn.partition("<defs>")
    lines = (line.rstrip() for line in f"{head}{_MODES}\n{tag}{rest}".splitlines())
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _styles(table: Table, plot: Plot) -> dict[str, dict[str, Any]]:
    """Return how each curve looks: ours in thick ink, peers always in the same colour."""
    names = [""] if plot.by is None else _values(table.column(plot.by))
    taken = {_COLOURS[_peer(name) % len(_COLOURS)] for name in names if _peer(name) >= 0}
    free = itertools.cycle([colour for colour in _COLOURS if colour not in taken] or _COLOURS)
    used: dict[str, int] = {}
    styles: dict[str, dict[str, Any]] = {}
    for place, name in enumerate(names):
        ours = bool(name) and name.startswith("Vibroimpact")
        peer = _peer(name)
        colour = _INK if ours else _COLOURS[peer % len(_COLOURS)] if peer >= 0 else next(free)
        turn = used[colour] = used.get(colour, -1) + 1
        styles[name] = {
            "color": colour,
            "linestyle": _LINES[turn % len(_LINES)],
            "linewidth": 2.4 if ours else 1.4,
            "marker": "*" if ours and turn == 0 else _MARKERS[place % len(_MARKERS)],
            "markersize": 11 if ours and turn == 0 else 5.5,
            "zorder": 3 if ours else 2,
        }
    return styles


def _peer(name: str) -> int:
    return next((place for place, peer in enumerate(_PEERS) if peer in name), -1)


def _trend(table: Table, plot: Plot, name: str) -> Trend | None:
    for trend in table.trends:
        same = (trend.x, trend.y, trend.by) == (plot.x, plot.y, plot.by)
        if same and (not trend.only or name in trend.only):
            return trend
    return None


def _curve(
    axes: Axes, points: Points, style: Mapping[str, Any], name: str, trend: Trend | None
) -> None:
    """Draw one curve, crosses at the top where there is no number, and its power law."""
    label = name
    if trend is not None:
        fitted = [p for p in points if p[0] >= trend.since and p[1] > 0.0]
        power = exponent(fitted)
        label = f"{name}: exponent {power:.2f}" if name else f"exponent {power:.2f}"
        if math.isfinite(power):
            middle = sum(math.log(y) - power * math.log(x) for x, y in fitted) / len(fitted)
            x = [min(fitted)[0], max(fitted)[0]]
            line = [math.exp(middle) * each**power for each in x]
            axes.plot(x, line, color=style["color"], linewidth=5.0, alpha=0.25, zorder=1)
    there = [point for point in points if math.isfinite(point[1])]
    axes.plot([x for x, _ in there], [y for _, y in there], label=label, **style)
    gone = [x for x, y in points if not math.isfinite(y)]
    if gone:
        top = [0.98] * len(gone)
        place = axes.get_xaxis_transform()
        look: dict[str, Any] = {"marker": "x", "linestyle": "none", "markersize": 7}
        axes.plot(gone, top, color=style["color"], transform=place, clip_on=False, **look)
        axes.plot([], [], color=_FAINT, label="no number", **look)


def _legend(figure: Figure, every_axes: Sequence[Axes]) -> None:
    handles: dict[str, Any] = {}
    for axes in every_axes:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(name, handle)
    widest = max(map(len, handles), default=1)
    width = figure.get_size_inches()[0] * 9.0  # letters in a line
    columns = max(1, min(len(handles), int(width / (widest + 6))))
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=columns)
