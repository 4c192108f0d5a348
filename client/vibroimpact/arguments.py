"""Numbers of callers as requests have them; errors name the argument."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vibroimpact_schema.imaginary import real

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Document = dict[str, Any]
"""A request, or an object in one."""


def number(name: str, given: Any) -> float:
    """Return a real number.

    Raises
    ------
    TypeError
        If it is none; texts of numbers are none.
    """
    if not isinstance(given, str | bytes):
        try:
            return float(given)
        except (TypeError, ValueError, OverflowError):
            pass
    raise TypeError(f"{name} must be a number, not {_shown(given)}")


def unit_names(given: Any) -> dict[str, str]:
    """Return the units of a structure.

    Raises
    ------
    TypeError
        If they are not a mapping of length, mass and time, and no more, to names.
    """
    if isinstance(given, Mapping) and set(given) == {"length", "mass", "time"}:
        return dict(given)
    raise TypeError(
        'units must be a mapping, such as {"length": "m", "mass": "kg", "time": "s"}, '
        f"not {_shown(given)}"
    )


def integer(name: str, given: Any) -> int:
    """Return an integer, which may be given as a float such as 3.0.

    Raises
    ------
    TypeError
        If it is no number.
    ValueError
        If it has a fraction or is not finite.
    """
    if isinstance(given, int):
        return int(given)
    value = number(name, given)
    if not value.is_integer():
        raise ValueError(f"{name} must be an integer, not {_shown(given)}")
    return int(given)


def integers(name: str, given: Any) -> list[int]:
    """Return integers as a list.

    Raises
    ------
    TypeError, ValueError
        If one of them is none.
    """
    return [integer(f"{name}[{at}]", each) for at, each in enumerate(_several(name, given))]


def numbers(name: str, given: Any) -> list[float]:
    """Return real numbers as a list, also of a single one.

    Raises
    ------
    TypeError, ValueError
        If one of them is none, or has an imaginary part.
    """
    values: list[float] = np.atleast_1d(array(name, given)).tolist()
    return values


def rows(name: str, given: ArrayLike) -> list[list[float]]:
    """Return rows of numbers; one row may be given alone.

    Raises
    ------
    TypeError, ValueError
        If one of the numbers is none, or rows differ in length.
    """
    values: list[list[float]] = np.atleast_2d(array(name, given)).tolist()
    return values


def array(name: str, given: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return numbers as an array of the shape in which they are given.

    Raises
    ------
    TypeError, ValueError
        If one of them is none or has an imaginary part, or rows differ in length.
    """
    try:
        values = np.asarray(given)
    except ValueError:
        raise ValueError(f"the rows of {name} differ in length") from None
    if values.dtype.kind in "SU":
        raise TypeError(f"{name} must be numbers, not {_shown(given)}")
    values = real(name, values)
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"{name} must be numbers, not {_shown(given)}") from None


def documents(name: str, given: Any) -> list[dict[str, Any]]:
    """Return documents, such as the terms of a load, as a list; one may be given alone.

    Raises
    ------
    TypeError
        If one of them is no document.
    """
    try:
        return [dict(each) for each in ([given] if isinstance(given, dict) else given)]
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be documents, not {_shown(given)}") from None


def hyphenated(kind: str) -> str:
    """Return a kind of computation as requests spell it, also given as methods are called."""
    return kind.replace("_", "-")


def names(outputs: Sequence[str]) -> list[str]:
    """Return the names of outputs, also of a single one."""
    return [outputs] if isinstance(outputs, str) else list(outputs)


def _several(name: str, given: Any) -> list[Any]:
    if not isinstance(given, str | bytes | Mapping):
        try:
            return list(given)
        except TypeError:
            pass
    raise TypeError(f"{name} must be integers in a list or array, not {_shown(given)}")


_LONGEST = 60
"""Characters of a wrong value that its error shows."""


def _shown(given: Any) -> str:
    text = repr(given)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
