"""Every figure of the gallery: its script asserts its numbers."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import pytest

import vibroimpact as vi
from vibroimpact import gallery

mpl.use("Agg")

EXPECTED = [2, 3, 5, 6, 8, 9, 10, 11, *range(13, 21), 22]


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[vi.Client]:
    with vi.Client(data=tmp_path_factory.mktemp("data")) as opened:
        yield opened


def test_there_is_a_script_and_a_picture_for_every_figure() -> None:
    assert gallery.figures() == [f"10.{number}" for number in EXPECTED]
    page = (gallery.folder() / "index.md").read_text(encoding="utf-8")
    for number in EXPECTED:
        name = f"fig_10_{number:02d}"
        assert (gallery.folder() / f"{name}.png").stat().st_size > 10_000
        assert f"{name}.png" in page
        assert f"{name}.py" in page


@pytest.mark.parametrize("figure", gallery.figures())
def test_figure(client: vi.Client, figure: str, tmp_path: Path) -> None:
    drawn = gallery.draw(client, figure)
    drawn.savefig(tmp_path / "figure.png")
    assert drawn.axes


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
