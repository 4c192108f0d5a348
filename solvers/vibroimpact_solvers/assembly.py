"""Collection of the results of many problems, the points of a grid, in arrays over the grid.

Points may fail. The rows of tables whose length differs from point to point follow one another
in the order of the points.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Integers, Quantity, along, declared
from vibroimpact_solvers.errors import ModelError, SolverError, Status

Array = NDArray[Any]
Index = tuple[int, ...]
Place = tuple[int | slice | Integers, ...]

_MAX_FAILURE_MESSAGES: Final = 20
"""Failures whose messages are kept; `status` shows all failures."""
_AND: Final = "; "


class Assembly:
    """Collects the results of single points, or of pieces of the grid, in any order.

    Parameters
    ----------
    result : type
        Class of the results of single points.
    shape : tuple of int
        Number of positions on each axis of the grid; also the shape of `status`.
    label : callable
        Returns the name of a point for messages, given its index.
    ragged : collection of str
        Dimensions of the results whose length differs from point to point.
    absent : mapping
        Field -> the field that it equals where it is absent.
    changes : mapping
        Coordinate of the results -> the axes along which it changes; others are common to all.
    idle : collection of int
        Axes that change nothing: the result of a point holds for all positions on them.
    """

    def __init__(
        self,
        result: type[Any],
        shape: Index,
        label: Callable[[Index], str],
        ragged: Collection[str],
        absent: Mapping[str, str] | None = None,
        changes: Mapping[str, tuple[int, ...]] | None = None,
        idle: Collection[int] = (),
    ) -> None:
        self.status = np.zeros(shape, dtype=np.int64)
        self._label, self._absent, self._idle = label, absent or {}, idle
        self._fields = declared(result)
        self._texts = [name for name, field in self._fields.items() if field.scalar is str]
        self._columns = {dim: along(result, dim) for dim in sorted(ragged)}
        in_tables = {name for columns in self._columns.values() for name in columns}
        whole = tuple(range(len(shape)))
        self._names: dict[Index, list[str]] = {}
        """Names of the arrays by the axes along which they change."""
        for name, field in self._fields.items():
            # Lists of sentences are about one point, and have no place in a grid.
            if name not in (*in_tables, *self._texts) and field.scalar != list[str]:
                axes = (changes or {}).get(name, ()) if field.quantity.coordinate else whole
                self._names.setdefault(axes, []).append(name)
        self._points = np.arange(math.prod(shape)).reshape(shape)
        self._arrays: dict[str, Array] = {}
        self._tables: dict[str, _Table] = {}
        self._given: set[str] = set()
        self._statements: dict[str, None] = {}
        self._neglected: dict[str, None] = {}
        self._failures: list[str] = []

    @property
    def statement(self) -> str:
        """All different statements about errors."""
        return _AND.join(self._statements)

    @property
    def failures(self) -> list[str]:
        """Why points failed, the first of them."""
        return self._failures[:_MAX_FAILURE_MESSAGES]

    @property
    def neglected(self) -> list[str]:
        """All different sentences about parts of structures that have no effect."""
        return list(self._neglected)

    def neglect(self, sentences: Iterable[str] | None) -> None:
        """Add sentences about parts of structures that have no effect, as far as they are new."""
        self._neglected |= dict.fromkeys(sentences or ())

    def put(self, index: Index, outcome: Any) -> None:
        """Add the result of a point, or the error that it has instead.

        Raise `ModelError` if the sizes of its arrays differ from those of the points before.
        """
        place = tuple(slice(None) if k in self._idle else i for k, i in enumerate(index))
        if isinstance(outcome, SolverError):
            self.status[place] = Status.of(outcome)
            if len(self._failures) < _MAX_FAILURE_MESSAGES:
                self._failures.append(f"{self._label(index)}: {outcome}")
            return
        values = {name: getattr(outcome, name) for name in self._fields}
        self._state(values[name] for name in self._texts)
        self.neglect(values.get("neglected"))
        self._add(place, values, 0)

    def put_many(self, points: Sequence[int], outcomes: Sequence[Any]) -> None:
        """Add the outcomes of some points of a grid with one axis; as `put`, but faster."""
        results: dict[int, Any] = {}
        for index, outcome in zip(points, outcomes, strict=True):
            if isinstance(outcome, SolverError):
                self.put((index,), outcome)
            else:
                results[index] = outcome
        if not results:
            return
        values: dict[str, Any] = {}
        in_tables = {name: dim for dim, names in self._columns.items() for name in names}
        for name, field in self._fields.items():
            column = [getattr(result, name) for result in results.values()]
            if field.scalar is str and not field.array:
                self._state(set(column))
            elif field.scalar == list[str]:
                for sentences in column if name == "neglected" else ():
                    self.neglect(sentences)
            elif name in in_tables and column[0] is not None:
                values[name] = np.concatenate(column)
                counts = np.array([len(rows) for rows in column])
                values[f"{in_tables[name]}_count"] = counts
            elif field.quantity.coordinate:
                values[name] = column[0]
            elif any(value is not None for value in column):
                values[name] = np.array([math.nan if value is None else value for value in column])
        self._add((np.fromiter(results, np.int64),), values, 1)

    def put_piece(
        self,
        place: tuple[slice | Integers, ...],
        arrays: Mapping[str, Any],
        statement: str,
        failures: Sequence[str],
    ) -> None:
        """Add the result of a piece of the grid, as `arrays` of an assembly returns it.

        Raise `ModelError` if the sizes of its arrays differ from those of the pieces before.
        """
        self.status[place] = arrays["status"]
        self._state([statement])
        self._failures += failures
        self._add(place, arrays, len(place))

    def _state(self, statements: Iterable[str]) -> None:
        """Add statements about errors, as far as they are new."""
        parts = (part for statement in statements for part in statement.split(_AND))
        self._statements |= dict.fromkeys(part for part in parts if part)

    def arrays(self) -> dict[str, Array]:
        """Return the status, the counts and offsets of tables, and all fields in their order."""
        own, fields = {"status": self.status}, self._arrays.copy()
        for name in self._absent:
            if name not in self._given:
                fields.pop(name, None)
        for dim, table in sorted(self._tables.items()):
            counts, rows = table.joined(self.status.shape)
            own |= {f"{dim}_count": counts, f"{dim}_offset": _offsets(counts)}
            fields |= rows
        return own | {name: fields[name] for name in self._fields if name in fields}

    def _add(self, place: Place, values: Mapping[str, Any], leading: int) -> None:
        """Add the arrays and the rows of tables of a point or of a piece.

        Arrays of a piece have the axes of the grid in front along which they change: all of
        them, `leading`, or those of a coordinate. Arrays of a point, with `leading` 0, have none.
        """
        for name, other in self._absent.items():
            if values.get(name) is None:
                values = {**values, name: values.get(other)}
            else:
                self._given.add(name)
        for axes, names in self._names.items():
            at, own = tuple(place[axis] for axis in axes), min(leading, len(axes))
            for name in names:
                if values.get(name) is not None:
                    self._set(name, axes, at, np.asarray(values[name]), own)
        for dim, columns in self._columns.items():
            rows = {name: values[name] for name in columns if values.get(name) is not None}
            if not rows:
                continue
            points = self._points[place].ravel()
            if leading:
                counts = values[f"{dim}_count"].ravel()
            else:
                counts = np.full(points.size, len(next(iter(rows.values()))))
                if points.size > 1:
                    rows = {name: np.concatenate([row] * points.size) for name, row in rows.items()}
            self._tables.setdefault(dim, _Table()).add(points, counts, rows)

    def _set(self, name: str, axes: Index, at: Place, value: Array, leading: int) -> None:
        array, own = self._arrays.get(name), value.shape[leading:]
        if array is None:
            grid = tuple(self.status.shape[axis] for axis in axes)
            filled = _filled(self._fields[name].quantity, grid + own, value.dtype)
            array = self._arrays[name] = filled if axes else value
        if array.shape[len(axes) :] != own:
            raise _unequal(name)
        if axes:
            array[at] = value
        elif array is not value and not np.array_equal(array, value):
            raise _unequal(name)


class _Table:
    """Rows of a table, added for some points after another in any order."""

    def __init__(self) -> None:
        self._points: list[Integers] = []
        self._counts: list[Integers] = []
        self._columns: dict[str, list[Array]] = {}

    def add(self, points: Integers, counts: Integers, rows: Mapping[str, Array]) -> None:
        """Add the rows of some points; they follow one another in the order of these."""
        self._points.append(points)
        self._counts.append(counts)
        for name, column in rows.items():
            self._columns.setdefault(name, []).append(column)

    def joined(self, shape: Index) -> tuple[Integers, dict[str, Array]]:
        """Return the number of rows of each point of the grid, and the columns."""
        points, counts = np.concatenate(self._points), np.concatenate(self._counts)
        whole = np.zeros(math.prod(shape), dtype=np.int64)
        whole[points] = counts
        order = np.argsort(np.repeat(points, counts), kind="stable")
        rows = {name: np.concatenate(parts)[order] for name, parts in self._columns.items()}
        return whole.reshape(shape), rows


def _offsets(counts: Integers) -> Integers:
    """Return the first row of each point."""
    return (np.cumsum(counts) - counts.ravel()).reshape(counts.shape)


def _filled(meaning: Quantity, shape: Index, dtype: np.dtype[Any]) -> Array:
    """Return an array of the values that mark points without a result."""
    if dtype == np.float64:
        return np.full(shape, math.nan)
    if dtype == np.bool_:
        return np.zeros(shape, dtype=dtype)
    # Behind the codes of the flags there is one more, that of failures.
    return np.full(shape, len(meaning.flags) or -1, dtype=dtype)


def _unequal(name: str) -> ModelError:
    message = f"{name} would differ in size or position from point to point"
    return ModelError(("axes",), message, code="shapes_differ")
