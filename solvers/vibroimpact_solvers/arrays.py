"""Types of arrays, and the declaration of a result's fields: dimensions, unit, name, error.

Each field of a result class is declared once, in its annotation::

    x: Annotated[Floats | None, Quantity(("time", "dof"), "length", "displacement")]

Documents, files, ensembles, sweeps and the tables of the documentation follow from it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType, NoneType, UnionType
from typing import Annotated, Any, Final, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]
Integers = NDArray[np.int64]

EPS: Final = float(np.finfo(np.float64).eps)
"""Distance from 1 to the next number."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """Declaration of a field of a result: an array, a number or a text."""

    dims: tuple[str, ...]  # names of its axes, such as ``("frequency", "constraint")``
    # Product of powers of length, mass and time, such as ``"length mass time-2"`` (``"1"`` for a
    # pure number); the writer of a file replaces them by real units
    unit: str
    long_name: str  # label of a plot's axis
    coordinate: bool = False  # whether the array labels one of the axes
    flags: tuple[str, ...] = ()  # meanings of the codes 0, 1, …
    # Place in documents and files, such as ``"frequency/Omega"``; empty: the field's own name
    path: str = ""
    # Whether documents hold a list of objects at the first part of the path, of which this is one
    # field, such as ``"bands/start"``
    record: bool = False
    # The dimension whose rows it counts, where the rows of many points follow one another in it
    # (a contiguous ragged array of the CF conventions)
    rows_of: str = ""
    note: str = ""  # what the documentation adds
    # When there is no finite number, but null in documents, and nan or inf in files
    missing: str = ""
    error: str = ""  # path of its error
    # The integers that occur, empty for any; None: those from 0
    integers: tuple[int, ...] | None = None
    sometimes: bool = False  # whether it may be absent where others of its group are there


@dataclass(frozen=True, slots=True)
class Group:
    """Declaration of the fields whose paths begin alike, such as ``"error/…"``."""

    name: str  # name of their document
    about: str  # a sentence about them
    together: bool = True  # whether optional ones are all there or all absent


@dataclass(frozen=True, slots=True)
class Field:
    """A field of a result class."""

    name: str
    scalar: Any  # float, int, bool or str, of an array its elements; or ``list[str]``
    array: bool
    optional: bool  # whether the field may be None, where it was not requested
    quantity: Quantity

    @property
    def path(self) -> str:
        """Place in documents and files."""
        return self.quantity.path or self.name


@dataclass(frozen=True, eq=False)
class Described:
    """A result whose arrays depend on the problem."""

    arrays: Mapping[str, NDArray[Any]]  # values by name
    meanings: Mapping[str, Quantity]  # their declarations, by the same names
    plain: Mapping[str, Any]  # what is not an array, by its path, such as ``"error/statement"``


_SCALARS: Final[Mapping[Any, type]] = {Floats: float, Integers: int, Booleans: bool}


def declared(result: type[Any]) -> Mapping[str, Field]:
    """Return the declared fields of a result class by name."""
    if result not in _declared:
        hints = get_type_hints(result, include_extras=True)
        names = [field.name for field in dataclasses.fields(result)]
        annotated = {name: hints[name] for name in names if get_origin(hints[name]) is Annotated}
        fields = {name: _field(name, *get_args(hint)) for name, hint in annotated.items()}
        _declared[result] = MappingProxyType(fields)
    return _declared[result]


_declared: Final[dict[type[Any], Mapping[str, Field]]] = {}
"""Cache: evaluating annotations takes longer than many a computation."""


def nothing(result: type[Any]) -> dict[str, Any]:
    """Return all fields of a result class as None."""
    return dict.fromkeys(field.name for field in dataclasses.fields(result))


def along(result: type[Any], *dims: str) -> tuple[str, ...]:
    """Return the names of a result's arrays whose first axis is one of these."""
    fields = declared(result).values()
    return tuple(f.name for f in fields if f.quantity.dims and f.quantity.dims[0] in dims)


def _field(name: str, hint: Any, quantity: Quantity) -> Field:
    optional = isinstance(hint, UnionType)
    if optional:
        (hint,) = (part for part in get_args(hint) if part is not NoneType)
    return Field(name, _SCALARS.get(hint, hint), hint in _SCALARS, optional, quantity)
