"""The commands login and doctor."""

from __future__ import annotations

import json
import sys
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from vibroimpact import config
from vibroimpact.cli import options
from vibroimpact.client import Client
from vibroimpact.errors import VibroimpactError


def login(
    url: Annotated[str, typer.Argument(help="Address of the service.")],
    profile: Annotated[str, typer.Option(help="Name of the profile.")] = "default",
) -> None:
    """Store address and key of a service in the configuration file, after trying them.

    The key is read from standard input, without echo in a terminal; empty for none.
    """
    if sys.stdin.isatty():
        key = typer.prompt("Key (empty for none)", default="", hide_input=True, show_default=False)
    else:
        key = sys.stdin.readline().strip()
    with Client(url, key=key or None) as client:
        next(client.jobs(), None)  # an exchange for which the key is needed
    path = config.save(profile, url, key or None)
    print(f"written: {path}")


def doctor(
    url: options.Url = None,
    profile: options.Profile = None,
    service: Annotated[
        bool, typer.Option("--service", help="Check the installation of a service here instead.")
    ] = False,
    data: Annotated[
        Path | None, typer.Option(help="Folder of the service's data; implies --service.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Say what is installed, which service is used and whether it answers.

    With --service or --data, check the installation of a service: settings, records, store,
    certificates, workers, kernels, room.
    """
    if service or data is not None:
        _check_service(data, as_json)
        return
    extras = {
        "plots": "matplotlib",
        "data": "xarray",
        "solvers": "vibroimpact_solvers",
        "service": "vibroimpact_service",
    }
    installed = {"Python": sys.version.split()[0]}
    installed |= {extra: "yes" if find_spec(name) else "no" for extra, name in extras.items()}
    used, failure = {"service": "none is configured; computations run without one"}, None
    chosen = config.connection(url, profile=profile)
    if chosen.url is not None:
        used["service"] = f"{chosen.url}, {'with' if chosen.key else 'without'} a key"
        try:
            with Client(url, profile=profile) as client:
                used["answer"] = f"version {client.version()['service']}"
        except VibroimpactError as error:
            used["answer"], failure = str(error), error
    if as_json:
        print(json.dumps({"installed": installed, **used}, indent=1))
    else:
        print(
            *(f"{name}: {value}" for name, value in (*installed.items(), *used.items())), sep="\n"
        )
    if failure is not None:
        raise failure


def _check_service(data: Path | None, as_json: bool) -> None:
    """Run the checks of the service, which is a package of its own."""
    try:
        (check,) = entry_points(group="vibroimpact.checks", name="service")
        run = check.load()
    except (ImportError, ValueError):
        sys.exit("vibroimpact doctor --service needs: pip install 'vibroimpact[all]'")
    run(data, as_json)


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    for command in (login, doctor):
        app.command(rich_help_panel="Service")(command)
