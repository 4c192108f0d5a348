"""Motions as universal files, which programs of modal tests read: data sets 15 and 58.

The layout: University of Cincinnati, Structural Dynamics Research Laboratory, Universal File
Formats for Modal Analysis Testing, data sets 15 (nodes) and 58 (functions of a degree of freedom).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from vibroimpact.tables import Array

QUANTITIES: Final[Mapping[str, int]] = {
    "displacement": 8, "velocity": 11, "acceleration": 12, "force": 9,
}  # fmt: skip
"""Quantity -> its number in the files."""
_UNITS: Final[Mapping[str, str]] = {
    "displacement": "{length}", "velocity": "{length}/{time}", "acceleration": "{length}/{time}^2",
    "force": "{mass} {length}/{time}^2",
}  # fmt: skip
_EVEN: Final = 1e-9
"""Relative difference of intervals that is rounding."""


def write(
    path: Path,
    t: Array,
    functions: Mapping[str, Array],
    ends: Sequence[tuple[int, int]],
    coordinates: Mapping[int, Sequence[float]],
    units: Mapping[str, str] | None,
) -> None:
    """Write the nodes, and a function of time for each quantity and degree of freedom.

    Parameters
    ----------
    path : Path
    t : array, shape (time,)
    functions : mapping
        Quantity -> values, shape (time, dof).
    ends : sequence of (int, int)
        Node and direction, 1 to 6, of each degree of freedom.
    coordinates, units : mapping
        As of a model.
    """
    steps = np.diff(t)
    even = bool(len(t) > 1 and np.ptp(steps) <= _EVEN * np.abs(t).max())
    with path.open("w", encoding="ascii", errors="replace", newline="\n") as file:
        if coordinates:
            file.write(_set(15, _nodes(coordinates)))
        for quantity, values in functions.items():
            for column, end in enumerate(ends):
                file.write(_set(58, _function(t, values[:, column], quantity, end, units, even)))


def _set(number: int, body: str) -> str:
    return f"{-1:6}\n{number:6}\n{body}{-1:6}\n"


def _nodes(coordinates: Mapping[int, Sequence[float]]) -> str:
    lines = []
    for node, place in coordinates.items():
        x, y, z = [*place, 0.0, 0.0][:3]
        lines.append(f"{node:10}{0:10}{0:10}{1:10}{x:13.5E}{y:13.5E}{z:13.5E}\n")
    return "".join(lines)


def _function(
    t: Array, values: Array, quantity: str, end: tuple[int, int],
    units: Mapping[str, str] | None, even: bool,
) -> str:  # fmt: skip
    """Return a function of time in double precision."""
    node, direction = end
    step = (t[-1] - t[0]) / (len(t) - 1) if even else 0.0
    unit = _UNITS[quantity].format(**units) if units else ""
    time = units["time"] if units else ""
    named = f"{'NONE':10}"
    head = [
        "Vibroimpact", "NONE", "NONE", f"{quantity} of node {node}", "NONE",
        f"{1:5}{0:10}{0:5}{0:10} {named}{node:10}{direction:4} {named}{0:10}{0:4}",
        f"{4:10}{len(t):10}{int(even):10}{t[0]:13.5E}{step:13.5E}{0.0:13.5E}",
        _axis(17, "time", time), _axis(QUANTITIES[quantity], quantity, unit),
        _axis(0, "NONE", "NONE"), _axis(0, "NONE", "NONE"),
    ]  # fmt: skip
    if even:
        cells, per_line = [f"{value:20.12E}" for value in values], 4
    else:
        cells = [f"{at:13.5E}{value:20.12E}" for at, value in zip(t, values, strict=True)]
        per_line = 2
    rows = ["".join(cells[k : k + per_line]) for k in range(0, len(cells), per_line)]
    return "\n".join([*(line[:80] for line in head), *rows]) + "\n"


def _axis(kind: int, name: str, unit: str) -> str:
    return f"{kind:10}{0:5}{0:5}{0:5} {name[:20]:20} {unit[:20] or 'NONE':20}"
