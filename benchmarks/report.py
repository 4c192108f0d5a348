"""Draws the page of the documentation from the runs that were kept."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks import history, registry
from benchmarks.history import Run
from benchmarks.plots import draw as draw_plot
from benchmarks.plots import draw_history
from benchmarks.tables import Table, Verdict, written
from benchmarks.writing import TREND_COLUMNS, grid, markdown, trend_cells

DOCS: Final = Path(__file__).parent.parent / "docs"
_LONG: Final = 12
"""Rows from which a table is folded, as its plot says more at a glance."""

_HEAD = """# Benchmarks

Run time against error, speed against other programs, what plans skip, and how costs grow.
Everything here is drawn from results that `vibroimpact bench --save` keeps in
`benchmarks/results/`; each table names the command that makes it.
"""

_READING = """## How to read it

- Functions that are compared take turns in one run, after a warm-up; times are medians, ratios
  medians over the rounds. *Processor* is time of the processor, which neighbours on a shared
  machine lengthen less than that on the clock.
- Pictures of run time against error are logarithmic both ways; further down and to the left is
  better. A cross at the upper edge has no number, as where impacts were missed.
- Exponents are those of power laws fitted to the points under the broad line: 1 is linear growth.
- Goals were set before; one that is missed stays on this page with what is known about it.
"""

_HISTORY = """## Over time

![What was measured over its goal, in all runs that were kept](images/benchmarks/history.svg)

What was measured over its goal, run after run; below 1 the goal is reached. The worst three of
each benchmark have a name, the others are grey.
"""


def draw() -> Path:
    """Write ``docs/benchmarks.md`` and its pictures from the newest run of each benchmark."""
    newest = {one.name: runs[-1] for one in registry.BENCHMARKS if (runs := history.runs(one.name))}
    folder = DOCS / "images" / "benchmarks"
    folder.mkdir(parents=True, exist_ok=True)
    for old in [*folder.glob("*.png"), *folder.glob("*.svg")]:
        old.unlink()
    parts = [_HEAD, _summary(newest), _missed(newest.values()), _READING]
    parts += [_section(run, folder) for run in newest.values()]
    series = _over_goals(newest)
    if series:
        draw_history(series, folder / "history.svg")
        parts.append(_HISTORY)
    page = DOCS / "benchmarks.md"
    page.write_text("\n".join(part for part in parts if part), encoding="utf-8")
    return page


def title(name: str) -> str:
    """Return the heading of a benchmark."""
    return "HTTP" if name == "http" else name.replace("-", " ").capitalize()


def _anchor(heading: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", heading.lower()).strip("-")


def _verdicts(run: Run) -> list[tuple[Table, Verdict]]:
    return [(table, verdict) for table in run.tables for verdict in table.verdicts()]


def _summary(newest: dict[str, Run]) -> str:
    every = [verdict for run in newest.values() for _, verdict in _verdicts(run)]
    reached = sum(verdict.reached for verdict in every)
    body = []
    for one in registry.BENCHMARKS:
        run = newest.get(one.name)
        if run is None:
            body.append([title(one.name), one.shows, "not run yet", ""])
            continue
        goals = [verdict.reached for _, verdict in _verdicts(run)]
        said = f"{sum(goals)} of {len(goals)}" if goals else "none set"
        if run.failures:
            said += f"; **{_count(run.failures, 'table')} failed**"
        link = f"[{title(one.name)}](#{_anchor(title(one.name))})"
        body.append([link, one.shows, said, _day(run.when)])
    table = grid(["part", "shows", "goals reached", "run"], body, [True, True, True, False])
    return f"**{reached} of {len(every)} goals are reached.**\n\n{table}\n"


def _missed(runs: Any) -> str:
    """Return what was missed: goals of one table that are missed for one reason share a row."""
    groups: dict[tuple[str, str], list[Verdict]] = {}
    for run in runs:
        for table, verdict in _verdicts(run):
            if not verdict.reached:
                where = f"[{table.title}](#{_anchor_of(run, table)})"
                if verdict.quantity != "measured":
                    where += f": {verdict.quantity}"
                groups.setdefault((where, verdict.reason or "not known yet"), []).append(verdict)
    body = [
        [
            f"{where}<br>{reason}",
            _lines(verdict.label for verdict in missed),
            _lines(written(verdict.value) for verdict in missed),
            _lines(
                f"{'≥' if verdict.at_least else '≤'} {written(verdict.limit)}" for verdict in missed
            ),
        ]
        for (where, reason), missed in groups.items()
    ]
    if not body:
        return ""
    columns = ["table, and why", "what", "measured", "goal"]
    return f"## Goals missed\n\n{grid(columns, body, [True] * len(columns))}\n"


def _lines(cells: Iterable[str]) -> str:
    return "<br>".join(cell.replace(" ", "\u00a0") for cell in cells)


def _anchor_of(run: Run, table: Table) -> str:
    return f"{run.name}-{table.part}" if table.part else _anchor(title(run.name))


def _count(things: Sequence[object], name: str) -> str:
    return f"{len(things)} {name}{'' if len(things) == 1 else 's'}"


def _day(when: str) -> str:
    return when[:10]


def _surroundings(run: Run) -> str:
    """Return where, when and with what a benchmark ran."""
    machine = run.machine
    packages = ", ".join(f"{name} {number}" for name, number in machine["packages"].items())
    load = "" if machine["load"] is None else f", load {machine['load']:.1f}"
    changed = " with changes" if run.commit.endswith("+") else ""
    return (
        f"`vibroimpact bench {run.name} --save` · {run.when[:16].replace('T', ' ')} UTC · sources "
        f"{run.commit.rstrip('+')}{changed} · {machine['processor']}, {machine['cores']} cores, "
        f"{machine['vectors']}{load} · {machine['system']} · Python {machine['python']}, {packages}"
        "\n{ .measured }"
    )


def _section(run: Run, folder: Path) -> str:
    shows = next(one.shows for one in registry.BENCHMARKS if one.name == run.name)
    lines = [f"## {title(run.name)}", "", f"{shows[0].upper()}{shows[1:]}.", ""]
    lines += [_surroundings(run), ""]
    for failure in run.failures:
        name = f"{run.name}.{failure.part}" if failure.part else run.name
        lines += [f'!!! failure "`{name}` failed in this run"', "", f"    `{failure.error}`", ""]
    for number, table in enumerate(run.tables):
        lines += _shown(run, table, number, folder)
    return "\n".join(lines)


def _shown(run: Run, table: Table, number: int, folder: Path) -> list[str]:
    """Return one table with its pictures; long ones folded under them."""
    anchor = f" {{ #{_anchor_of(run, table)} }}" if table.part else ""
    lines = [f"### {table.title}{anchor}", "", table.about, ""]
    if table.part:
        took = f"`vibroimpact bench {run.name}.{table.part}` · {table.seconds:.0f} s"
        lines += [took, "{ .measured }", ""]
    for index, plot in enumerate(table.plots):
        name = f"{run.name}-{table.part or number}-{index}.svg"
        draw_plot(table, plot, folder / name)
        lines += [f"![{table.title}: {plot.y} against {plot.x}](images/benchmarks/{name})", ""]
    numbers = markdown(table)
    if len(table.rows) > _LONG and table.plots:
        lines += [f'??? note "All {len(table.rows)} rows"', "", textwrap.indent(numbers, "    ")]
    else:
        lines.append(numbers)
    grown = table.grown()
    if grown:
        cells = [trend_cells(verdict) for verdict in grown]
        lines += ["", grid(TREND_COLUMNS, cells, [True, False, False, True])]
    return [*lines, "", table.note, ""]


def _over_goals(newest: dict[str, Run]) -> dict[str, dict[str, list[tuple[float, float]]]]:
    """Return what was measured over its goal, run after run, of what was measured repeatedly."""
    panels = {}
    for name in newest:
        series: dict[str, list[tuple[float, float]]] = {}
        for place, run in enumerate(history.runs(name), 1):
            for table, verdict in _verdicts(run):
                if math.isfinite(verdict.over):
                    what = f"{verdict.label}, {verdict.quantity} ({table.title})"
                    series.setdefault(what, []).append((float(place), verdict.over))
        several = {what: points for what, points in series.items() if len(points) > 1}
        if several:
            panels[title(name)] = several
    return panels
