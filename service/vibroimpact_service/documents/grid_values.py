"""The values of grids of frequencies, times and other numbers."""

from __future__ import annotations

from decimal import Decimal
from typing import Any, Final

import numpy as np

from vibroimpact_schema import grids
from vibroimpact_schema.times import SECONDS
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Units


def grid_values(grid: Any, end: float = 0.0) -> Floats:
    """Return the values of a grid, shape (position,); one of a number of times goes to `end`."""
    if isinstance(grid, list):
        return np.array(grid, dtype=np.float64)
    if isinstance(grid, grids.EqualTimes):
        return np.linspace(0.0, end, grid.num)
    if hasattr(grid, "values"):
        return np.array(grid.values, dtype=np.float64)
    if hasattr(grid, "num"):
        return np.linspace(grid.start, grid.stop, grid.num)
    exact = decimal_steps(grid.start, grid.step, grid.count)
    steps = np.arange(grid.count, dtype=np.float64)
    values = grid.start + grid.step * steps if exact is None else exact
    # The last step may pass the end by rounding.
    values[-1] = min(values[-1], grid.stop)
    return values


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
    if max(abs(begin), abs(by), abs(begin + by * (count - 1))) >= 2**53:
        return None
    values: Floats = (begin + by * np.arange(count)).astype(np.float64) / 10.0**places
    return values


_PER_SECOND: Final = {"Hz": 1.0, "rpm": 1.0 / 60.0}


def to_fundamental(
    unit: str, units: Units | None, where: tuple[str, ...] = ("frequency", "unit")
) -> float:
    """Return the fundamental angular frequency Omega that 1 in a unit of frequencies stands for.

    Raises
    ------
    ModelError
        At `where`, if the unit needs a unit of time that the structure's is not.
    """
    if unit not in _PER_SECOND:
        return 1.0 if unit == "Omega" else 0.5 * np.pi
    time = "s" if units is None else units.time
    if time not in SECONDS:
        message = f"{unit} needs a unit of time that is one of {', '.join(SECONDS)}, not {time}"
        raise ModelError(where, message, code="unknown_unit")
    return 2.0 * np.pi * _PER_SECOND[unit] * SECONDS[time]


def frequencies(grid: Any, units: Units | None = None) -> tuple[Floats, Floats]:
    """Return (Omega, omega) of a grid, each shape (frequency,); the one given, to the bit."""
    given = grid_values(grid)
    if grid.unit == "omega":
        return given * (np.pi / 2.0), given
    Omega = given * to_fundamental(grid.unit, units)
    return Omega, Omega * (2.0 / np.pi)
