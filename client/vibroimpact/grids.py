"""Documents of frequencies, times and axes of sweeps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import Any, Final

import numpy as np

from vibroimpact.arguments import Document, integer, number, numbers
from vibroimpact_schema.times import SECONDS

_FEW: Final = 10
"""Three integers of which the last is smaller look like three values."""


def frequencies(given: Any, unit: str = "Omega") -> Document:
    """Return the document of frequencies: an array, a mapping, or (start, stop, num)."""
    return {"unit": unit} | times(given, "frequency")


def times(given: Any, name: str = "the values") -> Document:
    """Return the document of times: an array, a mapping, or (start, stop, num).

    Raises
    ------
    ValueError
        If a tuple of three numbers can be meant as three values.
    """
    if isinstance(given, Mapping):
        return dict(given)
    if isinstance(given, tuple) and len(given) == 3:
        return _equally_spaced(*given)
    return {"values": numbers(name, given)}


def _equally_spaced(start: Any, stop: Any, num: Any) -> Document:
    whole = [isinstance(part, Integral) for part in (start, stop, num)]
    if not whole[2] or (all(whole) and num < _FEW):
        raise ValueError(
            f"({start}, {stop}, {num}) can mean three values or (start, stop, num): write "
            f"[{start}, {stop}, {num}] for three values, "
            f'{{"start": {start}, "stop": {stop}, "num": n}} for n equally spaced ones'
        )
    return {
        "start": number("start", start),
        "stop": number("stop", stop),
        "num": integer("num", num),
    }


def axes(given: Mapping[str, Any] | Sequence[Mapping[str, Any]]) -> list[Document]:
    """Return the documents of sweep axes.

    Parameters
    ----------
    given : mapping or sequence of dict
        Path of the number that varies, such as ``"system.constraints.0.gap"`` -> its values: an
        array, (start, stop, num) or a dictionary; or such documents, each with its ``path``.
        Sweeps over ``start``, ``stop`` and ``step`` reuse the parts that longer or shifted sweeps
        with the same step have computed; ``name`` names the dimension.

    Raises
    ------
    TypeError
        If they are neither, or a document has no path.
    """
    if isinstance(given, Mapping):
        return [{"path": path} | times(values, path) for path, values in given.items()]
    if not all(isinstance(each, Mapping) and "path" in each for each in given):
        raise TypeError("axes must map paths to values, or be dictionaries with a path each")
    return [dict(each) for each in given]


def angular(unit: str, time: str = "s") -> float:
    """Return the angular frequency Omega that 1 in a unit of frequencies stands for.

    Parameters
    ----------
    unit : str
        "Omega", "omega" (2/pi of it), "Hz" or "rpm".
    time : str
        The unit of time of Omega.

    Raises
    ------
    ValueError
        If it is no unit of frequencies, or the unit of time has no known length.
    """
    if unit in ("Omega", "omega"):
        return 1.0 if unit == "Omega" else 0.5 * math.pi
    if unit not in ("Hz", "rpm") or time not in SECONDS:
        raise ValueError(f"frequencies per {time} have no value in {unit!r}: Hz, rpm, Omega, omega")
    return 2.0 * math.pi * SECONDS[time] / (60.0 if unit == "rpm" else 1.0)


def values(given: Any, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the values of an array, (start, stop, num), or a document of either.

    Raises
    ------
    ValueError
        If a document has a step.
    """
    document = times(given, name)
    if "values" in document:
        return np.asarray(document["values"], dtype=np.float64)
    if "num" not in document:
        raise ValueError(f"{name} needs values, or start, stop and num")
    return np.linspace(document["start"], document["stop"], document["num"])
