"""Draws the page of the documentation from the runs that were kept."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from benchmarks import history, registry
from benchmarks.history import Run
from benchmarks.tables import Plot, Table, markdown, written

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DOCS: Final = Path(__file__).parent.parent / "docs"
_COLOURS = ("#0b5394", "#c0392b", "#38761d", "#b45f06", "#674ea7", "#7f7f7f", "#00838f")
_MARKERS = "osD^vPX"

_HEAD = """# Benchmarks

Run time against error, speed against other programs, what plans skip, and how costs grow.

This page is drawn from the results of `vibroimpact bench --save`, which runs everything again,
keeps the results in `benchmarks/results/` and draws the page anew; each section names the
command that makes it alone. Functions that are compared take turns in one run, ratios are
medians over the rounds. *Processor* means time of the processor, which neighbours on a shared
machine lengthen less than that on the clock.
"""


def draw() -> Path:
    """Write ``docs/benchmarks.md`` and its pictures from the newest run of each benchmark."""
    newest = [runs[-1] for one in registry.BENCHMARKS if (runs := history.runs(one.name))]
    folder = DOCS / "images" / "benchmarks"
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()
    parts = [_HEAD, _summary(newest)]
    for run in newest:
        parts.append(_section(run, folder))
    if _draw_history(folder / "history.png"):
        parts.append(_HISTORY)
    page = DOCS / "benchmarks.md"
    page.write_text("\n".join(parts), encoding="utf-8")
    return page


_HISTORY = """## Over time

![Best value over goal in all runs that were kept](images/benchmarks/history.png)

What was measured over its goal, for all runs that were kept; below 1 the goal is reached.
"""


def _summary(runs: Sequence[Run]) -> str:
    reached, missed = 0, []
    for run in runs:
        for table in run.tables:
            for row, verdict in zip(table.rows, table.verdicts(), strict=True):
                reached += verdict == "yes"
                if verdict == "no" and table.goal is not None:
                    value = written(row[table.columns.index(table.goal.measured)])
                    limit = written(row[table.columns.index(table.goal.limit)])
                    what = f"{table.title}, {written(row[0])}: {table.goal.measured} {value}"
                    missed.append(f"- {what} instead of {limit}")
    lines = [f"{reached} of {reached + len(missed)} goals are reached."]
    if missed:
        lines += ["Missed:", "", *missed]
    return "\n".join([*lines, ""])


def _section(run: Run, folder: Path) -> str:
    machine = run.machine
    packages = ", ".join(f"{name} {number}" for name, number in machine["packages"].items())
    lines = [
        f"## {run.name.replace('-', ' ').capitalize()}",
        "",
        f"`vibroimpact bench {run.name} --save`, {run.when}, sources {run.commit}; "
        f"{machine['processor']}, {machine['cores']} cores, {machine['vectors']}, load "
        f"{machine['load']:.1f}; Python {machine['python']}, {packages}.",
        "",
    ]
    for number, table in enumerate(run.tables):
        lines += [f"### {table.title}", "", table.about, "", markdown(table), "", table.note, ""]
        for index, plot in enumerate(table.plots):
            name = f"{run.name}-{number}-{index}.png"
            _draw(table, plot, folder / name)
            lines += [f"![{table.title}](images/benchmarks/{name})", ""]
    return "\n".join(lines)


def _draw(table: Table, plot: Plot, path: Path) -> None:
    from matplotlib import pyplot

    panels = _values(table, plot.panel)
    columns = min(len(panels), 2)
    rows = math.ceil(len(panels) / columns)
    size = (9.0 if columns == 2 else 7.0, 3.6 * rows)
    figure, grid = pyplot.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    for axes in grid.flat[len(panels) :]:
        axes.remove()
    curves = _values(table, plot.by)
    for axes, panel in zip(grid.flat, panels, strict=False):
        for place, curve in enumerate(curves):
            points = sorted(_points(table, plot, panel, curve))
            if points:
                _curve(axes, points, place, curve)
        if "x" in plot.log:
            axes.set_xscale("log")
        if "y" in plot.log:
            axes.set_yscale("log")
        axes.set(xlabel=plot.x, ylabel=plot.y, title=panel or "")
        axes.grid(color="#dddddd", linewidth=0.6)
        axes.title.set_fontsize("medium")
    if plot.by:
        figure.legend(*_legend(grid), loc="outside lower center", ncols=4, fontsize="small")
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def _curve(axes: Axes, points: Sequence[tuple[float, float]], place: int, name: str | None) -> None:
    x, y = zip(*points, strict=True)
    style = _MARKERS[place % len(_MARKERS)] + "-"
    axes.plot(x, y, style, color=_COLOURS[place % len(_COLOURS)], label=name, markersize=5)


def _legend(grid: Any) -> tuple[list[Any], list[str]]:
    handles: dict[str, Any] = {}
    for axes in grid.flat:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(name, handle)
    return list(handles.values()), list(handles)


def _values(table: Table, column: str | None) -> list[str | None]:
    if column is None:
        return [None]
    return list(dict.fromkeys(written(cell) for cell in table.column(column)))


def _points(
    table: Table, plot: Plot, panel: str | None, curve: str | None
) -> Iterator[tuple[float, float]]:
    x, y = table.columns.index(plot.x), table.columns.index(plot.y)
    for row in table.rows:
        here = plot.panel is None or written(row[table.columns.index(plot.panel)]) == panel
        mine = plot.by is None or written(row[table.columns.index(plot.by)]) == curve
        numbers = row[x], row[y]
        if here and mine and all(_is_finite(number) for number in numbers):
            yield float(numbers[0] or 0.0), float(numbers[1] or 0.0)


def _is_finite(cell: object) -> bool:
    return isinstance(cell, int | float) and math.isfinite(cell)


def _draw_history(path: Path) -> bool:
    """Draw what was measured over its goal for all runs; return whether there are several."""
    series: dict[str, list[tuple[str, float]]] = {}
    for one in registry.BENCHMARKS:
        for run in history.runs(one.name):
            for table in run.tables:
                for name, value in _over_goal(table):
                    series.setdefault(name, []).append((run.when, value))
    series = {name: points for name, points in series.items() if len(points) > 1}
    if not series:
        return False
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(9.0, 5.0), layout="constrained")
    dates = sorted({when for points in series.values() for when, _ in points})
    for place, (name, points) in enumerate(series.items()):
        at = [(float(dates.index(when)), value) for when, value in points]
        _curve(axes, at, place, name)
    axes.axhline(1.0, color="black", linewidth=1.0)
    axes.set_yscale("log")
    axes.set_xticks(range(len(dates)), [when[:16].replace("T", "\n") for when in dates])
    axes.set_ylabel("measured over goal")
    axes.grid(color="#dddddd", linewidth=0.6)
    figure.legend(loc="outside lower center", ncols=2, fontsize="x-small")
    figure.savefig(path, dpi=110)
    pyplot.close(figure)
    return True


def _over_goal(table: Table) -> Iterator[tuple[str, float]]:
    if table.goal is None:
        return
    measured, limit = table.column(table.goal.measured), table.column(table.goal.limit)
    for row, value, goal in zip(table.rows, measured, limit, strict=True):
        if value is not None and goal is not None and value > 0:
            over = goal / value if table.goal.at_least else value / goal
            yield f"{table.title}: {written(row[0])}", over
