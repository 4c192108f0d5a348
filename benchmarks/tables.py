"""What a benchmark returns: tables of numbers, with goals and how to draw them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

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
    ours : str
        How the names of those curves begin that stand out before all others.
    """

    x: str
    y: str
    by: str | None = None
    panel: str | None = None
    log: str = "xy"
    ours: str = "Vibroimpact"


@dataclass(frozen=True, slots=True)
class Goal:
    """What the numbers of one column should reach, given by another column.

    Parameters
    ----------
    measured, limit : str
        Columns; rows without a limit have no goal.
    at_least : bool
        Whether more is better.
    sense : str, optional
        Column that says so row by row, "≥" or "≤".
    """

    measured: str
    limit: str
    at_least: bool = False
    sense: str | None = None


@dataclass(frozen=True, slots=True)
class Trend:
    """How a column should grow with another: the exponent of a power law fitted to both.

    Parameters
    ----------
    x, y : str
        Columns.
    limit : float
        What the exponent should be at most, or at least.
    by : str, optional
        Column that tells the curves apart; each is fitted alone.
    only : tuple of str, optional
        The curves that are meant; all where it is empty.
    since, until : float
        Range of x that counts: fixed costs and what limits are left out.
    at_least : bool
        Whether more is better.
    """

    x: str
    y: str
    limit: float
    by: str | None = None
    only: tuple[str, ...] = ()
    since: float = 0.0
    until: float = math.inf
    at_least: bool = False


@dataclass(frozen=True, slots=True)
class Verdict:
    """One goal, what was measured, and whether it was reached.

    Parameters
    ----------
    label : str
        What it is about: unlike all others of its table.
    quantity : str
        What was measured.
    value, limit : float
    at_least : bool
        Whether more is better.
    reached : bool
    reason : str
        Why it is missed, as far as known.
    """

    label: str
    quantity: str
    value: float
    limit: float
    at_least: bool
    reached: bool
    reason: str = ""


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
    trends : tuple of Trend
    reasons : mapping
        Why goals are missed, as far as known: by the label of the row, see `labels`, or of the
        trend; the one of the empty label holds for all others.
    seconds : float
        How long that took.
    """

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]
    note: str = ""
    goal: Goal | None = None
    plots: tuple[Plot, ...] = ()
    about: str = ""
    trends: tuple[Trend, ...] = ()
    reasons: Mapping[str, str] = field(default_factory=dict)
    seconds: float = 0.0

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                message = f"{self.title}: {len(row)} cells in {len(self.columns)} columns: {row}"
                raise ValueError(message)

    def column(self, name: str) -> list[Any]:
        """Return the cells of one column."""
        place = self.columns.index(name)
        return [row[place] for row in self.rows]

    def labels(self) -> list[str]:
        """Return a name for each row: as many of its first cells as tell the rows apart."""
        count = 1
        while count < len(self.columns) and len({row[:count] for row in self.rows}) < len(
            self.rows
        ):
            count += 1
        named = [
            [cell if isinstance(cell, str) else f"{name} {written(cell)}" for name, cell in pairs]
            for pairs in (zip(self.columns, row[:count], strict=False) for row in self.rows)
        ]
        return [", ".join(cell for cell in cells if cell) for cells in named]

    def judged(self) -> list[Verdict | None]:
        """Return for every row whether its goal was reached; None where it has none.

        A row with a goal and no number, or one that is not a number, has missed it.
        """
        if self.goal is None:
            return [None] * len(self.rows)
        measured, limits = self.column(self.goal.measured), self.column(self.goal.limit)
        least = (
            [self.goal.at_least] * len(self.rows)
            if self.goal.sense is None
            else [sign == "≥" for sign in self.column(self.goal.sense)]
        )
        return [
            None
            if limit is None
            else self._verdict(
                label,
                self.goal.measured,
                math.nan if value is None else float(value),
                float(limit),
                more,
            )
            for label, value, limit, more in zip(
                self.labels(), measured, limits, least, strict=True
            )
        ]

    def grown(self) -> list[Verdict]:
        """Return whether the trends are as they should be."""
        verdicts = []
        for trend in self.trends:
            for curve, points in self.curves(trend.x, trend.y, trend.by).items():
                if trend.only and curve not in trend.only:
                    continue
                value = exponent([p for p in points if trend.since <= p[0] <= trend.until])
                label = f"{curve}: {trend.y}" if curve else trend.y
                quantity = f"exponent of {trend.x}"
                verdicts.append(self._verdict(label, quantity, value, trend.limit, trend.at_least))
        return verdicts

    def verdicts(self) -> Iterator[Verdict]:
        """Yield all goals, of rows and of trends."""
        yield from (verdict for verdict in self.judged() if verdict is not None)
        yield from self.grown()

    def _verdict(
        self, label: str, quantity: str, value: float, limit: float, at_least: bool
    ) -> Verdict:
        reached = value >= limit if at_least else value <= limit
        reason = "" if reached else self.reasons.get(label, self.reasons.get("", ""))
        return Verdict(label, quantity, value, limit, at_least, reached, reason)

    def curves(
        self, x: str, y: str, by: str | None = None, panel: tuple[str, str] | None = None
    ) -> dict[str, list[tuple[float, float]]]:
        """Return points by the names of their curves, in the order of the table.

        Parameters
        ----------
        x, y : str
            Columns; rows without a finite x are left out, and y may be no number.
        by : str, optional
            Column with the names of the curves; without it the only one has an empty name.
        panel : tuple of str, optional
            A column and the text that it must have.
        """
        curves: dict[str, list[tuple[float, float]]] = {}
        names = [""] * len(self.rows) if by is None else list(map(written, self.column(by)))
        panels = (
            [""] * len(self.rows) if panel is None else list(map(written, self.column(panel[0])))
        )
        for name, where, a, b in zip(names, panels, self.column(x), self.column(y), strict=True):
            points = curves.setdefault(name, [])
            if (panel is None or where == panel[1]) and is_number(a):
                points.append((float(a), float(b) if is_number(b) else math.nan))
        return curves

    def document(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return asdict(self)

    @classmethod
    def of(cls, document: dict[str, Any]) -> Table:
        """Return the table of such data."""
        return cls(
            **document
            | {
                "columns": tuple(document["columns"]),
                "rows": [tuple(row) for row in document["rows"]],
                "goal": Goal(**document["goal"]) if document["goal"] else None,
                "plots": tuple(Plot(**plot) for plot in document["plots"]),
                "trends": tuple(
                    Trend(**trend | {"only": tuple(trend["only"])}) for trend in document["trends"]
                ),
            }
        )


@dataclass(frozen=True, slots=True)
class Figure:
    """One number, and what it should be, if anything.

    Parameters
    ----------
    name : str
        With its unit.
    value : float
    limit : float, optional
    at_least : bool
        Whether more is better.
    """

    name: str
    value: float
    limit: float | None = None
    at_least: bool = False


def figures(
    title: str, numbers: Iterable[Figure], note: str = "", reasons: Mapping[str, str] | None = None
) -> Table:
    """Return a table of numbers that have different units."""
    rows: list[tuple[Cell, ...]] = [
        (
            each.name,
            each.value,
            "" if each.limit is None else "≥" if each.at_least else "≤",
            each.limit,
        )
        for each in numbers
    ]
    columns = ("figure", "measured", "", "goal")
    goal = Goal("measured", "goal", sense="")
    return Table(title, columns, rows, note, goal, reasons=reasons or {})


def is_number(cell: object) -> bool:
    """Whether a cell holds a finite number."""
    return isinstance(cell, int | float) and math.isfinite(cell)


def exponent(points: Sequence[tuple[float, float]]) -> float:
    """Return a of the power law y = c x^a that fits best, by logarithms; nan without two x."""
    positive = [(x, y) for x, y in points if x > 0.0 and y > 0.0]
    if len({x for x, _ in positive}) < 2:
        return math.nan
    x, y = np.log(np.array(positive)).T
    x = x - x.mean()
    return float(x @ y / (x @ x))


def written(cell: Cell) -> str:
    """Return a number with three digits, or the text."""
    if cell is None:
        return "–"
    if isinstance(cell, str):
        return cell
    if isinstance(cell, int):
        return _grouped(cell)
    if math.isnan(cell):
        return "–"
    if cell == 0.0 or not math.isfinite(cell):
        return f"{cell:g}"
    rounded = float(f"{cell:.3g}")
    if 1e3 <= abs(rounded) < 1e6:
        return _grouped(rounded)
    return f"{cell:.3g}" if 1e-3 <= abs(rounded) < 1e3 else f"{cell:.2e}"


def _grouped(number: float) -> str:
    digits = f"{number:,.0f}"
    return digits.replace(",", "\u202f") if abs(number) >= 10_000 else digits.replace(",", "")
