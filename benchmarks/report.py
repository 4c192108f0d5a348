"""Draws the pages of the documentation from the stored results."""

from __future__ import annotations

import shutil
import statistics
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from benchmarks import registry, results
from benchmarks.plots import draw as draw_plot
from benchmarks.registry import Benchmark
from benchmarks.results import Measurement
from benchmarks.tables import Table, Verdict, written
from benchmarks.writing import TREND_COLUMNS, grid, markdown, sign, trend_cells

DOCS: Final = Path(__file__).parent.parent / "docs"
_IMAGES: Final = "images/benchmarks"
_LONG: Final = 12
"""Rows from which a table is folded, as its plot says more at a glance."""
_WIDE: Final = 10
"""Columns above which a table needs the room of the table of contents."""
_LEVEL: Final = 1e-9
"""The error at which the first page compares."""
_SHOWN: Final = ("B: chain N=13, elastic, 10 periods", "D: two driven masses, three walls, k=0.7")
"""The time histories that the first page plots."""

_READING = """## How to read the pages

- Functions that are compared take turns in one run, after a warm-up; times are medians, ratios
  are medians over the rounds. *Processor* is processor time, which other users of a shared
  machine disturb less than time on the clock.
- Plots of error against time are logarithmic both ways; further down and to the left is
  better. A cross at the upper edge stands for no number, as where impacts were missed.
- Exponents are those of power laws fitted to the points under the broad line: 1 is linear growth.
- Goals were set beforehand; a missed one stays on its page with what is known about the cause.
- Everything is drawn from the results that `vibroimpact bench --save` stores in
  `benchmarks/results/`; each table names the command that measures it.
"""


def draw() -> Path:
    """Write ``docs/benchmarks.md``, a page for each benchmark and the plots; return the first."""
    pages, images = DOCS / "benchmarks", DOCS / _IMAGES
    for folder in (pages, images):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
    measured = {
        one.name: [each for part in one.parts if (each := results.load(one.name, part.name))]
        for one in registry.BENCHMARKS
    }
    for one in registry.BENCHMARKS:
        if measured[one.name]:
            page = _page(one, measured[one.name])
            (pages / f"{one.name}.md").write_text(page, encoding="utf-8")
    parts = ["# Benchmarks\n", _first_screen(measured), _details(measured), _READING]
    first = DOCS / "benchmarks.md"
    first.write_text("\n".join(part for part in parts if part), encoding="utf-8")
    return first


def _tables(measurements: Iterable[Measurement]) -> dict[str, Table]:
    return {one.part: one.table for one in measurements if one.table is not None}


def _verdicts(measurements: Iterable[Measurement]) -> list[tuple[str, Table, Verdict]]:
    return [
        (part, table, verdict)
        for part, table in _tables(measurements).items()
        for verdict in table.verdicts()
    ]


def _first_screen(measured: dict[str, list[Measurement]]) -> str:
    """Return what users get by default, and how fast that is against what, at which error."""
    defaults = _tables(measured["defaults"]).values()
    link = "see [default requests](benchmarks/defaults.md)"
    parts = [f"{table.title}, {link}:\n\n{markdown(table)}\n" for table in defaults]
    ahead = _tables(measured["peers"]).get("ahead")
    if ahead is not None:
        parts.append(_against_peers(ahead))
    table = _tables(measured["error-against-time"]).get("time_histories")
    if table is not None:
        rows = [row for row in table.rows if row[0] in _SHOWN]
        draw_plot(replace(table, rows=rows), table.plots[0], DOCS / _IMAGES / "first.svg")
        parts.append(f"![Error against time of two time histories]({_IMAGES}/first.svg)\n")
    return "\n".join(parts)


def _against_peers(ahead: Table) -> str:
    """Return the ratios at one level of error, as sentences and as a table."""
    prepared, nothing = "both prepared, times faster", "both from nothing, times faster"
    mixed = "whole call over prepared peer, times faster"
    rows: list[dict[str, Any]] = [dict(zip(ahead.columns, r, strict=True)) for r in ahead.rows]
    compared = [row for row in rows if row[prepared] is not None]
    level = [row for row in compared if row["error at most"] == f"{_LEVEL:.0e}"]
    behind = sum(row[prepared] < 1.0 for row in compared)

    def between(name: str) -> str:
        low, *_, high = ratios = sorted(row[name] for row in level)
        middle = statistics.median(ratios)
        return f"{written(low)} to {written(high)} times as fast (median {written(middle)})"

    sentences = (
        f"At an error of at most 1e-9, with no impact missed, a prepared time history "
        f"is **{between(prepared)}** as the fastest of heyoka, CVODE of SUNDIALS, diffrax, scipy "
        f"and Siconos, on {len(level)} motions. From nothing, with planning, preparing or "
        f"compiling, and for Vibroimpact estimates of all errors, it is **{between(nothing)}**. "
        f"From 1e-3 to the smallest error reached, another program is faster in {behind} of "
        f"{len(compared)} comparisons of prepared programs. A program compiled beforehand can also "
        f"be faster than a whole call of Vibroimpact: see the last column."
    )
    columns = {
        "motion": "case",
        "fastest other program": "fastest peer",
        "its time [ms]": "its time [ms]",
        "Vibroimpact, prepared [ms]": "prepared [ms]",
        "times faster, prepared": prepared,
        "times faster, from nothing": nothing,
        "times faster, whole call against prepared program": mixed,
    }
    body = [[written(row[column]) for column in columns.values()] for row in level]
    words = [column in ("motion", "fastest other program") for column in columns]
    return f"{sentences}\n\n{grid(list(columns), body, words)}\n"


def _details(measured: dict[str, list[Measurement]]) -> str:
    """Return the list of the other pages, with the goals reached and missed."""
    body, every = [], list[bool]()
    for one in registry.BENCHMARKS:
        measurements = measured[one.name]
        if not measurements:
            body.append([one.title, one.shows, "not run yet", ""])
            continue
        goals = [verdict.reached for *_, verdict in _verdicts(measurements)]
        every += goals
        said = f"{sum(goals)} of {len(goals)}" if goals else "none set"
        failed = [measurement.part for measurement in measurements if measurement.failure]
        if failed:
            said += f"; **failed: {', '.join(failed)}**"
        link = f"[{one.title}](benchmarks/{one.name}.md)"
        body.append([link, one.shows, said, max(one.when for one in measurements)[:10]])
    pages = grid(["page", "shows", "goals reached", "newest run"], body, [True] * 3 + [False])
    missed = len(every) - sum(every)
    return (
        f"## Details\n\n**{sum(every)} of {len(every)} goals are reached.** The other {missed} "
        f"are listed on the pages that they concern.\n\n{pages}\n"
    )


def _page(benchmark: Benchmark, measurements: Sequence[Measurement]) -> str:
    wide = any(len(table.columns) > _WIDE for table in _tables(measurements).values())
    lines = ["---", "hide: [toc]", "---", ""] if wide else []
    lines += [f"# {benchmark.title}", ""]
    lines += [f"{benchmark.shows[0].upper()}{benchmark.shows[1:]}.", ""]
    lines += [_missed(measurements), *dict.fromkeys(map(_machine, measurements))]
    for one in measurements:
        lines += _section(one)
    return "\n".join(lines)


def _missed(measurements: Sequence[Measurement]) -> str:
    """Return what was missed: goals of one table that are missed for one reason share a row."""
    verdicts = _verdicts(measurements)
    groups: dict[str, list[Verdict]] = {}
    for part, table, verdict in verdicts:
        if not verdict.reached:
            what = "" if verdict.quantity == "measured" else f": {verdict.quantity}"
            why = verdict.reason or "not known yet"
            groups.setdefault(f"[{table.title}](#{part}){what}<br>{why}", []).append(verdict)
    if not verdicts:
        return ""
    reached = sum(verdict.reached for *_, verdict in verdicts)
    said = f"**{reached} of {len(verdicts)} goals are reached.**\n"
    body = [
        [
            where,
            _lines(verdict.label for verdict in missed),
            _lines(written(verdict.value) for verdict in missed),
            _lines(f"{sign(verdict)} {written(verdict.limit)}" for verdict in missed),
        ]
        for where, missed in groups.items()
    ]
    if not body:
        return said
    columns = ["table, and why", "what", "measured", "goal"]
    return f"{said}\n## Goals missed\n\n{grid(columns, body, [True] * len(columns))}\n"


def _lines(cells: Iterable[str]) -> str:
    return "<br>".join(cell.replace(" ", "\u00a0") for cell in cells)


def _machine(one: Measurement) -> str:
    """Return where and with what a table was measured."""
    machine = one.machine
    packages = ", ".join(f"{name} {number}" for name, number in machine["packages"].items())
    return (
        f"Measured on {machine['processor']}, {machine['cores']} cores, {machine['vectors']} · "
        f"{machine['system']} · Python {machine['python']}, {packages}\n{{ .measured }}\n"
    )


def _section(one: Measurement) -> list[str]:
    """Return one table with its plots; long ones folded under them."""
    label = f"{one.benchmark}.{one.part}"
    table = one.table
    if table is None:
        return [f'!!! failure "`{label}` failed"', "", f"    `{one.failure}`", ""]
    load = "" if one.machine["load"] is None else f" · load {one.machine['load']:.1f}"
    changed = " with changes" if one.commit.endswith("+") else ""
    lines = [
        f"## {table.title} {{ #{one.part} }}",
        "",
        table.about,
        "",
        f"`vibroimpact bench {label}` · {table.seconds:.0f} s · {one.when[:16].replace('T', ' ')} "
        f"UTC · sources {one.commit.rstrip('+')}{changed}{load}",
        "{ .measured }",
        "",
    ]
    for index, plot in enumerate(table.plots):
        name = f"{one.benchmark}-{one.part}-{index}.svg"
        draw_plot(table, plot, DOCS / _IMAGES / name)
        lines += [f"![{table.title}: {plot.y} against {plot.x}](../{_IMAGES}/{name})", ""]
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
