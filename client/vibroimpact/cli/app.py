"""All commands; those of the service are found by their entry points."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint, entry_points, version
from pathlib import Path
from typing import Annotated

import typer

from vibroimpact.cli import computing, connecting, jobs
from vibroimpact.cli.exits import CODES, reported

app = typer.Typer(
    name="vibroimpact",
    help="How structures with amplitude limiters move, as a computation service.",
    epilog=f"Exit codes: {CODES}.",
    no_args_is_help=True,
    # Pretty tracebacks show local variables, and with them keys and passwords.
    pretty_exceptions_enable=False,
)

_HELP = {
    "backup": "Copy records and store of a service into a folder.",
    "bench": "Run the benchmarks of a checkout.",
    "certificates": "Create the TLS certificates of scheduler, workers and service.",
    "keys": "Create and revoke API keys.",
    "migrate": "Bring the records of a service to the newest revision.",
    "restore": "Restore a backup of a service.",
    "scheduler": "Run the scheduler of a cluster.",
    "serve": "Run the service.",
    "warm": "Compile the kernels of all computations beforehand.",
    "worker": "Run a worker of a cluster.",
}
"""Help texts of the commands that are not imported to show them."""


def _print_version(given: bool) -> None:
    if given:
        show_version()
        raise typer.Exit


@app.callback()
def common(
    _: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Accept the options that precede a command."""


@app.command(rich_help_panel="Examples")
def demo(
    out: Annotated[Path, typer.Option(help="Folder for the files and the figures.")] = Path("demo"),
) -> None:
    """Start a service, compute a first example as a job, plot it and check its numbers."""
    from vibroimpact.demo import run

    if not run(out):
        raise typer.Exit(1)


@app.command(rich_help_panel="Examples")
def gallery(
    figures: Annotated[
        list[str] | None,
        typer.Argument(help="Figures such as 10.19 or beam; default: all.", metavar="FIG"),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the figures.")] = Path("gallery"),
) -> None:
    """Start a service; compute, plot and check figures of the gallery."""
    from vibroimpact.gallery import run

    if not run(figures or [], out):
        raise typer.Exit(1)


@app.command("version")
def show_version() -> None:
    """Print the version."""
    typer.echo(version("vibroimpact"))


def _add_server_command(point: EntryPoint) -> None:
    """Add a command of the service, importing it only if it is the one called.

    The import takes a second, which ``vibroimpact --help`` saves.
    """
    if point.name not in sys.argv[1:2]:
        app.command(point.name, help=_HELP.get(point.name), rich_help_panel="Service")(lambda: None)
        return
    try:
        command = point.load()
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=point.name, rich_help_panel="Service")
        else:
            app.command(point.name, rich_help_panel="Service")(command)
    except ImportError as error:
        message = f"vibroimpact {point.name} needs: pip install 'vibroimpact[all]'  ({error})"
        sys.exit(message)


for module in (computing, jobs, connecting):
    module.add_to(app)


def run() -> None:
    """Run the command line."""
    for point in entry_points(group="vibroimpact.commands"):
        _add_server_command(point)
    with reported():
        app()
