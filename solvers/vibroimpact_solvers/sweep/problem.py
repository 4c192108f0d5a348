"""The problem of a sweep: a computation at every point of a parameter grid."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, TypeVar

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError, attempt
from vibroimpact_solvers.model import System
from vibroimpact_solvers.plan import Stage
from vibroimpact_solvers.sweep.kinds import KINDS, SweptKind

KIND: Final = "sweep"
_STAGES: Final = {stage: rank for rank, stage in enumerate(Stage)}

_T = TypeVar("_T")

Index = tuple[int, ...]
Span = tuple[int, int]
"""Start and end of a range of positions on an axis."""


def rank(stage: Stage | None) -> int:
    """Return the position of a stage in the order of `Stage`; None is last."""
    return len(_STAGES) if stage is None else _STAGES[stage]


@dataclass(frozen=True, eq=False, slots=True)
class Axis:
    """One axis of the parameter grid.

    Parameters
    ----------
    path : str
        The field of the request that varies.
    name : str
        Name of the dimension.
    values : array, shape (position,)
    unit, long_name : str
        Unit and name of the values, see `vibroimpact_solvers.arrays.Quantity`.
    stage : Stage or None
        The first stage that a change of the value invalidates; None: none.
    why : str
        The reason why, where it is None.
    changes : tuple of str
        Coordinates of the results that change with it.
    offset : int
        Position of the first value on the grid that all axes of the same start and step share.
    """

    path: str
    name: str
    values: Floats
    unit: str = "1"
    long_name: str = ""
    stage: Stage | None = Stage.SPECTRUM
    why: str = ""
    changes: tuple[str, ...] = ()
    offset: int = 0


@dataclass(frozen=True, eq=False)
class Problem:
    """A computation at every point of a parameter grid.

    Parameters
    ----------
    kind : str
        Kind of the computation, one of `kinds.KINDS`.
    axes : tuple of Axis
        Dimensions of the results, in their order.
    at : callable
        Returns the problem of one point, given a position on each axis; raises `ModelError` if
        the point is invalid.
    system : System
        The structure of the base, which has the units.
    spans : tuple of (int, int), optional
        The ranges that this piece of the grid covers; absent: all of it.
    follow : callable, optional
        Lets each point start where the last ended, along the first axis: returns the problem of
        one point, as ``at``, that starts from an end, as `kinds.Continued` has it.
    """

    kind: str
    axes: tuple[Axis, ...]
    at: Callable[[Index], Any]
    system: System
    spans: tuple[Span, ...] = ()
    follow: Callable[[Index, Any], Any] | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            message = f"only {', '.join(KINDS)} can be swept"
            raise ModelError(("kind",), message, code="unknown_choice")
        if self.follow is not None and self.swept_kind.continued is None:
            message = f"{self.kind} has no end from which the next point could start"
            raise ModelError(("continue",), message, code="not_continued")
        names = [axis.name for axis in self.axes]
        for place, name in enumerate(names):
            if name in names[:place]:
                message = f"two axes are called {name!r}"
                raise ModelError(("axes", place, "name"), message, code="duplicate_name")
        if not self.spans:
            whole = tuple((0, axis.values.size) for axis in self.axes)
            object.__setattr__(self, "spans", whole)

    @property
    def swept_kind(self) -> SweptKind:
        """The entry of the kind in `KINDS`."""
        return KINDS[self.kind]

    @property
    def shape(self) -> Index:
        """Number of positions on each axis."""
        return tuple(stop - start for start, stop in self.spans)

    @property
    def order(self) -> tuple[int, ...]:
        """The axes from the slowest to the fastest: those of the most expensive stages first.

        One along which each point needs the last is the fastest.
        """
        places = range(len(self.axes))
        return tuple(
            sorted(places, key=lambda place: (self.linked(place), rank(self.axes[place].stage)))
        )

    def linked(self, place: int) -> bool:
        """Whether each point along an axis starts where the last ended."""
        return self.follow is not None and place == 0

    def count(self, stage: Stage) -> int:
        """Return the number of points at which a stage is computed."""
        size = 1
        for axis, places in zip(self.axes, self.shape, strict=True):
            if rank(axis.stage) <= rank(stage):
                size *= places
        return size

    def positions(self, stage: Stage) -> Callable[[Index], Index]:
        """Return the function of the positions of a point on axes that invalidate a stage."""
        places = [k for k, axis in enumerate(self.axes) if rank(axis.stage) <= rank(stage)]
        return lambda index: tuple(index[place] for place in places)

    def points(self) -> Iterator[Index]:
        """Yield positions in this piece, the most expensive axis slowest.

        They stay at 0 on axes that invalidate nothing.
        """
        sizes = zip(self.axes, self.shape, strict=True)
        return self.combinations([range(size if axis.stage else 1) for axis, size in sizes])

    def combinations(self, choices: Sequence[Sequence[_T]]) -> Iterator[tuple[_T, ...]]:
        """Yield all combinations of the choices for each axis, the slowest axis slowest."""
        back = [self.order.index(place) for place in range(len(self.axes))]
        for combination in _product([choices[place] for place in self.order]):
            yield tuple(combination[place] for place in back)

    def problem(self, index: Index) -> Any:
        """Return the problem of one point of this piece."""
        return self.at(tuple(i + start for i, (start, _) in zip(index, self.spans, strict=True)))

    def started(self, index: Index, end: Any) -> Any:
        """Return the problem of one point of this piece that starts from an end, None: its own."""
        if end is None:
            return self.problem(index)
        assert self.follow is not None
        spans = zip(index, self.spans, strict=True)
        return self.follow(tuple(i + start for i, (start, _) in spans), end)

    def neglected(self) -> Iterator[list[str]]:
        """Yield what has no effect where the axes are at their least and at their largest values.

        Points that differ only by what has no effect are computed once, for one of them.
        """
        for extreme in (np.argmin, np.argmax):
            corner = tuple(int(extreme(axis.values)) for axis in self.axes)
            outcome = attempt(self.at, corner)
            yield getattr(outcome, "neglected", [])

    def label(self, index: Index) -> str:
        """Return the values of a point of this piece as text."""
        parts = []
        for axis, place, (start, _) in zip(self.axes, index, self.spans, strict=True):
            parts.append(f"{axis.name} = {axis.values[start + place]:.15g}")
        return ", ".join(parts)

    def piece(self, spans: tuple[Span, ...]) -> Problem:
        """Return the sweep over a part of the grid."""
        return replace(self, spans=spans)


def _product(choices: Sequence[Sequence[_T]]) -> Iterator[tuple[_T, ...]]:
    """Yield all combinations; unlike `itertools.product`, which copies millions of them first."""
    if not choices:
        yield ()
        return
    for one in choices[0]:
        for others in _product(choices[1:]):
            yield (one, *others)
