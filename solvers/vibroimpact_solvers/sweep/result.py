"""What is answered: the arrays of the points put together, the axes of the lattice first."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Described, Integers, Quantity, quantities
from vibroimpact_solvers.errors import ConvergenceError, ModelError, PlanError, SolverError
from vibroimpact_solvers.sweep.problem import Index, Problem

Array = NDArray[Any]
Place = tuple[int | slice, ...]

MOST_SENTENCES: Final = 20
"""Failures that are told in words; `status` has them all."""
FAILED: Final = "failed"
"""What codes with meanings say at points without a result."""


class Status(IntEnum):
    """Whether there is a result at a point, and why not."""

    OK = 0
    INVALID = 1
    NOT_POSSIBLE = 2
    NO_CONVERGENCE = 3

    @classmethod
    def of(cls, error: SolverError) -> Status:
        """Return the status that an error stands for."""
        match error:
            case ModelError():
                return cls.INVALID
            case PlanError():
                return cls.NOT_POSSIBLE
            case ConvergenceError():
                return cls.NO_CONVERGENCE
            case _:
                raise error


STATUSES: Final = tuple(status.name.lower() for status in Status)


@dataclass(frozen=True, eq=False)
class Result(Described):
    """Outputs over the lattice.

    Arrays have the names of the base's results. Beside them stand the values of the axes under
    their names, `status`, and for every table of differing length ``<table>_count`` and
    ``<table>_offset``.
    """


class Assembly:
    """Takes the outcomes of the points one by one.

    Parameters
    ----------
    problem : Problem
        The lattice, or the piece of it, that is covered.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem, self._swept = problem, problem.swept
        self._axes = tuple(axis.name for axis in problem.axes)
        self._idle = tuple(axis.stage is None for axis in problem.axes)
        self._quantities = quantities(self._swept.solver.Result)
        self._scalars = _scalars(self._swept.solver.Result, self._quantities)
        self._moved = _moved(problem)
        self._arrays: dict[str, Array] = {}
        self._tables: dict[str, dict[Index, Array]] = {}
        self._given: set[str] = set()
        self._statements: list[str] = []
        self._failures: list[str] = []
        self._status = np.zeros(problem.shape, dtype=np.int64)

    def put(self, index: Index, outcome: Any) -> None:
        """Take the result of a point, or the error that it has instead.

        Raises
        ------
        ModelError
            Where its arrays are of other sizes than those of the points before.
        """
        place = self._place(index)
        if isinstance(outcome, SolverError):
            self._status[place] = Status.of(outcome)
            if len(self._failures) < MOST_SENTENCES:
                self._failures.append(f"{self._called(index)}: {outcome}")
            return
        for name, quantity in self._quantities.items():
            value = getattr(outcome, name)
            if value is not None:
                self._given.add(name)
            elif name in self._swept.absent:
                value = getattr(outcome, self._swept.absent[name])
            if value is not None:
                self._set(name, quantity, index, place, np.asarray(value))
        for name, quantity in self._scalars.items():
            value = getattr(outcome, name)
            if isinstance(value, str):
                if value not in self._statements:
                    self._statements.append(value)
            elif value is not None:
                self._set(name, quantity, index, place, np.asarray(value))

    def result(self) -> Result:
        """Return the result of all that was taken."""
        for name in self._swept.absent:
            if name not in self._given:
                self._arrays.pop(name, None)
        arrays: dict[str, Array] = {"status": self._status, **self._arrays}
        meanings = {"status": _status_meaning(self._axes)}
        meanings |= {name: self._meaning(name) for name in self._arrays}
        for dim in sorted(self._swept.ragged):
            rows = {n: t for n, t in self._tables.items() if self._quantities[n].dims[:1] == (dim,)}
            if rows:
                arrays |= self._table(dim, rows)
                meanings |= {name: self._quantities[name] for name in rows}
                meanings |= _counting(dim, self._axes)
        return _result(self._problem, arrays, meanings, self._statements, self._failures)

    def _set(self, name: str, quantity: Quantity, index: Index, place: Place, value: Array) -> None:
        if quantity.dims[:1] and quantity.dims[0] in self._swept.ragged:
            self._tables.setdefault(name, {})[index] = value
            return
        held = self._arrays.get(name)
        if quantity.coordinate:
            place = tuple(index[axis] for axis in self._moved[name])
            if not place:
                if held is None:
                    self._arrays[name] = value
                elif held is not value and not np.array_equal(held, value):
                    raise _unequal(name)
                return
        if held is None:
            lattice = self._problem.shape
            if quantity.coordinate:
                lattice = tuple(lattice[axis] for axis in self._moved[name])
            held = self._arrays[name] = _filled(quantity, lattice + value.shape, value.dtype)
        if held.shape[held.ndim - value.ndim :] != value.shape:
            raise _unequal(name)
        held[place] = value

    def _meaning(self, name: str) -> Quantity:
        quantity = self._quantities.get(name) or self._scalars[name]
        if quantity.coordinate:
            before = tuple(self._axes[axis] for axis in self._moved[name])
        else:
            before = self._axes
        flags = quantity.flags
        if flags and self._arrays[name].dtype != np.bool_:
            flags = (*flags, FAILED)
        return replace(quantity, dims=(*before, *quantity.dims), flags=flags)

    def _table(self, dim: str, rows: Mapping[str, Mapping[Index, Array]]) -> dict[str, Array]:
        """Return the rows of all points one after the other, and where those of each are."""
        points = [self._active(index) for index in np.ndindex(self._problem.shape)]
        some = next(iter(rows.values()))
        lengths = [some[point].shape[0] if point in some else 0 for point in points]
        counts = np.array(lengths, dtype=np.int64).reshape(self._problem.shape)
        found = {
            name: np.concatenate([table[point] for point in points if point in table])
            for name, table in rows.items()
        }
        return found | {f"{dim}_count": counts, f"{dim}_offset": _offsets(counts)}

    def _place(self, index: Index) -> Place:
        """Return where the outcome of a point belongs: along idle axes everywhere."""
        return tuple(slice(None) if idle else i for i, idle in zip(index, self._idle, strict=True))

    def _active(self, index: Index) -> Index:
        """Return the point whose outcome stands at an index."""
        return tuple(0 if idle else i for i, idle in zip(index, self._idle, strict=True))

    def _called(self, index: Index) -> str:
        return self._problem.called(index)


def join(problem: Problem, results: Sequence[tuple[Problem, Described]]) -> Result:
    """Put the results of the pieces of a lattice together."""
    axes = tuple(axis.name for axis in problem.axes)
    arrays: dict[str, Array] = {}
    meanings: dict[str, Quantity] = {}
    for name, meaning in _union(results).items():
        if meaning.dims[:1] and meaning.dims[0] in problem.swept.ragged:
            continue  # rows come below, once it is known where
        if meaning.rows_of and name.endswith("_offset"):
            continue
        parts = [(piece, _of(result, name, problem)) for piece, result in results]
        arrays[name] = _pasted(problem, axes, name, meaning, parts)
        meanings[name] = meaning
    for dim in sorted(problem.swept.ragged):
        if f"{dim}_count" in arrays:
            arrays[f"{dim}_offset"] = _offsets(arrays[f"{dim}_count"])
            meanings |= _counting(dim, axes)
            rows = {n: m for n, m in _union(results).items() if m.dims[:1] == (dim,)}
            for name in rows:
                arrays[name] = _gathered(problem, dim, name, arrays, results)
            meanings |= rows
    statements = [s for _, r in results for s in str(r.plain["error/statement"]).split(_AND) if s]
    failures = [sentence for _, r in results for sentence in r.plain["error/failures"]]
    return _result(problem, arrays, meanings, list(dict.fromkeys(statements)), failures)


_AND: Final = "; "


def _result(
    problem: Problem,
    arrays: Mapping[str, Array],
    meanings: Mapping[str, Quantity],
    statements: Iterable[str],
    failures: Sequence[str],
) -> Result:
    own: dict[str, Array] = {}
    labels: dict[str, Quantity] = {}
    for axis, (start, stop) in zip(problem.axes, problem.spans, strict=True):
        own[axis.name] = axis.values[start:stop]
        labels[axis.name] = Quantity(
            (axis.name,), axis.unit, axis.long_name, True, path=f"axes/{axis.name}"
        )
    plain = {
        "of": problem.kind,
        "error/statement": _AND.join(statements),
        "error/failures": list(failures[:MOST_SENTENCES]),
    }
    order = [field.name for field in fields(problem.swept.solver.Result)]
    named = sorted(arrays, key=lambda name: order.index(name) if name in order else -1)
    return Result(
        own | {name: arrays[name] for name in named},
        labels | {name: meanings[name] for name in named},
        plain,
    )


def _union(results: Sequence[tuple[Problem, Described]]) -> dict[str, Quantity]:
    """Return the arrays that any of the results has, without the axes."""
    found: dict[str, Quantity] = {}
    for piece, result in results:
        axes = {axis.name for axis in piece.axes}
        found |= {n: m for n, m in result.meanings.items() if n not in axes and n not in found}
    return found


def _of(result: Described, name: str, problem: Problem) -> Array | None:
    found = result.arrays.get(name)
    if found is None and name in problem.swept.absent:
        found = result.arrays.get(problem.swept.absent[name])
    return found


def _pasted(
    problem: Problem,
    axes: tuple[str, ...],
    name: str,
    meaning: Quantity,
    parts: Sequence[tuple[Problem, Array | None]],
) -> Array:
    """Return an array of the whole lattice from those of its pieces."""
    along = [axes.index(dim) for dim in meaning.dims if dim in axes]
    some = next(part for _, part in parts if part is not None)
    own = some.shape[len(along) :]
    if not along:
        if any(part is not None and not np.array_equal(part, some) for _, part in parts):
            raise _unequal(name)
        return some
    whole = _filled(meaning, tuple(problem.shape[axis] for axis in along) + own, some.dtype)
    for piece, part in parts:
        if part is None:
            continue
        if part.shape[len(along) :] != own:
            raise _unequal(name)
        whole[tuple(_within(problem, piece, axis) for axis in along)] = part
    return whole


def _gathered(
    problem: Problem,
    dim: str,
    name: str,
    arrays: Mapping[str, Array],
    results: Sequence[tuple[Problem, Described]],
) -> Array:
    """Return the rows of a table in the order of the points of the whole lattice."""
    total = int(arrays[f"{dim}_count"].sum())
    some = next(r.arrays[name] for _, r in results if name in r.arrays)
    whole = np.empty((total, *some.shape[1:]), dtype=some.dtype)
    for piece, result in results:
        if name not in result.arrays:
            continue
        place = tuple(_within(problem, piece, axis) for axis in range(len(problem.axes)))
        counts = result.arrays[f"{dim}_count"].ravel()
        targets = np.repeat(arrays[f"{dim}_offset"][place].ravel(), counts)
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        whole[targets + within] = result.arrays[name]
    return whole


def _within(problem: Problem, piece: Problem, axis: int) -> slice:
    """Return where a piece lies on an axis of the whole."""
    first = problem.spans[axis][0]
    start, stop = piece.spans[axis]
    return slice(start - first, stop - first)


def _moved(problem: Problem) -> dict[str, tuple[int, ...]]:
    """Return the axes along which each coordinate of the results changes."""
    return {
        name: tuple(i for i, axis in enumerate(problem.axes) if name in axis.moves)
        for name in quantities(problem.swept.solver.Result)
    }


def _scalars(result: type[Any], known: Mapping[str, Quantity]) -> dict[str, Quantity]:
    """Return the fields that are no arrays: one number at each point, or a statement."""
    return {
        field.name: Quantity(
            (), "1", field.name.replace("_", " "), path=field.name.replace("_", "/", 1)
        )
        for field in fields(result)
        if field.name not in known
    }


def _offsets(counts: Integers) -> Integers:
    """Return the first row of each point."""
    return (np.cumsum(counts) - counts.ravel()).reshape(counts.shape)


def _status_meaning(axes: tuple[str, ...]) -> Quantity:
    return Quantity(axes, "1", "whether there is a result, and if not why", flags=STATUSES)


def _counting(dim: str, axes: tuple[str, ...]) -> dict[str, Quantity]:
    return {
        f"{dim}_count": Quantity(axes, "1", f"rows of {dim} at each point", rows_of=dim),
        f"{dim}_offset": Quantity(axes, "1", f"first row of {dim} of each point"),
    }


def _filled(meaning: Quantity, shape: Index, dtype: np.dtype[Any]) -> Array:
    """Return an array that says of every point that there is no result."""
    if dtype == np.float64:
        return np.full(shape, math.nan)
    if dtype == np.bool_ or meaning.rows_of:
        return np.zeros(shape, dtype=dtype)
    if meaning.flags:
        known = FAILED in meaning.flags or meaning.flags == STATUSES
        return np.full(shape, len(meaning.flags) - 1 if known else len(meaning.flags), dtype=dtype)
    return np.full(shape, -1, dtype=dtype)


def _unequal(name: str) -> ModelError:
    message = f"{name} would differ in size or place from point to point"
    return ModelError(("axes",), message, code="shapes_differ")
