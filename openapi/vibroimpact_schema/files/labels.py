"""What files say of matrices: their names, and the nodes and directions of their rows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from vibroimpact_schema.imaginary import LOST

Label = tuple[int, str]
"""Node and direction of a degree of freedom."""
DIRECTIONS: Final = ("x", "y", "z", "rx", "ry", "rz")
"""Directions 1 to 6 of finite-element programs."""
_PLAIN: Final[Mapping[str, str]] = {
    **dict.fromkeys(("M", "MASS"), "M"),
    **dict.fromkeys(("K", "STIFFNESS", "STIF", "STIFF"), "K"),
    **dict.fromkeys(("C", "D", "DAMPING", "DAMP", "VISCOUSDAMPING", "DMPV"), "C"),
    **dict.fromkeys(("STRUCTURALDAMPING", "DMPS"), "K4"),
}
_SETS: Final = "AAX|AA|AX|GGX|GG|GX|2GG|2PP|PP|HH|HX|XX|NN|FF|LL|DD|JJ|QQ|TT|RR"
_NASTRAN: Final = re.compile(rf"(M|K4|K|B)(?:{_SETS})")
"""Matrix and set of degrees of freedom: MGG, KAAX, K2GG, BHH; K4AA is structural damping."""
_DIRECTIONS: Final[Mapping[str, str]] = {
    **{f"{number}": each for number, each in enumerate(DIRECTIONS, 1)},
    **{each: each for each in DIRECTIONS},
    **{f"u{each}": each for each in DIRECTIONS[:3]},
    **{f"rot{each[1]}": each for each in DIRECTIONS[3:]},
    **{f"ur{number}": each for number, each in enumerate(DIRECTIONS[3:], 1)},
    **{f"u{number}": each for number, each in enumerate(DIRECTIONS[:3], 1)},
    **{f"t{number}": each for number, each in enumerate(DIRECTIONS[:3], 1)},
    **{f"r{number}": each for number, each in enumerate(DIRECTIONS[3:], 1)},
    "0": "x",
}
"""Names of directions: 1 to 6, x to rz, and those of ANSYS, Abaqus and Nastran."""


STACKS: Final[Mapping[int, Sequence[str]]] = {1: ("",), 2: ("M", "K"), 3: ("M", "K", "C")}
"""Number of matrices behind another in one file, as texts or in one array -> their names."""


class ComplexMatrix:
    """A matrix with imaginary parts, which can be left out but not used."""

    def __init__(self, name: str, line: int) -> None:
        where = f"line {line}: " if line else ""
        self.reason = f"{where}{name} is complex: its imaginary part {LOST}"


@dataclass(frozen=True, eq=False)
class Content:
    """The matrices of a file.

    Parameters
    ----------
    matrices : mapping
        Name in the file -> matrix; one without a name is called "".
    labels : sequence of (int, str), optional
        Of the rows; empty: there are none; None: there are none, and the last rows may be missing.
    """

    matrices: Mapping[str, Any]
    labels: Sequence[Label] | None


def label(node: int, component: int) -> Label:
    """Return the label of component 1 to 6, or of a scalar point, which has 0."""
    direct = DIRECTIONS[component - 1] if 1 <= component <= 6 else f"{component}"
    return node, "x" if component == 0 else direct


def direction(text: str) -> str:
    """Return the direction that a program calls ``UX``, ``ROTZ``, ``3`` or ``x``.

    Raises
    ------
    ValueError
        If it is none.
    """
    known = _DIRECTIONS.get(text.strip().lower())
    if known is None:
        raise ValueError(f"{text.strip()[:20]!r} is no direction: x, y, z, rx, ry, rz or 1 to 6")
    return known


def meaning(name: str) -> str:
    """Return what the name of a matrix means: M, K, C, K4 of structural damping, or ""."""
    last = re.split(r"[./]", name)[-1].upper()
    if last in _PLAIN:
        return _PLAIN[last]
    match = _NASTRAN.fullmatch(last)
    return {"M": "M", "K": "K", "B": "C", "K4": "K4"}[match[1]] if match else ""


def of_file(stem: str) -> str:
    """Return the name of a matrix in that of its file: ``K``, ``job_STIF1``, ``mass-model``."""
    words = re.split(r"[_.\- ]", stem)
    for part in (stem, words[-1], words[0]):
        for name in (part, part.rstrip("0123456789")):
            if meaning(name):
                return name
    return stem


def chosen(available: Sequence[str], names: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return which names in a file are M, K and C: ``{"M": "MAAX", "K": "KAAX"}``.

    ``K`` is preferred to ``k``, and both to other names of it; structural damping is ``K4``.

    Parameters
    ----------
    available : sequence of str
        Names in the file.
    names : mapping, optional
        M, K or C -> the name it has, which counts more than all others.

    Raises
    ------
    ValueError
        If two names mean the same matrix and neither is preferred.
    """
    chosen_names = {own: given for own, given in (names or {}).items() if given in available}
    for own in ("M", "K", "C", "K4"):
        if own in chosen_names:
            continue
        same = [name for name in available if meaning(name) == own]
        for preferred in (own, own.lower(), ""):
            candidates = [
                name for name in same if not preferred or re.split(r"[./]", name)[-1] == preferred
            ]
            if len(candidates) > 1:
                way = f'names={{"{own}": "{candidates[0]}"}}'
                raise ValueError(f"{' and '.join(candidates)} can both be {own}: choose with {way}")
            if candidates:
                chosen_names[own] = candidates[0]
                break
    return chosen_names
