"""Records of the motion of a base: from files and arrays to loads of time histories.

Needs scipy:  ``pip install 'vibroimpact[models]'``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import scipy.interpolate

from vibroimpact import loads
from vibroimpact_schema import number_tables
from vibroimpact_schema.files import text_files
from vibroimpact_schema.number_tables import TextError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from vibroimpact import documents

    Floats = NDArray[np.floating[Any]]

_LEAST: Final[Mapping[str, int]] = {"acceleration": 2, "velocity": 3, "displacement": 4}
"""Quantity of a record -> samples that it has at least, for a spline of its degree."""
_PEER: Final[Mapping[str, str]] = {
    ".at2": "acceleration", ".vt2": "velocity", ".dt2": "displacement",
}  # fmt: skip
"""Ending of a file of PEER -> what it has."""
_HEADS: Final = (
    re.compile(r"NPTS *= *(?P<count>[0-9]{1,9}) *, *DT *= *(?P<step>[0-9.]{1,12})"),
    re.compile(r"^ *(?P<count>[0-9]{1,9}) +(?P<step>[0-9.]{1,12}) +NPTS *, *DT"),
)
"""The line before the values of PEER, whose form has changed over the years."""
_HEAD_LINES: Final = 10


@dataclass(frozen=True, eq=False)
class Record:
    """Samples of the motion of a base.

    Parameters
    ----------
    t : array, shape (sample,)
        Ascending times, the first one at 0 or before.
    values : array, shape (sample,)
    quantity : str
        What they are: "acceleration", "velocity" or "displacement".

    Raises
    ------
    ValueError
        If times do not ascend, or there are too few samples or numbers that are not finite.
    """

    t: Any
    values: Any
    quantity: str = "acceleration"

    def __post_init__(self) -> None:
        least = _LEAST.get(self.quantity)
        if least is None:
            raise ValueError(f"quantity: {', '.join(_LEAST)} are known, not {self.quantity!r}")
        t, values = (np.asarray(each, dtype=np.float64) for each in (self.t, self.values))
        if t.ndim != 1 or t.shape != values.shape:
            raise ValueError(f"t {t.shape} and values {values.shape} are not as many numbers")
        if t.size < least:
            raise ValueError(f"values: {t.size} samples of the {self.quantity}; at least {least}")
        if not (np.isfinite(t).all() and np.isfinite(values).all()):
            raise ValueError("t and values: not all numbers are finite")
        if (np.diff(t) <= 0.0).any():
            raise ValueError("t: times do not ascend")
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "values", values)

    def acceleration(self) -> tuple[Floats, Floats]:
        """Return times, and the acceleration there, which is a straight line between them.

        A displacement is interpolated by the cubic spline through the samples, a velocity by the
        quadratic one with knots halfway between them [C. de Boor, A Practical Guide to Splines,
        chapters IV and VI]. Their second and first derivatives are straight lines between knots, so
        that the base moves through the samples exactly.
        """
        t, values = self.t, self.values
        if self.quantity == "acceleration":
            return t, values
        if self.quantity == "displacement":
            return t, scipy.interpolate.CubicSpline(t, values)(t, 2)
        slope = scipy.interpolate.make_interp_spline(t, values, k=2).derivative()
        knots = np.unique(slope.t)
        return knots, slope(knots)

    def base_motion(
        self, base: ArrayLike | str = "acceleration", *, until: float | None = None
    ) -> documents.BaseMotion:
        """Return the load of a structure on this base.

        The initial velocity of the structure is relative to that which the base has at first.

        Parameters
        ----------
        base : array or str
            As of `base_motion`; by default, the structure has its `influence`.
        until : float, optional
            A time that the load lasts to: where the samples end before, their acceleration goes to
            zero within one more interval, and stays there. Default: it ends with the samples.
        """
        t, acceleration = self.acceleration()
        if until is not None and until > t[-1]:
            rest = 2.0 * t[-1] - t[-2]
            more = [rest, until] if until > rest else [rest]
            t = np.append(t, more)
            acceleration = np.append(acceleration, np.zeros(len(more)))
        return loads.base_motion(base, acceleration, t)


def read_record(
    path: str | Path,
    quantity: str | None = None,
    *,
    scale: float = 1.0,
    interval: float | None = None,
) -> Record:
    """Return the record in a file.

    Parameters
    ----------
    path : path
        ``.AT2``, ``.VT2`` or ``.DT2`` of the PEER ground motion databases (NPTS and DT on the last
        line of their heads); or a text with rows ``time, value`` or ``value``.
    quantity : str, optional
        What the values of a text are: "acceleration" (default), "velocity" or "displacement".
    scale : float
        What is multiplied with the values: the unit of the file in those of the structure, 9.80665
        of accelerations in g where the structure has m and s.
    interval : float, optional
        The time between two values of a text that has no times.

    Raises
    ------
    ValueError
        If it has another layout, with the line at fault.
    """
    path = Path(path)
    data = path.read_bytes()
    says = _PEER.get(path.suffix.lower())
    if says is not None and (quantity not in (None, says) or interval is not None):
        raise ValueError(f"{path}: the file says itself that it has the {says}, and the interval")
    try:
        if says is None:
            t, values = _columns(text_files.numbers(number_tables.plain(data)), interval)
        else:
            t, values = _peer(data.decode("latin-1"))
        return Record(t, scale * values, says or quantity or "acceleration")
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _peer(text: str) -> tuple[Floats, Floats]:
    """Return times and values of a text as of https://peer.berkeley.edu/smcat/data.html."""
    lines = text.splitlines()
    heads = [
        (number, head)
        for number, line in enumerate(lines[:_HEAD_LINES], 1)
        for form in _HEADS
        if (head := form.search(line.upper()))
    ]
    if not heads:
        raise TextError(1, f"no line with NPTS and DT among the first {_HEAD_LINES}")
    number, head = heads[0]
    parts = [np.zeros(0)]
    for at, line in enumerate(lines[number:], number + 1):
        try:
            parts.append(np.array(line.split(), dtype=np.float64))
        except ValueError:
            raise TextError(at, f"{line.strip()[:40]!r} is no row of numbers") from None
    values = np.concatenate(parts)
    count = int(head["count"])
    if values.size != count:
        raise TextError(number, f"{count} values are announced, {values.size} follow")
    return float(head["step"]) * np.arange(count), values


def _columns(table: Floats, interval: float | None) -> tuple[Floats, Floats]:
    """Return times and values of the rows of a text."""
    if table.shape[1] == 2 and interval is None:
        return table[:, 0], table[:, 1]
    if table.shape[1] == 1 and interval is not None:
        return interval * np.arange(len(table)), table[:, 0]
    have = f"{table.shape[1]} numbers in a row"
    raise ValueError(f"{have}: two are time and value, one is a value, with interval=")
