"""What a benchmark returns: tables of numbers, with goals and how to draw them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeGuard

import numpy as np

Cell = float | int | str | None


@dataclass(frozen=True, slots=True)
class Plot:
    """How a table is drawn: columns by name, those of the axes, of the curves and of the panels."""

    x: str
    y: str
    by: str | None = None
    panel: str | None = None


@dataclass(frozen=True, slots=True)
class Goal:
    """What the numbers of one column should reach, given by another column.

    Rows without a limit have no goal. ``sense`` is a column that says row by row, by "≥" or "≤",
    whether more is better.
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
    since : float
        The least x that counts: below, fixed costs matter.
    at_least : bool
        Whether more is better.
    """

    x: str
    y: str
    limit: float
    by: str | None = None
    only: tuple[str, ...] = ()
    since: float = 0.0
    at_least: bool = False


@dataclass(frozen=True, slots=True)
class Verdict:
    """One goal, what was measured, whether it was reached, and else why not, as far as known.

    The label is unlike all others of its table.
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
        while count < len(self.columns) and len({r[:count] for r in self.rows}) < len(self.rows):
            count += 1
        named = [
            [cell if isinstance(cell, str) else f"{name} {written(cell)}" for name, cell in pairs]
            for pairs in (zip(self.columns, row[:count], strict=False) for row in self.rows)
        ]
        return [", ".join(filter(None, cells)) for cells in named]

    def judged(self) -> list[Verdict | None]:
        """Return for every row whether its goal was reached; None where it has none.

        A row with a goal and no number, or one that is not a number, has missed it.
        """
        verdicts: list[Verdict | None] = []
        for row, label in zip(self.rows, self.labels(), strict=True):
            cells: dict[str, Any] = dict(zip(self.columns, row, strict=True))
            if self.goal is None or cells[self.goal.limit] is None:
                verdicts.append(None)
                continue
            value, limit = (cells[name] for name in (self.goal.measured, self.goal.limit))
            more = self.goal.at_least if self.goal.sense is None else cells[self.goal.sense] == "≥"
            number = math.nan if value is None else float(value)
            verdicts.append(self._verdict(label, self.goal.measured, number, float(limit), more))
        return verdicts

    def grown(self) -> list[Verdict]:
        """Return whether the trends are as they should be."""
        verdicts = []
        for trend in self.trends:
            for curve, points in self.curves(trend.x, trend.y, trend.by).items():
                if trend.only and curve not in trend.only:
                    continue
                value = exponent([p for p in points if p[0] >= trend.since])
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
        for row in self.rows:
            cells = dict(zip(self.columns, row, strict=True))
            points = curves.setdefault("" if by is None else written(cells[by]), [])
            a, b = cells[x], cells[y]
            if is_number(a) and (panel is None or written(cells[panel[0]]) == panel[1]):
                points.append((float(a), float(b) if is_number(b) else math.nan))
        return curves


class Figure(NamedTuple):
    """One number, and what it should be, if anything; its name tells the unit."""

    name: str
    value: float
    limit: float | None = None
    at_least: bool = False


def figures(
    title: str, numbers: Iterable[Figure], note: str = "", reasons: Mapping[str, str] | None = None
) -> Table:
    """Return a table of numbers that have different units."""
    rows: list[tuple[Cell, ...]] = []
    for name, value, limit, at_least in numbers:
        sign = "" if limit is None else "≥" if at_least else "≤"
        rows.append((name, value, sign, limit))
    columns = ("figure", "measured", "", "goal")
    goal = Goal("measured", "goal", sense="")
    return Table(title, columns, rows, note, goal, reasons=reasons or {})


def is_number(cell: object) -> TypeGuard[float]:
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
