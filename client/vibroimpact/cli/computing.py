"""The commands compute, plan and submit."""

from __future__ import annotations

import json
from typing import Annotated

import typer
from rich.console import Console

from vibroimpact.cli import options
from vibroimpact.client import Client
from vibroimpact.config import connection
from vibroimpact.local import Local


def _either(url: str | None, profile: str | None) -> Client | Local:
    """Return a client of the configured service, or computations in this process."""
    if connection(url, profile=profile).url is None:
        return Local()
    return Client(url, profile=profile)


def compute(
    kind: options.Kind,
    file: options.RequestFile = "-",
    model: options.Model = None,
    out: options.Out = None,
    plot: options.Plot = None,
    output: options.Output = None,
    json_: options.AsJson = False,
    url: options.Url = None,
    profile: options.Profile = None,
) -> None:
    """Compute a request, by a service if one is configured, else in this process."""
    request = options.request(file, model)
    waiting = Console(stderr=True).status(f"{kind} …")
    with _either(url, profile) as client:
        if isinstance(client, Local):
            with waiting:
                result = options.fetched(lambda: client.compute(kind, request))
        else:
            result = options.fetched(lambda: client.compute(kind, request, progress=True))
    options.show(result, out, plot, output)
    if json_:
        print(json.dumps(result.to_dict()))
    elif out is None and plot is None:
        print(result)


def plan(
    kind: options.Kind,
    file: options.RequestFile = "-",
    model: options.Model = None,
    json_: options.AsJson = False,
    url: options.Url = None,
    profile: options.Profile = None,
) -> None:
    """Show the steps of a computation and those it skips, with reasons; compute nothing."""
    with _either(url, profile) as client:
        answer = client.plan(kind, options.request(file, model))
    print(json.dumps(answer) if json_ else answer)


def submit(
    kind: options.Kind,
    file: options.RequestFile = "-",
    model: options.Model = None,
    priority: Annotated[int, typer.Option(help="Higher runs first, -10 to 10.")] = 0,
    deadline: Annotated[
        float | None, typer.Option(help="Seconds after which an unfinished job fails.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="What to call the job in lists.")] = None,
    json_: options.AsJson = False,
    url: options.Url = None,
    profile: options.Profile = None,
) -> None:
    """Queue a computation and print the id of its job."""
    with options.client(url, profile) as client:
        request = options.request(file, model)
        job = client.submit(kind, request, priority, deadline=deadline, name=name)
    print(json.dumps(job.document) if json_ else job.id)


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    for command in (compute, plan, submit):
        app.command(rich_help_panel="Computations")(command)
