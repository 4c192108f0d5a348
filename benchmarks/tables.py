"""What a benchmark returns: tables of numbers, with goals and how to draw them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

Cell = float | int | str | None


@dataclass(frozen=True, slots=True)
class Plot:
    """How a table is drawn: columns by name.

    Parameters
    ----------
    x, y : str
        Columns of the axes.
    by : str, optional
        Column that tells the curves apart.
    panel : str, optional
        Column that tells the panels apart.
    log : str
        Axes that are logarithmic: ``"xy"``, ``"x"``, ``"y"`` or ``""``.
    """

    x: str
    y: str
    by: str | None = None
    panel: str | None = None
    log: str = "xy"


@dataclass(frozen=True, slots=True)
class Goal:
    """What the numbers of one column should reach, given by another column.

    Parameters
    ----------
    measured, limit : str
        Columns; rows without a limit have no goal.
    at_least : bool
        Whether more is better.
    """

    measured: str
    limit: str
    at_least: bool = False

    def reached(self, value: float, limit: float) -> bool:
        """Whether a value is as good as its limit."""
        return value >= limit if self.at_least else value <= limit


@dataclass(frozen=True, slots=True)
class Table:
    """Numbers measured in one run.

    Parameters
    ----------
    title : str
    columns : tuple of str
        Names with units, such as ``"time [us]"``.
    rows : sequence of tuple
        Their cells; None where there is no number.
    note : str
        What must be known to read it: settings, versions, what is counted.
    goal : Goal, optional
    plots : tuple of Plot
    about : str
        What was measured: the docstring of the function that did.
    """

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]
    note: str = ""
    goal: Goal | None = None
    plots: tuple[Plot, ...] = ()
    about: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                message = f"{self.title}: {len(row)} cells in {len(self.columns)} columns: {row}"
                raise ValueError(message)

    def column(self, name: str) -> list[Any]:
        """Return the cells of one column."""
        place = self.columns.index(name)
        return [row[place] for row in self.rows]

    def verdicts(self) -> list[str]:
        """Return for every row whether its goal was reached: yes, no or nothing."""
        if self.goal is None:
            return [""] * len(self.rows)
        pairs = zip(self.column(self.goal.measured), self.column(self.goal.limit), strict=True)
        return [
            ""
            if value is None or limit is None
            else ("yes" if self.goal.reached(value, limit) else "no")
            for value, limit in pairs
        ]

    def document(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return asdict(self)

    @classmethod
    def of(cls, document: dict[str, Any]) -> Table:
        """Return the table of such data."""
        goal = document["goal"]
        return cls(
            document["title"],
            tuple(document["columns"]),
            [tuple(row) for row in document["rows"]],
            document["note"],
            Goal(**goal) if goal else None,
            tuple(Plot(**plot) for plot in document["plots"]),
            document["about"],
        )


def written(cell: Cell) -> str:
    """Return a number with three digits, or the text."""
    if cell is None:
        return "–"
    if isinstance(cell, str):
        return cell
    if isinstance(cell, int):
        return f"{cell:,}".replace(",", " ") if abs(cell) >= 10_000 else str(cell)
    if cell == 0.0 or not math.isfinite(cell):
        return f"{cell:g}"
    return f"{cell:.3g}" if 1e-3 <= abs(cell) < 1e4 else f"{cell:.2e}"


def text(table: Table) -> str:
    """Return a table for the terminal."""
    head = [*table.columns, *(["goal reached"] if table.goal else [])]
    verdicts = table.verdicts()
    body = [
        [*map(written, row), *([verdict] if table.goal else [])]
        for row, verdict in zip(table.rows, verdicts, strict=True)
    ]
    widths = [max(map(len, column)) for column in zip(head, *body, strict=True)]
    lines = [table.title, "=" * len(table.title)]
    lines.append("  ".join(name.rjust(width) for name, width in zip(head, widths, strict=True)))
    lines.append("  ".join("-" * width for width in widths))
    lines += ["  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in body]
    if table.note:
        lines.append(table.note)
    return "\n".join(lines)


def markdown(table: Table) -> str:
    """Return a table for the documentation."""
    head = [*table.columns, *(["goal reached"] if table.goal else [])]
    verdicts = table.verdicts()
    lines = ["| " + " | ".join(head) + " |", "|" + "---:|" * len(head)]
    for row, verdict in zip(table.rows, verdicts, strict=True):
        cells = [*map(written, row), *([verdict] if table.goal else [])]
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines)
