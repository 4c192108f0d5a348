"""What is asked: a computation at every point of a lattice of values of some of its fields."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import System
from vibroimpact_solvers.plan import Stage
from vibroimpact_solvers.sweep.stages import KINDS, Swept

KIND: Final = "sweep"
_STAGES: Final = {stage: rank for rank, stage in enumerate(Stage)}

Index = tuple[int, ...]
Span = tuple[int, int]
"""Start and end of a range of places on an axis."""


def rank(stage: Stage | None) -> int:
    """Return the place of a stage in the order in which they spoil one another; None is last."""
    return len(_STAGES) if stage is None else _STAGES[stage]


@dataclass(frozen=True, eq=False, slots=True)
class Axis:
    """One axis of the lattice.

    Parameters
    ----------
    path : str
        The field of the request that varies.
    name : str
        Of the dimension.
    values : array, shape (place,)
    unit, long_name : str
        Of the values, see `vibroimpact_solvers.arrays.Quantity`.
    stage : Stage or None
        The first stage that it spoils; None: none.
    why : str
        The sentence saying so, where it is none.
    moves : tuple of str
        Coordinates of the results that change with it.
    offset : int
        Place of the first value on the lattice that all axes of the same start and step share.
    """

    path: str
    name: str
    values: Floats
    unit: str = "1"
    long_name: str = ""
    stage: Stage | None = Stage.SPECTRUM
    why: str = ""
    moves: tuple[str, ...] = ()
    offset: int = 0


@dataclass(frozen=True, eq=False)
class Problem:
    """A computation at every point of a lattice.

    Parameters
    ----------
    kind : str
        Of the computation, one of `stages.KINDS`.
    axes : tuple of Axis
        Dimensions of the results, in their order.
    at : callable
        Returns the problem of one point, given a place on each axis; raises `ModelError` where
        there is none.
    system : System
        The structure of the base; tells the units.
    spans : tuple of (int, int), optional
        The ranges that this piece of the lattice covers; absent: everything.
    """

    kind: str
    axes: tuple[Axis, ...]
    at: Callable[[Index], Any]
    system: System
    spans: tuple[Span, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            message = f"sweeps are made of {', '.join(KINDS)}"
            raise ModelError(("kind",), message, code="unknown_choice")
        names = [axis.name for axis in self.axes]
        for place, name in enumerate(names):
            if name in names[:place]:
                message = f"two axes are called {name!r}"
                raise ModelError(("axes", place, "name"), message, code="duplicate_name")
        if not self.spans:
            whole = tuple((0, axis.values.size) for axis in self.axes)
            object.__setattr__(self, "spans", whole)

    @property
    def swept(self) -> Swept:
        """The row of the kind."""
        return KINDS[self.kind]

    @property
    def shape(self) -> Index:
        """Number of places on each axis."""
        return tuple(stop - start for start, stop in self.spans)

    @property
    def order(self) -> tuple[int, ...]:
        """The axes from the slowest to the fastest: the dearest first."""
        places = range(len(self.axes))
        return tuple(sorted(places, key=lambda place: rank(self.axes[place].stage)))

    def count(self, stage: Stage) -> int:
        """Return at how many points a stage is done."""
        size = 1
        for axis, places in zip(self.axes, self.shape, strict=True):
            if rank(axis.stage) <= rank(stage):
                size *= places
        return size

    def points(self, *, upto: Stage | None = None, above: Stage | None = None) -> Iterator[Index]:
        """Yield places on the axes, the dearest axis slowest, from 0 in this piece.

        Only axes that spoil a stage up to one, or above one, move; axes that spoil none rest.
        """
        ranges = []
        for place in self.order:
            of = rank(self.axes[place].stage)
            moves = of < len(_STAGES) and (
                (upto is None or of <= rank(upto)) and (above is None or of > rank(above))
            )
            ranges.append(range(self.shape[place]) if moves else range(1))
        back = [self.order.index(place) for place in range(len(self.axes))]
        for found in itertools.product(*ranges):
            yield tuple(found[place] for place in back)

    def problem(self, index: Index) -> Any:
        """Return the problem of one point of this piece."""
        return self.at(tuple(i + start for i, (start, _) in zip(index, self.spans, strict=True)))

    def called(self, index: Index) -> str:
        """Return a point of this piece in words."""
        found = []
        for axis, place, (start, _) in zip(self.axes, index, self.spans, strict=True):
            found.append(f"{axis.name} = {axis.values[start + place]:.15g}")
        return ", ".join(found)

    def piece(self, spans: tuple[Span, ...]) -> Problem:
        """Return the same over some of the lattice."""
        return replace(self, spans=spans)
