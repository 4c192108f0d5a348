"""The one style of all plots: journal column width, colours and lines for the colour-blind."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar, cast

import numpy as np

from vibroimpact.errors import MissingExtra
from vibroimpact.tables import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from vibroimpact.result_file import ResultFile

COLUMN: Final = (3.5, 2.6)
PAGE: Final = (7.0, 3.0)
"""Inches: one column of a journal, and the width of its page."""
# Okabe and Ito's colours, of which all pairs differ for every kind of colour vision.
ADMISSIBLE, OTHER, GREEN, ORANGE, PINK = "#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7"
PHANTOM, WALL = "#8C8C8C", "#000000"
AMBER = "#8F5300"
"""Of cautions: amber that can be read on white."""
SERIES: Final = (
    (ADMISSIBLE, "-"),
    (OTHER, (0, (5, 1.5))),
    (GREEN, (0, (1, 1))),
    (ORANGE, (0, (5, 1, 1, 1))),
    (PINK, (0, (3, 1, 1, 1, 1, 1))),
)
"""Colours with line styles that tell curves apart without colours."""
SHEET: Final[Any] = {
    "font.size": 8.0,
    "axes.formatter.use_mathtext": True,
    "axes.labelsize": 8.0,
    "axes.titlesize": 8.0,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "figure.dpi": 150.0,
    "savefig.dpi": 300.0,
}


def new_axes(size: tuple[float, float] = COLUMN) -> Axes:
    """Return the axes of a new figure, one column wide or of a size in inches."""
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise MissingExtra("plots", "plots", error) from error
    with pyplot.rc_context(SHEET):
        ax: Axes = pyplot.subplots(figsize=size, layout="constrained")[1]
    small(ax)
    return ax


def save(ax: Axes, path: Path) -> None:
    """Write the figure of some axes; the end of the path decides the format."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.savefig(path, dpi=200)


def small(ax: Axes) -> None:
    """Give ticks the size of the sheet, which otherwise have that of the day they are drawn."""
    ax.tick_params(labelsize=SHEET["xtick.labelsize"], width=SHEET["axes.linewidth"])


_CHARACTERS = 17.0
"""Characters of a legend in an inch."""


def legend(ax: Axes, columns: int = 5, **options: Any) -> None:
    """Place the legend above the axes, where it hides no curve, in as many columns as fit.

    It stands above the power of ten of the ticks, if there is one.
    """
    handles, names = ax.get_legend_handles_labels()
    if not handles:
        return
    width = ax.bbox.width / ax.figure.dpi
    fit = int(_CHARACTERS * width / (max(map(len, names)) + 6.0))
    columns = max(1, min(columns, fit))
    ticks = ax.yaxis.get_major_formatter()
    ticks.format_ticks(ax.get_yticks().tolist())
    settings: dict[str, Any] = {
        "loc": "lower left",
        "bbox_to_anchor": (0.0, 1.06 if ticks.get_offset() else 1.0),
        "ncols": min(columns, len(handles)),
        "frameon": False,
        "fontsize": 7.5,
        "borderaxespad": 0.1,
        "columnspacing": 1.2,
        "handlelength": 2.2,
    }
    ax.legend(handles, names, **(settings | options))


def title(ax: Axes, text: str) -> None:
    """Write a title in the size of the sheet."""
    ax.set_title(text, fontsize=SHEET["axes.titlesize"])


_Draw = TypeVar("_Draw", bound=Callable[..., Any])
_NOTE: Final = "neglected"
"""Name of the note below the axes."""


def noted(draw: _Draw) -> _Draw:
    """Let a plot say below its axes what of the structure its result neglects."""

    @wraps(draw)
    def drawn(*args: Any, **options: Any) -> Any:
        ax = draw(*args, **options)
        result: ResultFile = args[0] if args else options["result"]
        note(ax, result.neglected)
        return ax

    return cast("_Draw", drawn)


def note(ax: Axes, sentences: tuple[str, ...]) -> None:
    """Write below the axes what is neglected; several results in the same axes share one note."""
    known = [text for text in ax.texts if text.get_gid() == _NOTE]
    before = [line for text in known for line in str(text.get_label()).split("\n")]
    lines = list(
        dict.fromkeys([*before, *(f"{each[:1].upper()}{each[1:]}." for each in sentences)])
    )
    for text in known:
        text.remove()
    if not lines:
        return
    width = int(1.3 * _CHARACTERS * ax.bbox.width / ax.figure.dpi)
    written = ax.annotate(
        "\n".join(part for line in lines for part in textwrap.wrap(line, max(width, 20))),
        (0.0, 0.0), (0.0, -3.0), ("axes fraction", ax.xaxis.label), "offset points",
        color=AMBER, fontsize=7.0, va="top", ha="left", annotation_clip=False,
    )  # fmt: skip
    written.set_gid(_NOTE)
    written.set_label("\n".join(lines))


def colorbar(drawn: Any, ax: Axes, text: str, **options: Any) -> Any:
    """Add a colour bar in the size of the sheet."""
    bar = ax.figure.colorbar(drawn, ax=ax, **options)
    bar.set_label(text, fontsize=SHEET["axes.labelsize"])
    bar.ax.tick_params(labelsize=SHEET["xtick.labelsize"])
    return bar


def label(text: str, result: ResultFile, output: str) -> str:
    """Return the label of an axis, with the unit if the structure has units."""
    unit = result.unit(output)
    return text if unit == "1" else f"{text} ({unit})"


def frequencies(
    result: ResultFile, Omega: Array, name: str = "fundamental frequency"
) -> tuple[Array, str]:
    """Return frequencies as they were requested, Omega or Hz or per minute, and the axis label."""
    request = result.request.get("base", result.request)
    unit = request.get("frequency", {}).get("unit", "Omega")
    if unit in ("Hz", "rpm"):
        return result.in_unit(Omega, unit), f"{name} ({'Hz' if unit == 'Hz' else '1/min'})"
    columns = ("Omega", "bands/start", "solution/Omega")
    units = (each for each in map(result.unit, columns) if each != "1")
    return np.asarray(Omega), rf"{name} $\Omega$" + "".join(f" ({each})" for each in [*units][:1])
