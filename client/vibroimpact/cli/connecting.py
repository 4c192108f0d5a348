"""The commands login and doctor."""

from __future__ import annotations

import sys
from importlib.util import find_spec
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


def doctor(url: options.Url = None, profile: options.Profile = None) -> None:
    """Say what is installed, which service is used and whether it answers."""
    extras = {
        "plots": "matplotlib",
        "data": "xarray",
        "solvers": "vibroimpact_solvers",
        "service": "vibroimpact_service",
    }
    print(f"Python {sys.version.split()[0]}")
    for extra, module in extras.items():
        print(f"{extra}: {'yes' if find_spec(module) else 'no'}")
    chosen = config.connection(url, profile=profile)
    if chosen.url is None:
        print("service: none is configured; computations run in this process")
        return
    print(f"service: {chosen.url}, {'with' if chosen.key else 'without'} a key")
    try:
        with Client(url, profile=profile) as client:
            answer = client.version()
    except VibroimpactError as error:
        print(f"answer: {error}")
        raise
    print(f"answer: version {answer['service']}")


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    for command in (login, doctor):
        app.command(rich_help_panel="Service")(command)
