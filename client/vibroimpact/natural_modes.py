"""Natural frequencies and mode shapes as a table and as pictures."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np

from vibroimpact.style import ADMISSIBLE, SERIES, legend, new_axes, noted
from vibroimpact.tables import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from vibroimpact.result_file import ResultFile

_ROWS: Final = 30  # modes in a table at most
_SHAPES: Final = 5  # modes in a picture at most
_MARKED: Final = 60  # degrees of freedom up to which each has a mark


def unit_of(result: ResultFile) -> tuple[str, str]:
    """Return the unit in which frequencies are shown, and how it is written.

    That of the request, or Hz where the structure has units.
    """
    asked = str(result.request.get("unit", "Omega"))
    if asked == "Omega" and result.unit("Omega") != "1":
        asked = "Hz"
    return asked, {"Hz": "Hz", "rpm": "1/min", "omega": "omega"}.get(asked, result.unit("Omega"))


def rows(result: ResultFile) -> tuple[list[str], list[list[str]]]:
    """Return the columns and the rows of a table of natural frequencies."""
    unit, name = unit_of(result)
    angular = f"Omega ({result.unit('Omega')})"
    columns: dict[str, Array] = {"mode": result.mode, angular: result.Omega}
    if unit != "Omega":
        columns[f"frequency ({name})"] = result.in_unit(result.Omega, unit)
    columns["error"] = result.error.Omega
    if "effective_mass" in result:
        for place, masses in enumerate(result.effective_mass.T):
            columns[f"effective mass {place} ({result.unit('effective_mass')})"] = masses
    columns = {text.replace(" (1)", ""): values for text, values in columns.items()}
    cells = [
        [_cell(name, value) for name, value in zip(columns, row, strict=True)]
        for row in zip(*columns.values(), strict=True)
    ]
    left = len(cells) - _ROWS
    return list(columns), cells if left <= 0 else [*cells[:_ROWS], [f"and {left} more"]]


def table(result: ResultFile) -> str:
    """Return natural frequencies as lines of text."""
    head, cells = rows(result)
    whole = [row for row in cells if len(row) == len(head)]
    widths = [max(map(len, column)) for column in zip(head, *whole, strict=True)]
    lines = [
        "  ".join(text.rjust(width) for text, width in zip(row, widths, strict=False)).rstrip()
        for row in (head, *cells)
    ]
    return "\n".join(lines)


def _cell(column: str, value: float) -> str:
    if column == "mode":
        return str(value)
    return f"{value:.1e}" if column == "error" else f"{value:.8g}"


def plot_of(output: str | None) -> Callable[..., Axes]:
    """Return the function that plots an output; None: shapes where there are any.

    Raises
    ------
    ValueError
        If there is no plot of that output.
    """
    drawing = {None: shapes, "shape": shapes, "Omega": frequencies}
    if output not in drawing:
        raise ValueError(f"natural frequencies: shape, Omega can be drawn, not {output!r}")
    return drawing[output]


@noted
def shapes(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the lowest mode shapes, each divided by its largest entry, over the degrees of freedom.

    Up to five of them; without shapes, the frequencies.
    """
    if "shape" not in result:
        return frequencies(result, ax)
    ax = ax or new_axes()
    unit, name = unit_of(result)
    values = result.in_unit(result.Omega, unit)
    dofs = np.arange(result.shape.shape[1])
    ax.axhline(0.0, color="black", linewidth=0.5)
    for place, (color, style) in zip(range(min(_SHAPES, values.size)), SERIES, strict=False):
        x = result.shape[place]
        text = f"{values[place]:.5g}" + ("" if name == "1" else f" {name}")
        ax.plot(
            dofs, x / np.abs(x).max(), linestyle=style, color=color, linewidth=1.2, label=text,
            marker="o" if dofs.size <= _MARKED else None, markersize=2.5,
        )  # fmt: skip
    ax.locator_params(axis="x", integer=True)
    ax.set_xlabel("degree of freedom")
    ax.set_ylabel("mode shape")
    legend(ax)
    return ax


@noted
def frequencies(result: ResultFile, ax: Axes | None = None) -> Axes:
    """Plot the natural frequencies over the index of the mode."""
    ax = ax or new_axes()
    unit, name = unit_of(result)
    ax.plot(result.mode, result.in_unit(result.Omega, unit), "o", color=ADMISSIBLE, markersize=4)
    symbol = r" $\Omega$" if unit == "Omega" else ""
    ax.locator_params(axis="x", integer=True)
    ax.set_xlabel("mode")
    ax.set_ylabel(f"natural frequency{symbol}" + ("" if name == "1" else f" ({name})"))
    return ax
