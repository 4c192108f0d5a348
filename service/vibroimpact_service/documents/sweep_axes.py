"""The axes of a sweep as a parameter grid: paths in documents, values, and the points."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import lru_cache
from typing import Any, Final

import numpy as np

from vibroimpact_schema import grids, sweeps, systems
from vibroimpact_service.documents import decode, series, sweep_names
from vibroimpact_service.documents.grid_values import decimal_steps, grid_values
from vibroimpact_service.documents.varying import OTHER_SIZE, Path, Varying, number, replaced
from vibroimpact_service.kinds import KINDS
from vibroimpact_solvers import sweep
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, System

Index = tuple[int, ...]

_VALUES_TRIED: Final = 64
"""Values of an axis that are tried before the sweep is accepted: the least, the greatest, and some
between, as what a field permits is an interval. What is wrong with others is said at their points.
Of large structures fewer are, and then all that is wrong is said there.
"""
_POINTS_TRIED: Final = 256
"""Points at which a value is tried before it is taken to be wrong everywhere."""
_ALL_TRIED: Final = 20, 1000
"""Points after which no more are tried, of the largest and of small structures."""
_NUMBERS_TRIED: Final = 500_000
"""Numbers in the structures of all points that are tried; each takes some 0.1 microseconds."""
_LIMITER_NUMBERS: Final = 20
"""Numbers in whose time a limiter is checked."""
_INNER: Final = len(("system", "constraints", "place"))
"""Steps of a path to a constraint."""
_LIMITERS_KEPT: Final = 10_000
_KEPT: Final = 4
"""Structures without their limiters that are held at a time."""


def problem(
    request: sweeps.SweepRequest, system: System, meter: Callable[[], None]
) -> sweep.Problem:
    """Return the problem of a sweep, whose points have structures of their own.

    Parameters
    ----------
    request : SweepRequest
        Its base is valid in itself.
    system : System
        The structure of the base.
    meter : callable
        Called before each point that is tried; raises what ends the plan.

    Raises
    ------
    ModelError
        With a pointer to the axis whose path is wrong, or to the value with which no point of
        the grid is possible.
    """
    kind, base = request.root.kind, request.base
    try:
        decode.problem(KINDS[kind], base, system, meter)
    except ModelError as error:
        raise error.under("base") from None
    points = _tried_points(base.system)
    most = max(2, min(_VALUES_TRIED, points // (4 * len(request.root.axes))))
    axes = [_axis(base, place, axis, most) for place, axis in enumerate(request.root.axes)]
    _check_different(axes)
    linked = bool(request.root.continue_)
    if linked and axes[0].path[0] == "initial":
        message = "each point along the first axis starts where the last ended: vary another number"
        raise ModelError(("axes", 0, "path"), message, code="not_continued")
    _Grid(kind, _thinned(base, axes), axes, system, linked).check(meter, points)
    grid = _Grid(kind, base, axes, system, linked)
    return sweep.Problem(
        kind,
        tuple(_described(kind, base, axes)),
        grid.at,
        system,
        follow=grid.follow if linked else None,
    )


# -- Values -------------------------------------------------------------------------------


def _values(axis: sweeps.AnyAxis) -> Floats:
    if not isinstance(axis, sweeps.AxisSteps):
        return grid_values(axis)
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


@dataclass(frozen=True, slots=True)
class _Axis(Varying):
    """A number of a request that varies, and its values."""

    document: sweeps.AnyAxis
    values: Floats
    tried: Sequence[int]
    """Positions of the values that are checked."""

    def set(self, base: Any, position: int) -> Any:
        """Return the request with the value at a position, without checking it."""
        return self.put(base, float(self.values[position]))

    def set_within(self, constraint: Any, position: int) -> Any:
        """Return a constraint of the request with the value at a position, without checking it."""
        return replaced(constraint, self.path[_INNER:], self.number(float(self.values[position])))

    def check(self, base: Any, position: int) -> None:
        """Raise where the field may not have the value at a position."""
        self.fits(base, float(self.values[position]))


def _axis(base: Any, place: int, document: sweeps.AnyAxis, most: int) -> _Axis:
    try:
        of = number(base, document.path)
    except ModelError as error:
        raise error.under("axes", place) from None
    values = _values(document)
    return _Axis(of.path, of.mirror, of.whole, document, values, _tried(values, most))


def _tried(values: Floats, most: int) -> Sequence[int]:
    """Return the positions of the values that are checked; see `_VALUES_TRIED`."""
    if values.size <= most:
        return range(values.size)
    spread = np.linspace(0.0, values.size - 1.0, most - 2).astype(np.int64)
    return sorted({int(values.argmin()), int(values.argmax()), *spread.tolist()})


def _tried_points(system: Any) -> int:
    """Return how many points are tried before a sweep is accepted: fewer of large structures."""
    given = [getattr(system, name, None) for name in ("M", "K", "C")]
    numbers = sum(map(_numbers, given)) + getattr(system, "n", 0)
    numbers += _LIMITER_NUMBERS * len(system.constraints)
    least, most = _ALL_TRIED
    return max(least, min(most, _NUMBERS_TRIED // max(numbers, 1)))


def _numbers(matrix: Any) -> int:
    """Return how many numbers a matrix is made of, 0 for none."""
    match matrix:
        case None:
            return 0
        case systems.DiagonalMatrix():
            return len(matrix.diagonal)
        case systems.BandedMatrix():
            return sum(map(len, matrix.bands.values()))
        case systems.CoordinateMatrix():
            return len(matrix.data)
        case systems.ScalarMatrix():
            return matrix.n
        case _:
            return sum(map(len, matrix))


def _check_different(axes: Sequence[_Axis]) -> None:
    seen: dict[Path, int] = {}
    for place, axis in enumerate(axes):
        first = seen.setdefault(axis.path, place)
        if first == place and axis.mirror is not None:
            first = seen.setdefault(axis.mirror, place)
        if first != place:
            message = f"axis {first} varies the same number"
            raise ModelError(("axes", place, "path"), message, code="duplicate_path")


def _thinned(base: Any, axes: Sequence[_Axis]) -> Any:
    """Return a request with few frequencies, which is possible where the whole one is.

    That an axis changes their number is seen in the document alone.
    """
    grid = getattr(base, "frequency", None)
    if not isinstance(grid, grids.FrequencyPoints):
        return base
    return base.model_copy(update={"frequency": grid.model_copy(update={"num": min(grid.num, 2)})})


# -- The solver's axes --------------------------------------------------------------------


def _described(kind: str, base: Any, axes: Sequence[_Axis]) -> Iterator[sweep.Axis]:
    """Yield the solver's axes."""
    outputs = frozenset(getattr(base, "outputs", ()))
    for axis, name in zip(axes, sweep_names.names(kind, axes), strict=True):
        path = axis.document.path
        rule = sweep.rule(kind, axis.path)
        stages = [rule.unless[output] for output in rule.unless if output in outputs]
        unit, called = sweep.meaning(axis.path)
        yield sweep.Axis(
            path,
            name,
            axis.values,
            unit,
            called if called == path else f"{called}, {path}",
            stages[0] if stages else rule.stage,
            rule.why,
            rule.changes,
            _offset(axis.document),
        )


# -- Points -------------------------------------------------------------------------------


class _Grid:
    """The problems of the points; what several of them share is decoded once."""

    def __init__(
        self, kind: str, base: Any, axes: Sequence[_Axis], system: System, linked: bool
    ) -> None:
        self._linked, self._continued = linked, sweep.KINDS[kind].continued
        self._kind, self._response_count = KINDS[kind], sweep.KINDS[kind].response_count
        self._base, self._axes, self._system = base, axes, system
        paths = list(enumerate(axis.path for axis in axes))
        self._limiting = [i for i, path in paths if path[:2] == ("system", "constraints")]
        self._other = [i for i, path in paths if path[0] != "system"]
        self._structural = [i for i, _ in paths if i not in (*self._limiting, *self._other)]
        self._limiters = lru_cache(_LIMITERS_KEPT)(self._decoded_limiters)
        self._structure = lru_cache(_KEPT)(self._decoded_structure)

    def at(self, index: Index) -> Any:
        """Return the problem of a point.

        Raises
        ------
        ModelError
            With a pointer from the base.
        """
        return decode.problem(self._kind, *self._point(index))

    def follow(self, index: Index, end: Any) -> Any:
        """Return the problem of a point that starts where another ended, as `at` does."""
        continued = self._continued
        assert continued is not None
        request, system = self._point(index)
        start = continued.start(system, end)
        return continued.going_on(decode.problem(self._kind, request, system, start=start), end)

    def _point(self, index: Index) -> tuple[Any, System]:
        """Return the request of a point and its structure."""

        def positions(places: Sequence[int]) -> Index:
            return tuple(index[place] for place in places)

        try:
            rows, structure = self._structure(positions(self._structural))
            system = structure.limited(self._limiters(positions(self._limiting)))
            system = system if rows is None else series.in_series(rows, system)
        except ModelError as error:
            raise error.under("system") from None
        return self._set(self._other, positions(self._other)), system

    def _set(self, places: Sequence[int], positions: Index) -> Any:
        """Return the base with the values at some positions on some of the axes."""
        request = self._base
        for place, position in zip(places, positions, strict=True):
            axis = self._axes[place]
            request = axis.set(request, position)
        return request

    def _decoded_limiters(self, positions: Index) -> list[Constraint]:
        limiters = list(self._system.constraints)
        documents = dict[int, Any]()
        for place, position in zip(self._limiting, positions, strict=True):
            axis = self._axes[place]
            which = int(axis.path[2])
            document = documents.get(which, self._base.system.constraints[which])
            documents[which] = axis.set_within(document, position)
        for which, document in documents.items():
            limiters[which] = decode.constraint(which, document)
        return limiters

    def _decoded_structure(self, positions: Index) -> tuple[Any, System]:
        """Return a residual flexibility and the structure, with any limiters."""
        if not self._structural:
            return self._base.system.residual_flexibility, self._system
        document = self._set(self._structural, positions).system
        bare = document.model_copy(update={"constraints": [], series.FIELD: None})
        return document.residual_flexibility, decode.system(bare)

    def check(self, meter: Callable[[], None], points: int) -> None:
        """Refuse values with which none of so many points is possible; `meter` as of `problem`."""
        self._meter, self._left = meter, points
        tried = [axis.tried for axis in self._axes]
        usual = [_tried(axis.values, _VALUES_TRIED) for axis in self._axes]
        few = tried != usual or points < min(_POINTS_TRIED, math.prod(map(len, tried)))
        for place, axis in enumerate(self._axes):
            if axis.whole and (broken := axis.values % 1.0 != 0.0).any():
                error = ModelError((), "must be a whole number", code="wrong_type")
                raise self._wrong(place, int(broken.argmax()), error)
            for k in axis.tried:
                meter()
                try:
                    axis.check(self._base, k)
                except ModelError as error:
                    raise self._wrong(place, k, error) from None
        outcome = self._first_possible(self._some())
        if isinstance(outcome, ModelError):
            if few:
                return
            related = [_related(axis.path, outcome.pointer) for axis in self._axes]
            raise self._wrong(related.index(True) if any(related) else 0, 0, outcome)
        good, point = outcome
        size = self._size(point)
        for place, axis in enumerate(self._axes):
            for k in axis.tried:
                neighbour = self._possible_beside(good, place, k, few)
                if neighbour is not None and self._size(neighbour) != size:
                    raise self._wrong(place, k, OTHER_SIZE)

    def _size(self, point: Any) -> int:
        return 0 if self._response_count is None else self._response_count(point)

    def _possible_beside(self, good: Index, place: int, k: int, few: bool) -> Any:
        """Return the problem of a possible point with a value, None where others may be."""
        if self._left <= 0:
            return None
        beside = (*good[:place], k, *good[place + 1 :])
        points = itertools.chain([beside], self._some((place, k)))
        outcome = self._first_possible(points)
        if not isinstance(outcome, ModelError):
            return outcome[1]
        if few or next(points, None) is not None:
            return None
        raise self._wrong(place, k, outcome)

    def _first_possible(self, points: Iterator[Index]) -> tuple[Index, Any] | ModelError:
        """Return the first possible one of some points and its problem, or the first error."""
        first: ModelError | None = None
        for index in itertools.islice(points, max(1, min(_POINTS_TRIED, self._left))):
            self._meter()
            self._left -= 1
            try:
                return index, self.at(index)
            except ModelError as error:
                if self._linked and index[0] > 0 and error.code == "outside_limits":
                    return index, None  # it does not start from the state of the base
                first = first or error
        assert first is not None
        return first

    def _some(self, fixed: tuple[int, int] | None = None) -> Iterator[Index]:
        """Yield points of values that are tried; the position on one axis may be fixed."""
        places = [axis.tried for axis in self._axes]
        if fixed is not None:
            axis, position = fixed
            places[axis] = (position,)
        return itertools.product(*places)

    def _wrong(self, place: int, k: int, error: ModelError) -> ModelError:
        axis = self._axes[place]
        listed = isinstance(axis.document, sweeps.AxisValues)
        pointer = ("axes", place, "values", k) if listed else ("axes", place)
        message = f"with {axis.document.path} = {float(axis.values[k])!r}: {error.message}"
        return ModelError(pointer, message, code=error.code)


def _related(path: Path, pointer: Path) -> bool:
    """Whether one of them lies within the other."""
    size = min(len(path), len(pointer))
    return size > 0 and path[:size] == pointer[:size]
