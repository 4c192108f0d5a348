"""Every figure of the gallery: its script asserts its numbers."""

from __future__ import annotations

import itertools
import string
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import vibroimpact as vi
from vibroimpact import gallery

mpl.use("Agg")

CHAPTER = [2, 3, 5, 6, 8, 9, 10, 11, *range(13, 21), 22]
DRIVEN = ["absorber", "beam", "bifurcation", "hysteresis", "oscillator"]


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[vi.Client]:
    with vi.Client(data=tmp_path_factory.mktemp("data")) as opened:
        yield opened


def test_there_is_a_script_and_a_picture_for_every_figure() -> None:
    assert gallery.figures() == [f"10.{number}" for number in CHAPTER] + DRIVEN
    page = (gallery.folder() / "index.md").read_text(encoding="utf-8")
    for figure in [f"10_{number:02d}" for number in CHAPTER] + DRIVEN:
        name = f"fig_{figure}"
        assert (gallery.folder() / f"{name}.png").stat().st_size > 10_000
        assert f"{name}.png" in page
        assert f"{name}.py" in page


@pytest.mark.parametrize("figure", gallery.figures())
def test_figure(client: vi.Client, figure: str, tmp_path: Path) -> None:
    drawn = gallery.draw(client, figure)
    drawn.savefig(tmp_path / "figure.png")
    assert _faults(drawn) == []


def _faults(figure: Figure) -> list[str]:
    """Return what keeps a reader, also one who does not see colours, from reading a figure."""
    faults = []
    for place, ax in enumerate(figure.axes):
        beside = [other for other in figure.axes if _follows(ax, other, "x")]
        worded = any(text.get_text().isalpha() for text in ax.get_yticklabels())
        if not worded and not any(other.get_ylabel() for other in (ax, *beside)):
            faults.append(f"panel {place} has no label upwards")
        under = [other for other in figure.axes if _follows(other, ax, "y")]
        if not ax.get_xlabel() and not any(other.get_xlabel() for other in under):
            faults.append(f"panel {place} has no label across")
        letter = f"({string.ascii_lowercase[place]})"
        if len(figure.axes) > 1 and letter not in [text.get_text() for text in ax.texts]:
            faults.append(f"panel {place} is not lettered {letter}")
        legend, inside = ax.get_legend(), ax.get_window_extent()
        if legend is not None and inside.overlaps(legend.get_window_extent().padded(-2.0)):
            faults.append(f"the legend of panel {place} is over its curves")
        looks: dict[tuple[Any, ...], set[str]] = {}
        for line in ax.lines:
            if len(line.get_xdata()) > 2 and line.get_linestyle() != "None":
                look = (str(line._dash_pattern), line.get_marker(), line.get_linewidth())
                looks.setdefault(look, set()).add(str(line.get_color()))
        faults += [
            f"only colours tell {colours} apart in panel {place}"
            for colours in looks.values()
            if len(colours) > 1
        ]
    return faults


def _follows(other: Axes, ax: Axes, along: str) -> bool:
    """Return whether axes are below others in the same column, or to the right in the same row."""
    upper, lower = ax.get_position(), other.get_position()
    if along == "x":
        return upper.x1 <= lower.x0 and lower.y0 < upper.y1 and upper.y0 < lower.y1
    return lower.y1 <= upper.y0 and lower.x0 < upper.x1 and upper.x0 < lower.x1


def test_the_damped_oscillator_is_shown_from_beginning_to_end(client: vi.Client) -> None:
    """Fig. 10.3: its impacts end at 91.7, and free decay follows."""
    spans = sorted(ax.get_xlim() for ax in gallery.draw(client, "10.3").axes)
    assert spans[0][0] == 0.0
    assert spans[-1][1] > 100.0
    assert all(before[1] == after[0] for before, after in itertools.pairwise(spans))


def test_the_command_draws_what_is_named(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "vibroimpact.cli", "gallery", "10.8", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "fig_10_08.png").read_bytes().startswith(b"\x89PNG")


def test_an_unknown_figure_is_refused(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "vibroimpact.cli", "gallery", "10.1", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode == 1
    assert "there is no figure 10.1" in done.stdout
