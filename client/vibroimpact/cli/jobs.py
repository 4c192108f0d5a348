"""The commands jobs, wait and result."""

from __future__ import annotations

import json
from itertools import islice
from typing import Annotated

import typer

from vibroimpact.cli import options

JobId = Annotated[str, typer.Argument(help="Id of a job.", metavar="JOB")]


def jobs(
    state: Annotated[
        str | None,
        typer.Option(help="queued, running, succeeded, failed or cancelled; unset: all."),
    ] = None,
    kind: Annotated[str | None, typer.Option(help="Kind of computation.")] = None,
    limit: Annotated[int, typer.Option(help="How many, newest first.", min=1)] = 30,
    json_: options.AsJson = False,
    url: options.Url = None,
    profile: options.Profile = None,
) -> None:
    """List jobs, newest first."""
    with options.client(url, profile) as client:
        documents = [job.document for job in islice(client.jobs(state, kind), limit)]
    if json_:
        print(json.dumps(documents))
        return
    for one in documents:
        done = one["progress"]
        print(
            f"{one['id']}  {one['state']:9}  {done['done']}/{done['total']}  "
            f"{one['created']}  {one['kind']}"
        )


def wait(
    job_id: JobId,
    timeout: Annotated[float | None, typer.Option(help="Longest wait in seconds.")] = None,
    json_: options.AsJson = False,
    url: options.Url = None,
    profile: options.Profile = None,
) -> None:
    """Wait until a job has ended, showing its progress."""
    with options.client(url, profile) as client:
        job = client.job(job_id).wait(timeout, progress=True)
    print(json.dumps(job.document) if json_ else job.state)


def result(
    job_id: JobId,
    out: options.Out = None,
    plot: options.Plot = None,
    output: options.Output = None,
    json_: options.AsJson = False,
    url: options.Url = None,
    profile: options.Profile = None,
) -> None:
    """Fetch the result of a job; a large one goes to the file and not to memory."""
    with options.client(url, profile) as client:
        answer = options.fetched(lambda: client.job(job_id).result(out))
    options.show(answer, None, plot, output)
    if json_:
        print(json.dumps(answer.to_dict()))
    elif plot is None:
        print(answer if out is None else out)


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    for command in (jobs, wait, result):
        app.command(rich_help_panel="Jobs")(command)
