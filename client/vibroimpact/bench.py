"""The command ``vibroimpact bench``: runs the benchmarks of a checkout.

They live in the repository and not in the package, as their peers and results do.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer


def bench(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Benchmarks, or tables such as scaling.memory; none for all."),
    ] = None,
    list_only: Annotated[bool, typer.Option("--list", help="Only list them.")] = False,
    save: Annotated[
        bool, typer.Option("--save", help="Store results, draw the pages anew.")
    ] = False,
    page: Annotated[bool, typer.Option("--page", help="Only draw the pages anew.")] = False,
) -> None:
    """Run benchmarks and print their tables."""
    root = checkout(Path(__file__), Path.cwd())
    if root is None:
        message = (
            "The benchmarks are part of the repository, not of the package: "
            "run this in a checkout of Vibroimpact."
        )
        typer.echo(message, err=True)
        raise typer.Exit(2)
    sys.path.insert(0, str(root))
    command = import_module("benchmarks.command")
    if list_only:
        typer.echo(command.listing())
        return
    if page:
        command.draw()
        return
    try:
        parts = command.named(names or [])
    except ValueError as error:
        typer.echo(f"{error}", err=True)
        raise typer.Exit(2) from None
    if command.run(parts, typer.echo, save=save):
        raise typer.Exit(1)


def checkout(*places: Path) -> Path | None:
    """Return the folder, around one of the places, that holds the benchmarks."""
    for place in places:
        for folder in (place, *place.parents):
            if (folder / "benchmarks" / "command.py").is_file():
                return folder
    return None
