"""The command line; the server's commands are found by their entry points."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint, entry_points, version
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="vibroimpact",
    help="How structures with amplitude limiters move, as a computation service.",
    no_args_is_help=True,
    add_completion=False,
    # Pretty tracebacks show local variables, and with them keys and passwords.
    pretty_exceptions_enable=False,
)

_HELP = {
    "bench": "Run the benchmarks of a checkout.",
    "certificates": "Make the certificates that scheduler and workers know one another by.",
    "keys": "Make and revoke API keys.",
    "scheduler": "Run the scheduler of a cluster.",
    "serve": "Run the service.",
    "worker": "Run a worker of a cluster.",
}
"""What help says of commands that are not loaded for it."""


def _print_version(wanted: bool) -> None:
    if wanted:
        show_version()
        raise typer.Exit


@app.callback()
def common(
    _: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print it."),
    ] = False,
) -> None:
    """Take what stands before the commands."""


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for the file and the pictures.")] = Path("demo"),
) -> None:
    """Start a service, compute a first example as a job, draw it and check its numbers."""
    from vibroimpact.demo import run

    if not run(out):
        raise typer.Exit(1)


@app.command()
def gallery(
    figures: Annotated[
        list[str] | None,
        typer.Argument(help="Figures such as 10.19; none: all.", metavar="FIG"),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the pictures.")] = Path("gallery"),
) -> None:
    """Compute, draw and check figures of the chapter with a service of our own."""
    from vibroimpact.gallery import run

    if not run(figures or [], out):
        raise typer.Exit(1)


@app.command("version")
def show_version() -> None:
    """Print the version."""
    typer.echo(version("vibroimpact"))


def _add_server_command(point: EntryPoint) -> None:
    """Add a command of the service's package, loading it only where it is the one called.

    Loading costs a second, which ``vibroimpact --help`` need not spend.
    """
    if point.name not in sys.argv[1:2]:
        app.command(point.name, help=_HELP.get(point.name))(lambda: None)
        return
    try:
        found = point.load()
        if isinstance(found, typer.Typer):
            app.add_typer(found, name=point.name)
        else:
            app.command(point.name)(found)
    except ImportError as error:
        message = f"vibroimpact {point.name} needs: pip install 'vibroimpact[all]'  ({error})"
        sys.exit(message)


def main() -> None:
    """Run the command line."""
    for point in entry_points(group="vibroimpact.commands"):
        _add_server_command(point)
    app()


if __name__ == "__main__":
    main()
