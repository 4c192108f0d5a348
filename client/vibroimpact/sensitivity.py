"""How much a result of a reduced model owes to its modes: the same with half of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from vibroimpact.tables import Array, Table

if TYPE_CHECKING:
    from vibroimpact.result_file import ResultFile

_AXES = frozenset({"omega"})
"""What is no axis in files, but given by one: the frequency, counted in another way."""
_AROUND: Final = {"impact": ("phase", "time"), "contact": ("phase", "time")}
"""Columns of tables that are counted around a period, so that their ends are close."""


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """What changes in a result where half of the modes are left out.

    It is no error bound: answers that do not converge, such as impulses of rigid stops, change as
    much by the other half of the modes and by those that the reduction never had.

    Parameters
    ----------
    modes, half_modes : int
        Elastic modes of the reduced model, and of its half.
    half : Result
        The result with half of the modes.
    change : mapping of str to array
        Absolute change of each output that both have in the same shape, of that shape, in its unit;
        of displacements, that of the kept degrees of freedom. True where a yes or no differs; nan
        where one of them has no value. ``"contact.duration"`` is that of a column of a table, where
        both tables have the same rows by their numbers of motions, stops and sides.
    rows : mapping of str to (int, int)
        Rows of each table: with all modes, with half of them.
    size : mapping of str to float
        Largest value of each of these outputs.
    """

    modes: int
    half_modes: int
    half: ResultFile
    change: dict[str, Array]
    rows: dict[str, tuple[int, int]]
    size: dict[str, float]

    @classmethod
    def between(
        cls, result: ResultFile, half: ResultFile, modes: int, half_modes: int, kept: int
    ) -> Sensitivity:
        """Compare the results of a reduced model and of that with half of its modes.

        Parameters
        ----------
        result, half : Result
            What is compared.
        modes, half_modes : int
            Elastic modes of both.
        kept : int
            Degrees of freedom that both models have, the first ones.
        """
        change: dict[str, Array] = {}
        sizes: dict[str, float] = {}
        names = [name for name in result.outputs() if name in half and name not in _AXES]
        pairs = {name: (getattr(result, name), getattr(half, name)) for name in names}
        for name in result.row_counts():
            if name in half:
                pairs |= _columns(name, getattr(result, name), getattr(half, name))
        for name, (mine, theirs) in pairs.items():
            alike = _alike(np.asarray(mine), np.asarray(theirs), kept)
            if alike is not None:
                change[name] = _change(*alike)
                finite = np.abs(alike[0][np.isfinite(alike[0])])
                sizes[name] = float(finite.max(initial=0.0))
        counts = {name: (rows, half.row_counts().get(name, 0))
                  for name, rows in result.row_counts().items()}  # fmt: skip
        return cls(modes, half_modes, half, change, counts, sizes)

    def relative(self, output: str) -> float:
        """Return the largest change of an output relative to its largest value; nan: unknown."""
        change, size = self.change[output], self.size[output]
        largest = float(np.nanmax(change)) if np.isfinite(change).any() else np.nan
        return largest / size if size else (0.0 if largest == 0.0 else np.nan)

    def __str__(self) -> str:
        """Return a sentence such as ``with 1 of 3 modes, impulse changes by up to 50 %``."""
        parts, largest = [], dict[str, tuple[float, str]]()
        for name, change in self.change.items():
            table, _, column = name.partition(".")
            if column:
                if np.isfinite(self.relative(name)):
                    largest[table] = max(
                        largest.get(table, (0.0, "")), (self.relative(name), column)
                    )
            elif change.dtype == np.bool_:
                parts.append(f"{name} differs at {int(change.sum())} of {change.size}")
            elif np.isfinite(self.relative(name)):
                share = 100.0 * self.relative(name)
                parts.append(f"{name} changes by up to {share:.2g} % of its largest value")
        for name, (rows, half) in self.rows.items():
            share, column = largest.get(name, (0.0, ""))
            if column:
                parts.append(f"columns of {name} change by up to {100.0 * share:.2g} % ({column})")
            elif rows or half:
                parts.append(f"{name} has {half} rows instead of {rows}")
        return f"with {self.half_modes} of {self.modes} modes, {', '.join(parts) or 'nothing'}"


def _columns(name: str, first: Table, second: Table) -> dict[str, tuple[Array, Array]]:
    """Return the columns of numbers of two tables with the same rows, by the names of both."""
    columns = [column for column in first if column in second]
    pairs = {each: (np.asarray(first[each]), np.asarray(second[each])) for each in columns}
    reals = [each for each in columns if pairs[each][0].dtype.kind == "f"]
    others = (pairs[each] for each in columns if each not in reals)
    if first.rows != second.rows or not all(np.array_equal(*pair) for pair in others):
        return {}
    left = _AROUND.get(name, ())
    return {f"{name}.{each}": pairs[each] for each in reals if each not in left}


def _alike(first: Array, second: Array, kept: int) -> tuple[Array, Array] | None:
    """Return two outputs in one shape, or None: the kept degrees of freedom of displacements."""
    if first.dtype.kind not in "biufc" or first.ndim != second.ndim:
        return None
    other = [axis for axis in range(first.ndim) if first.shape[axis] != second.shape[axis]]
    if len(other) > 1:
        return None
    for axis in other:
        if min(first.shape[axis], second.shape[axis]) < kept:
            return None
        first, second = (each.take(range(kept), axis) for each in (first, second))
    return first, second


def _change(first: Array, second: Array) -> Array:
    if first.dtype == np.bool_:
        return np.asarray(first != second)
    return np.asarray(np.abs(np.asarray(first, dtype=np.result_type(first, float)) - second))
