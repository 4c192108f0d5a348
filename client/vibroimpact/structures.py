"""Structures as text: what they are and their stops, in a line, instead of all their numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

_MORE = "damping", "dashpots", "force", "influence", "residual_flexibility"
_OTHER = frozenset({"preset", "constraints", "units", *_MORE})
_MOST_STOPS = 4


class Structure(dict[str, Any]):
    """The document of a structure, which says in a line what it is.

    Examples
    --------
    >>> Structure(preset="chain", n=13, constraints=[{"dof": 5, "gap": 0.2, "restitution": 1.0}])
    <Structure chain: n 13; stop at coordinate 5, gap ±0.2>
    """

    def __repr__(self) -> str:
        """Return its form, its numbers and its stops."""
        if "preset" in self:
            numbers = [f"{name} {self[name]:g}" for name in self if name not in _OTHER]
            form = f"{self['preset']}: {', '.join(numbers)}" if numbers else self["preset"]
        else:
            form = ", ".join(f"{name} {_matrix(self[name])}" for name in "MKC" if name in self)
        more = [name for name in _MORE if name in self]
        parts = [form, *([f"with {', '.join(more)}"] if more else []), _stops(self["constraints"])]
        return f"<Structure {'; '.join(parts)}>"


def _matrix(form: Any) -> str:
    """Return the size of a matrix and how it is given."""
    if not isinstance(form, Mapping):
        return f"{len(form)} × {len(form)}"
    if "diagonal" in form:
        return f"{len(form['diagonal'])} × {len(form['diagonal'])}, diagonal"
    return f"{form['shape'][0]} × {form['shape'][1]}, {len(form['data'])} entries"


def _stops(constraints: Any) -> str:
    if not constraints:
        return "no stop"
    said = [_stop(each) for each in constraints[:_MOST_STOPS]]
    left = len(constraints) - len(said)
    head = "stop" if len(constraints) == 1 else f"{len(constraints)} stops"
    return f"{head} {', '.join(said)}{f' and {left} more' if left else ''}"


def _stop(each: Any) -> str:
    """Return what a stop is; documents that only the service will refuse have a text as well."""
    try:
        return _sound_stop(each)
    except (AttributeError, KeyError, TypeError, ValueError):
        return f"{each!r:.60}"


def _sound_stop(each: Mapping[str, Any]) -> str:
    direction = each.get("direction")
    dofs = [each["dof"]] if direction is None else direction["dofs"]
    place = f"at coordinate{'s' if len(dofs) > 1 else ''} {' and '.join(map(str, dofs))}"
    gap = each["gap"]
    if isinstance(gap, Mapping):
        # The lower gap is counted downwards.
        lower, upper = gap.get("lower"), gap.get("upper")
        low = "-inf" if lower is None else f"{-np.float64(lower) + 0.0:g}"
        limits = f"from {low} to {'inf' if upper is None else format(upper, 'g')}"
    else:
        limits = f"gap ±{gap:g}"
    law = each.get("law") or {}
    kind = f", {law['type']}" if law.get("type", "rigid") != "rigid" else ""
    lost = each.get("restitution", 1.0)
    return f"{place}, {limits}{kind}{'' if lost == 1.0 or kind else f', restitution {lost:g}'}"
