"""Units of derived quantities as engineers write them: N, J, kg m/s, rad/s."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

_BASE: Final = ("mass", "length", "time")
_SI: Final = {
    "mass": {"kg": 0, "g": -3, "t": 3, "Mg": 3, "mg": -6},
    "length": {"m": 0, "mm": -3, "cm": -2, "km": 3, "um": -6, "µm": -6},
    "time": {"s": 0, "ms": -3, "us": -6, "µs": -6, "ns": -9},
}
"""Powers of ten of the units that occur, in kg, m and s."""
_NAMED: Final[Mapping[tuple[float, ...], str]] = {
    (1, 1, -2): "N",
    (1, 2, -2): "J",
    (1, 0, -2): "N/m",
    (1, 2, -3): "W",
}
"""Powers of mass, length and time that have a name."""
_PREFIXES: Final = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


def unit(dimension: str, units: Mapping[str, str] | None) -> str:
    """Return the unit of a dimension such as "mass length time-2" in a set of units.

    Frequencies are angular. Without a set of units everything is dimensionless, "1".
    """
    if units is None or dimension == "1":
        return "1"
    if dimension == "time-1":
        return f"rad/{units['time']}"
    powers, others = dict.fromkeys(_BASE, 0.0), []
    for factor in dimension.split():
        base = factor.rstrip("-.0123456789")
        if base in powers:
            powers[base] += float(factor[len(base) :] or 1)
        else:
            others.append(factor)
    named = _named(powers, units) if not others else None
    return named or _quotient(_factors(powers, units), others)


def _factors(powers: Mapping[str, float], units: Mapping[str, str]) -> list[tuple[str, float]]:
    """Return the symbols of units and their powers: those of lbf s2/in times in/s2 are lbf."""
    composed = any(sign in units[base] for base in _BASE for sign in " /")
    if not composed:
        return [(units[base], powers[base]) for base in _BASE]
    together: dict[str, float] = {}
    for base in _BASE:
        sign = 1.0
        for part in re.findall(r"[ /]|[^ /]+", units[base]):
            if part in " /":
                sign = -1.0 if part == "/" else 1.0
                continue
            symbol = part.rstrip("0123456789")
            power = sign * float(part[len(symbol) :] or 1)
            together[symbol] = together.get(symbol, 0.0) + power * powers[base]
    return list(together.items())


def _named(powers: Mapping[str, float], units: Mapping[str, str]) -> str | None:
    """Return a named unit with its prefix, None where there is none."""
    name = _NAMED.get(tuple(powers[base] for base in _BASE))
    if name is None or any(units[base] not in _SI[base] for base in _BASE):
        return None
    ten = sum(_SI[base][units[base]] * power for base, power in powers.items())
    return _PREFIXES[int(ten)] + name if ten in _PREFIXES else None


def _quotient(factors: list[tuple[str, float]], others: list[str]) -> str:
    above = [_power(symbol, power) for symbol, power in factors if power > 0] + others
    below = [_power(symbol, -power) for symbol, power in factors if power < 0]
    return "/".join([" ".join(above) or "1", *below])


def _power(symbol: str, power: float) -> str:
    if power % 1.0:
        return f"{symbol}^{power:g}"
    return symbol if power == 1 else f"{symbol}{power:g}"
