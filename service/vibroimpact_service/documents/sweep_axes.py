"""The axes of a sweep as a parameter grid: paths in documents, values, and the points."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Final

import numpy as np
from pydantic import BaseModel, ValidationError

from vibroimpact_schema import requests, sweeps, systems
from vibroimpact_service import validation
from vibroimpact_solvers import sweep
from vibroimpact_solvers.arrays import Floats, declared
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, System

Path = tuple[str | int, ...]
Index = tuple[int, ...]

_RESERVED: Final = frozenset(
    {"kind", "digest", "plan", "provenance", "error", "axes", "of", "dimensions", "status"}
)
_VAGUE: Final = frozenset(
    {"lower", "upper", "values", "start", "stop", "step", "num"}
    | {"diagonal", "bands", "data", "scalar", "weights"}
)
"""Names that tell nothing without the one before."""
_SIZES: Final = frozenset({"n", "num", "shape"})
_TRIED: Final = 10_000
"""Points at which a value is tried before it is taken to be wrong everywhere."""
_OTHER_SIZE: Final = "the results would have other sizes than those of the base"
_KEPT: Final = 4
"""Structures without their limiters that are held at a time."""


@dataclass(frozen=True, slots=True)
class Decoders:
    """How parts of a request are decoded.

    Parameters
    ----------
    problem : callable
        ``(request, system) -> problem`` of the kind.
    system : callable
        ``(document) -> System``.
    constraints : callable
        ``(document) -> constraints`` of a system.
    """

    problem: Callable[[Any, System], Any]
    system: Callable[[systems.AnySystem], System]
    constraints: Callable[[systems.AnySystem], list[Constraint]]


def problem(
    kind: str,
    base: requests.ComputationRequest,
    axes: Sequence[sweeps.AnyAxis],
    system: System,
    by: Decoders,
) -> sweep.Problem:
    """Return the problem of a sweep.

    Parameters
    ----------
    kind : str
    base : ComputationRequest
        A request of that kind, valid in itself.
    axes : sequence
        Documents of the axes.
    system : System
        The structure of the base.
    by : Decoders

    Raises
    ------
    ModelError
        With a pointer to the axis whose path is wrong, or to the value with which no point of
        the grid is possible.
    """
    try:
        by.problem(base, system)
    except ModelError as error:
        raise error.under("base") from None
    fields = [_Field.of(base, place, axis.path) for place, axis in enumerate(axes)]
    _check_different(fields)
    values = [_values(axis) for axis in axes]
    grid = _Grid(kind, base, axes, fields, values, by)
    grid.check()
    return sweep.Problem(
        kind,
        tuple(_axes(kind, base, axes, fields, values)),
        grid.at,
        system,
    )


# -- Values -------------------------------------------------------------------------------


def decimal_steps(start: float, step: float, count: int) -> Floats | None:
    """Return start, start + step, …, shape (count,), None where that takes too many digits.

    Each is the double nearest to the decimal number that is meant, 0.6 + 0.1 being 0.7, so
    that grids of the same steps that overlap have the same numbers there, to the last bit.
    """
    first, each = Decimal(repr(start)), Decimal(repr(step))
    places = max(0, -min(int(d.normalize().as_tuple().exponent) for d in (first, each)))
    if places > 22:  # beyond it the denominator would be rounded
        return None
    begin, by = int(first.scaleb(places)), int(each.scaleb(places))
    if max(abs(begin), by, abs(begin + by * (count - 1))) >= 2**53:
        return None
    values: Floats = (begin + by * np.arange(count)).astype(np.float64) / 10.0**places
    return values


def _values(axis: sweeps.AnyAxis) -> Floats:
    match axis:
        case sweeps.AxisValues():
            return np.array(axis.values)
        case sweeps.AxisPoints():
            return np.linspace(axis.start, axis.stop, axis.num)
        case sweeps.AxisSteps():
            values = decimal_steps(axis.start, axis.step, axis.count)
            if values is not None:
                return values
            start, step = Decimal(repr(axis.start)), Decimal(repr(axis.step))
            return np.array([float(start + k * step) for k in range(axis.count)])


def _offset(axis: sweeps.AnyAxis) -> int:
    """Return the place of the first value on the grid of all multiples of the step."""
    if isinstance(axis, sweeps.AxisSteps):
        return int(Decimal(repr(axis.start)) // Decimal(repr(axis.step)))
    return 0


# -- Fields -------------------------------------------------------------------------------


class _WrongValue(Exception):  # noqa: N818 (it names the state of the value)
    def __init__(self, message: str, code: str) -> None:
        super().__init__(message)
        self.message, self.code = message, code


@dataclass(frozen=True, slots=True)
class _Field:
    """A number of a request.

    Parameters
    ----------
    path : tuple
        Names, keys and indices that lead to it.
    mirror : tuple or None
        Those that lead to the entry of a symmetric matrix that is equal to it.
    whole : bool
        Whether it is an integer.
    """

    path: Path
    mirror: Path | None
    whole: bool

    @classmethod
    def of(cls, base: Any, place: int, text: str) -> _Field:
        """Return the field at a path."""
        here: Any = base
        path: list[str | int] = []
        for part in text.split("."):
            step = _step(here, part)
            if step is None:
                where = ".".join(map(str, path)) or "the base"
                message = f"there is no {part!r} in {where}"
                raise ModelError(("axes", place, "path"), message, code="unknown_path")
            path.append(step)
            here = _get(here, step)
        if isinstance(here, bool) or not isinstance(here, (int, float)):
            message = f"{text} is {_sort(here)}, not a number"
            raise ModelError(("axes", place, "path"), message, code="not_a_number")
        if next(part for part in reversed(path) if isinstance(part, str)) in _SIZES:
            message = f"{text} is a size: results of differing sizes make no grid"
            raise ModelError(("axes", place, "path"), message, code="shapes_differ")
        return cls(tuple(path), _mirror(base, tuple(path)), isinstance(here, int))

    def set(self, base: Any, value: float) -> Any:
        """Return the request with another value, without checking it."""
        number = int(value) if self.whole else value
        changed = _replaced(base, self.path, number)
        return changed if self.mirror is None else _replaced(changed, self.mirror, number)

    def check(self, base: Any, value: float) -> None:
        """Raise where the field may not have that value."""
        if self.whole and not value.is_integer():
            raise _WrongValue("must be a whole number", "wrong_type")
        depth = _innermost(base, self.path)
        model = _follow(base, self.path[:depth])
        changed = self.set(base, value)
        content = dict(_follow(changed, self.path[:depth]))
        try:
            type(model).model_validate(content)
        except ValidationError as error:
            fault = validation.problem_of(error, content).errors[0]
            raise _WrongValue(fault.message, fault.code) from None


def _check_different(fields: Sequence[_Field]) -> None:
    seen: dict[Path, int] = {}
    for place, field in enumerate(fields):
        first = seen.setdefault(field.path, place)
        if first == place and field.mirror is not None:
            first = seen.setdefault(field.mirror, place)
        if first != place:
            message = f"axis {first} varies the same number"
            raise ModelError(("axes", place, "path"), message, code="duplicate_path")


def _step(here: Any, part: str) -> str | int | None:
    """Return the name, key or index that a part of a path stands for, None where there is none."""
    if isinstance(here, BaseModel):
        return part if part in type(here).model_fields else None
    if isinstance(here, dict):
        return part if part in here else None
    if isinstance(here, list) and part.isdigit() and len(part) < 10 and int(part) < len(here):
        return int(part)
    return None


def _get(here: Any, step: str | int) -> Any:
    return getattr(here, str(step)) if isinstance(here, BaseModel) else here[step]


def _follow(here: Any, path: Path) -> Any:
    for step in path:
        here = _get(here, step)
    return here


def _replaced(here: Any, path: Path, value: Any) -> Any:
    """Return a document with another value at a path; the rest is shared with the old one."""
    if not path:
        return value
    step, *rest = path
    inner = _replaced(_get(here, step), tuple(rest), value)
    if isinstance(here, BaseModel):
        return here.model_copy(update={str(step): inner})
    copy = here.copy()
    copy[step] = inner
    return copy


def _innermost(base: Any, path: Path) -> int:
    """Return how many steps lead to the innermost document on a path."""
    deepest, here = 0, base
    for depth, step in enumerate(path[:-1], start=1):
        here = _get(here, step)
        if isinstance(here, BaseModel):
            deepest = depth
    return deepest


def _mirror(base: Any, path: Path) -> Path | None:
    """Return the path of the entry that is equal by symmetry, None where there is no other."""
    match path:
        case ("system", "M" | "K" | "C", int(i), int(j)) if i != j:
            return (*path[:2], j, i)
        case ("system", "M" | "K" | "C", "data", int(k)):
            matrix = _follow(base, path[:2])
            places = list(zip(matrix.row, matrix.col, strict=False))
            i, j = places[k] if k < len(places) else (0, 0)
            if i != j and (j, i) in places:
                return (*path[:3], places.index((j, i)))
    return None


def _sort(value: Any) -> str:
    match value:
        case None:
            return "null"
        case bool():
            return "true or false"
        case str():
            return "text"
        case list():
            return "a list"
        case _:
            return "an object"


# -- Names --------------------------------------------------------------------------------


def _axes(
    kind: str,
    base: Any,
    axes: Sequence[sweeps.AnyAxis],
    fields: Sequence[_Field],
    values: Sequence[Floats],
) -> Iterator[sweep.Axis]:
    taken = _taken(kind)
    outputs = frozenset(getattr(base, "outputs", ()))
    names = _names(axes, fields, taken)
    for axis, field, some, name in zip(axes, fields, values, names, strict=True):
        rule = sweep.rule(kind, field.path)
        stages = [rule.unless[output] for output in rule.unless if output in outputs]
        unit, called = sweep.meaning(field.path)
        yield sweep.Axis(
            axis.path,
            name,
            some,
            unit,
            called if called == axis.path else f"{called}, {axis.path}",
            stages[0] if stages else rule.stage,
            rule.why,
            rule.changes,
            _offset(axis),
        )


def _taken(kind: str) -> frozenset[str]:
    """Return the names that results of a kind use themselves."""
    swept = sweep.KINDS[kind]
    names = set(_RESERVED)
    for name, field in declared(swept.solver.Result).items():
        if field.array:
            names |= {name, *field.quantity.dims, *field.path.split("/")}
    for dim in swept.ragged:
        names |= {f"{dim}_count", f"{dim}_offset"}
    return frozenset(names)


def _names(
    axes: Sequence[sweeps.AnyAxis], fields: Sequence[_Field], taken: frozenset[str]
) -> list[str]:
    given = [axis.name for axis in axes]
    for place, name in enumerate(given):
        if name is not None and (name in taken or name in given[:place]):
            message = f"the results have another {name!r}: choose another name"
            raise ModelError(("axes", place, "name"), message, code="duplicate_name")
    choices = [list(_endings(field.path)) for field in fields]
    names: list[str] = []
    for place, name in enumerate(given):
        others = {e for k, endings in enumerate(choices) if k != place for e in endings}
        barred = taken | others | {g for g in given if g is not None}
        longest = choices[place][-1]
        free = (ending for ending in choices[place] if ending not in barred)
        names.append(name if name is not None else next(free, f"{longest}_axis"))
    return names


def _endings(path: Path) -> Iterator[str]:
    """Yield the ends of a path that start with a telling name, the shortest first."""
    for start in range(len(path) - 1, -1, -1):
        if not str(path[start])[0].isdigit() and (path[start] not in _VAGUE or start == 0):
            yield "_".join(str(part) for part in path[start:])


# -- Points -------------------------------------------------------------------------------


class _Grid:
    """The problems of the points; what several of them share is decoded once."""

    def __init__(
        self,
        kind: str,
        base: Any,
        axes: Sequence[sweeps.AnyAxis],
        fields: Sequence[_Field],
        values: Sequence[Floats],
        by: Decoders,
    ) -> None:
        self._response_count = sweep.KINDS[kind].response_count
        self._base, self._axes, self._fields, self._by = base, axes, fields, by
        self._values = [some.tolist() for some in values]
        limiters = [field.path[:2] == ("system", "constraints") for field in fields]
        structure = [field.path[0] == "system" for field in fields]
        places = range(len(fields))
        self._limiting = [i for i in places if limiters[i]]
        self._structural = [i for i in places if structure[i] and not limiters[i]]
        self._other = [i for i in places if not structure[i]]
        self._structures: dict[Index, System] = {}
        self._limiters: dict[Index, list[Constraint]] = {}

    def at(self, index: Index) -> Any:
        """Return the problem of a point.

        Raises
        ------
        ModelError
            With a pointer from the base.
        """
        return self._by.problem(self._set(self._base, self._other, index), self._system(index))

    def _set(self, base: Any, places: Sequence[int], index: Index) -> Any:
        for place in places:
            base = self._fields[place].set(base, self._values[place][index[place]])
        return base

    def _system(self, index: Index) -> System:
        structure = self._structure(index)
        try:
            return structure.limited(self._constraints(index))
        except ModelError as error:
            raise error.under("system") from None

    def _constraints(self, index: Index) -> list[Constraint]:
        """Return the limiters at a point."""
        key = tuple(index[i] for i in self._limiting)
        limiters = self._limiters.get(key)
        if limiters is None:
            limiters = self._by.constraints(self._set(self._base, self._limiting, index).system)
            if len(self._limiters) > _TRIED:
                self._limiters.clear()
            self._limiters[key] = limiters
        return limiters

    def _structure(self, index: Index) -> System:
        """Return the structure at a point, without limiters."""
        key = tuple(index[i] for i in self._structural)
        structure = self._structures.get(key)
        if structure is None:
            document = self._set(self._base, self._structural, index).system
            try:
                structure = self._by.system(document.model_copy(update={"constraints": []}))
            except ModelError as error:
                raise error.under("system") from None
            if len(self._structures) >= _KEPT:
                self._structures.pop(next(iter(self._structures)))
            self._structures[key] = structure
        return structure

    def check(self) -> None:
        """Refuse values with which no point is possible."""
        for place, (field, values) in enumerate(zip(self._fields, self._values, strict=True)):
            for k, value in enumerate(values[:_TRIED]):
                try:
                    field.check(self._base, value)
                except _WrongValue as wrong:
                    raise self._wrong(place, k, wrong.message, wrong.code) from None
                # Before anything of that size is allocated.
                if _grid_size(field.set(self._base, value)) != _grid_size(self._base):
                    raise self._wrong(place, k, _OTHER_SIZE, "shapes_differ")
        good = self._first_good()
        size = self._size(good)
        for place, values in enumerate(self._values):
            for k in range(min(len(values), _TRIED)):
                neighbour = self._good_beside(good, place, k)
                if neighbour is not None and self._size(neighbour) != size:
                    raise self._wrong(place, k, _OTHER_SIZE, "shapes_differ")

    def _size(self, index: Index) -> int:
        return 0 if self._response_count is None else self._response_count(self.at(index))

    def _first_good(self) -> Index:
        """Return the first point that is possible."""
        first: ModelError | None = None
        for index in itertools.islice(self._all(), _TRIED):
            try:
                self.at(index)
            except ModelError as error:
                first = first or error
            else:
                return index
        assert first is not None
        related = (_related(field.path, first.pointer) for field in self._fields)
        place = next((i for i, is_related in enumerate(related) if is_related), 0)
        raise self._wrong(place, 0, first.message, first.code)

    def _good_beside(self, good: Index, place: int, k: int) -> Index | None:
        """Return a possible point with a value, None where there are too many to try."""
        index = (*good[:place], k, *good[place + 1 :])
        try:
            self.at(index)
        except ModelError as error:
            first = error
        else:
            return index
        others = (index for index in self._all() if index[place] == k)
        for tried, other in enumerate(others):
            if tried == _TRIED:
                return None
            try:
                self.at(other)
            except ModelError:
                continue
            return other
        raise self._wrong(place, k, first.message, first.code)

    def _all(self) -> Iterator[Index]:
        return itertools.product(*(range(len(values)) for values in self._values))

    def _wrong(self, place: int, k: int, message: str, code: str) -> ModelError:
        axis = self._axes[place]
        pointer: tuple[str | int, ...] = ("axes", place)
        if isinstance(axis, sweeps.AxisValues):
            pointer = (*pointer, "values", k)
        return ModelError(
            pointer, f"with {axis.path} = {self._values[place][k]!r}: {message}", code=code
        )


def _grid_size(request: Any) -> int:
    return int(getattr(getattr(request, "frequency", None), "count", 0))


def _related(path: Path, pointer: Path) -> bool:
    """Whether one of them lies within the other."""
    size = min(len(path), len(pointer))
    return size > 0 and path[:size] == pointer[:size]
