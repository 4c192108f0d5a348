"""Tables of a result: columns by name, read from a group of its file."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from vibroimpact.parts import Dataset, Group

if TYPE_CHECKING:
    import h5py

Array = np.ndarray[Any, Any]

_SHOWN_ROWS = 20


class Table(Mapping[str, Any]):
    """Columns of equal length, or single numbers: ``impacts["time"]``, ``impacts.time``."""

    PARTS: ClassVar[Mapping[str, type[Table]]] = {}
    """Name of a table within -> its class."""

    def __init__(self, columns: dict[str, Any]) -> None:
        self._columns = columns

    @classmethod
    def of(cls, group: h5py.Group | Group) -> Self:
        """Read a group of a file."""
        columns = {
            k: cls.PARTS.get(k, Table).of(v) if is_group(v) else decoded(v)
            for k, v in group.items()
        }
        numbers = {k: single(v) for k, v in group.attrs.items() if not k.startswith("_")}
        return cls({**columns, **numbers})

    def __getitem__(self, name: str) -> Any:
        """Return a column."""
        return self._columns[name]

    def __getattr__(self, name: str) -> Any:
        """Return a column."""
        columns: dict[str, Any] = self.__dict__.get("_columns", {})
        if name in columns:
            return columns[name]
        raise AttributeError(f"the table has no {name!r}; it has {', '.join(columns)}")

    def part(self, start: int, stop: int) -> Self:
        """Return some of the rows."""
        return type(self)({name: column[start:stop] for name, column in self._columns.items()})

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(self._columns)

    def __len__(self) -> int:
        """Return how many columns there are."""
        return len(self._columns)

    @property
    def rows(self) -> int | None:
        """How many rows there are; None of single numbers and of arrays that are no columns."""
        shapes = [c.shape for c in self._columns.values() if isinstance(c, np.ndarray)]
        lengths = {shape[0] for shape in shapes if shape}
        plain = any(len(shape) == 1 for shape in shapes)
        return int(lengths.pop()) if plain and len(lengths) == 1 else None

    def __repr__(self) -> str:
        """Return names and sizes."""
        size = "" if self.rows is None else f" ({self.rows} rows)"
        return f"<Table{size} {', '.join(self._columns)}>"

    def _repr_html_(self) -> str:
        """Return the first rows, or names and numbers."""
        if self.rows is None:
            values = [
                [name, str(value.shape) if isinstance(value, np.ndarray) else str(value)]
                for name, value in self._columns.items()
            ]
            return html_table(["name", "value or size"], values)
        columns = {k: v for k, v in self._columns.items() if isinstance(v, np.ndarray)}
        count = min(self.rows, _SHOWN_ROWS)
        shown = [[_cell(column[row]) for column in columns.values()] for row in range(count)]
        left = f"<p>… and {self.rows - count} more rows</p>" if self.rows > count else ""
        return html_table(list(columns), shown) + left


def html_table(head: list[str], rows: list[list[str]]) -> str:
    """Return a table; the first column is names, the others are text."""
    top = "".join(f"<th>{html.escape(name)}</th>" for name in head)
    body = "".join(
        "<tr>"
        + "".join(f"<td style='text-align:left'>{html.escape(c)}</td>" for c in row)
        + "</tr>"
        for row in rows
    )
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


def is_group(item: Any) -> bool:
    """Return whether a part of a file is a group, and not a dataset."""
    return isinstance(item, Mapping)


def is_group_of(group: h5py.Group | Group, name: str) -> bool:
    """Return whether a part of a group is a group as well, without opening it."""
    if isinstance(group, Group):
        return isinstance(group[name], Group)
    return issubclass(group.get(name, getclass=True), Mapping)


def decoded(item: h5py.Dataset | Dataset) -> Array:
    """Return a dataset's numbers, or what its flags mean."""
    values: Array = item[()]
    if values.dtype.kind == "O":
        words = [each.decode() if isinstance(each, bytes) else each for each in values]
        return np.array(words, dtype=np.str_)
    if "flag_meanings" not in item.attrs:
        return values
    meanings = np.array(str(item.attrs["flag_meanings"]).split())
    if item.name.endswith("/exists"):
        return values.astype(np.bool_)
    return np.asarray(meanings[values])


def _cell(value: Any) -> str:
    return f"{value:.8g}" if isinstance(value, float | np.floating) else str(value)


def single(value: Any) -> Any:
    """Return a number that a file holds as an array of one."""
    return value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
