"""What an array of a result is: its dimensions, unit and name, written at the field itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any, Final, get_type_hints

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Quantity:
    """Meaning of an array.

    Parameters
    ----------
    dims : tuple of str
        Names of its axes, such as ``("frequency", "constraint")``.
    unit : str
        Product of powers of length, mass and time, such as ``"length mass time-2"``
        (``"1"`` for a pure number); the writer of a file replaces them by real units.
    long_name : str
        What a plot would write at the axis.
    coordinate : bool
        Whether the array labels one of the axes.
    flags : tuple of str
        For codes 0, 1, …: the meaning of each.
    path : str
        Where documents and files hold it, such as ``"frequency/Omega"``; empty: under the
        field's own name.
    record : bool
        Whether documents hold a list of objects at the first part of the path, of which this
        is one field, such as ``"bands/start"``.
    rows_of : str
        The dimension whose rows it counts, where the rows of many points stand one after the
        other in it (a contiguous ragged array of the CF conventions).
    """

    dims: tuple[str, ...]
    unit: str
    long_name: str
    coordinate: bool = False
    flags: tuple[str, ...] = ()
    path: str = ""
    record: bool = False
    rows_of: str = ""


@dataclass(frozen=True, eq=False)
class Described:
    """A result whose arrays are not known before it is there.

    Parameters
    ----------
    arrays : mapping
        Values by name.
    meanings : mapping
        What they are, by the same names.
    plain : mapping
        What is not an array, by its path, such as ``"error/statement"``.
    """

    arrays: Mapping[str, NDArray[Any]]
    meanings: Mapping[str, Quantity]
    plain: Mapping[str, Any]


_QUANTITIES: Final[dict[type[Any], Mapping[str, Quantity]]] = {}


def quantities(result: type[Any]) -> Mapping[str, Quantity]:
    """Return the quantity of every annotated field of a result class, by field name."""
    known = _QUANTITIES.get(result)
    if known is None:
        # To read annotations takes longer than most results.
        known = _QUANTITIES[result] = MappingProxyType(_quantities(result))
    return known


def _quantities(result: type[Any]) -> dict[str, Quantity]:
    hints = get_type_hints(result, include_extras=True)
    found: dict[str, Quantity] = {}
    for field in fields(result):
        for note in getattr(hints[field.name], "__metadata__", ()):
            if isinstance(note, Quantity):
                found[field.name] = note
    return found
