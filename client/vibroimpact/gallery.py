"""The figures of the gallery: one script each, which computes, plots and checks it."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from vibroimpact.client import Client

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def folder() -> Path:
    """Return the folder of the scripts, in the installed package or in the repository."""
    here = Path(__file__).resolve().parent
    installed = here / "_gallery"
    return installed if installed.is_dir() else here.parent.parent / "docs" / "gallery"


def figures() -> list[str]:
    """Return the names of all figures: numbers of the chapter, such as ``"10.19"``, and words."""
    return [_name(path) for path in sorted(folder().glob("fig_*.py"))]


def draw(client: Client, figure: str) -> Figure:
    """Compute and plot one figure.

    Raises
    ------
    AssertionError
        If a number is not the expected one.
    """
    with _importable(folder()):
        script: Any = importlib.import_module(_module(figure))
        drawn: Figure = script.draw(client)
        return drawn


def run(names: Sequence[str], out: Path) -> bool:
    """Plot the named figures, or all; return whether all their numbers are as expected."""
    console = Console()
    known = {_module(figure): figure for figure in figures()}
    chosen = [known.get(name, name) for name in names] or [*known.values()]  # fig_10_13 is 10.13
    unknown = [figure for figure in chosen if figure not in known.values()]
    if unknown:
        console.print(
            f"there is no figure {', '.join(unknown)}; there are {', '.join(known.values())}"
        )
        return False
    out.mkdir(parents=True, exist_ok=True)
    wrong = 0
    with console.status("starting a service …"):
        client = Client()
    with client:
        for figure in chosen:
            with console.status(f"Fig. {figure} …"):
                wrong += not _written(client, figure, out, console)
    return wrong == 0


def _written(client: Client, figure: str, out: Path, console: Console) -> bool:
    path = out / f"{_module(figure)}.png"
    try:
        draw(client, figure).savefig(path, dpi=150)
    except AssertionError as error:
        console.print(f"Fig. {figure}: a number is not the expected one\n{error}")
        return False
    console.print(f"Fig. {figure}: {path}")
    return True


def _module(figure: str) -> str:
    chapter, _, number = figure.partition(".")
    return f"fig_{chapter}_{int(number):02d}" if number else f"fig_{figure}"


def _name(path: Path) -> str:
    chapter, _, number = path.stem.removeprefix("fig_").partition("_")
    return f"{chapter}.{int(number)}" if number else chapter


@contextmanager
def _importable(place: Path) -> Iterator[None]:
    """Let scripts import one another."""
    sys.path.insert(0, str(place))
    try:
        yield
    finally:
        sys.path.remove(str(place))
