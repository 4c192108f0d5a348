"""Documents of frequencies, times and axes of sweeps."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Integral
from typing import Any, Final

from vibroimpact.arguments import Document, integer, number, numbers

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


def axis(path: str, values: Any) -> Document:
    """Return the document of a sweep axis.

    Parameters
    ----------
    path : str
        Path of the number that varies, such as ``"system.constraints.0.gap"``.
    values : array, (start, stop, num) or dict
        Values of the number. Sweeps over ``start``, ``stop`` and ``step`` reuse the parts that
        longer or shifted sweeps with the same step have computed; ``name`` names the dimension.
    """
    return {"path": path} | times(values, path)
