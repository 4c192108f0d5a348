"""What files say of matrices: their names, and the nodes and directions of their rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from vibroimpact.models.model import DIRECTIONS, Label

ALIASES: Final[Mapping[str, str]] = {
    **dict.fromkeys(
        ("M", "MASS", "MAA", "MAAX", "MGG", "MGGX", "MXX", "MHH", "M2GG", "M2PP"), "M"
    ),
    **dict.fromkeys(
        ("K", "STIFFNESS", "STIF", "KAA", "KAAX", "KGG", "KGGX", "KXX", "KHH", "K2GG", "K2PP"), "K"
    ),
    **dict.fromkeys(
        ("C", "D", "DAMPING", "VISCOUSDAMPING", "BAA", "BAAX", "BGG", "BGGX", "BXX", "BHH",
         "B2GG", "B2PP"), "C",
    ),
}  # fmt: skip
"""Names of matrices in files, in capitals -> M, K or C."""


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


def chosen(available: Sequence[str], names: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return which names in a file are M, K and C: ``{"M": "MAAX", "K": "KAAX"}``.

    ``K`` is preferred to ``k``, and both to other names of it.

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
    for own in ("M", "K", "C"):
        if own in chosen_names:
            continue
        same = [name for name in available if ALIASES.get(name.upper()) == own]
        for preferred in ([own], [own.lower()], same):
            candidates = [name for name in preferred if name in same]
            if len(candidates) > 1:
                way = f'names={{"{own}": "{candidates[0]}"}}'
                raise ValueError(f"{' and '.join(candidates)} can both be {own}: choose with {way}")
            if candidates:
                chosen_names[own] = candidates[0]
                break
    return chosen_names
