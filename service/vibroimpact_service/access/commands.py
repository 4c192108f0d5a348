"""The commands for API keys: create, list, revoke, and the audit log."""

from __future__ import annotations

import getpass
import json
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, TypeVar

import typer
from sqlalchemy.engine import Connection

from vibroimpact_schema.keys import KeyRequest
from vibroimpact_service import exits
from vibroimpact_service.access import records
from vibroimpact_service.access.caller import Scope
from vibroimpact_service.documents import parse
from vibroimpact_service.jobs.record_access import RecordAccess
from vibroimpact_service.problems import ProblemError

Value = TypeVar("Value")
Data = Annotated[
    Path | None, typer.Option(help="Folder of the service's records (./vibroimpact-data).")
]

app = typer.Typer(help="API keys of the service: create, list, revoke.", no_args_is_help=True)


@app.command()
def create(
    owner: Annotated[
        str, typer.Argument(help="Owner of the jobs and results that it gives access to.")
    ],
    label: Annotated[str, typer.Option(help="Description of its purpose.")] = "",
    scope: Annotated[
        list[Scope] | None,
        typer.Option(help="What it permits; may be repeated (default: read, submit)."),
    ] = None,
    days: Annotated[float | None, typer.Option(help="Lifetime in days.")] = None,
    requests_per_minute: Annotated[int | None, typer.Option(help="Its own rate limit.")] = None,
    seconds_per_hour: Annotated[float | None, typer.Option(help="Its own computing quota.")] = None,
    data: Data = None,
) -> None:
    """Make a key and print it; it cannot be shown again."""
    options = {
        "owner": owner, "label": label, "days": days,
        "scopes": [s.value for s in scope or (Scope.READ, Scope.SUBMIT)],
        "requests_per_minute": requests_per_minute, "seconds_per_hour": seconds_per_hour,
    }  # fmt: skip
    try:
        new = parse.document(KeyRequest, options)
    except ProblemError as error:
        typer.echo(error.detail, err=True)
        raise typer.Exit(2) from None
    text, _ = _change(data, lambda connection: records.create(connection, _actor(), new))
    typer.echo(text)


@app.command("list")
def show(data: Data = None) -> None:
    """List all keys, without their secrets: id, state, owner, scopes, date, label."""
    rows = _change(data, records.listed)
    width = max((len(row.owner) for row in rows), default=0)
    for row in rows:
        state = "valid" if row.valid else "revoked" if row.revoked is not None else "expired"
        scopes = row.scopes.replace(" ", ",")
        created = datetime.fromtimestamp(row.created, UTC).date()
        typer.echo(f"{row.id}  {state:8}  {row.owner:{width}}  {scopes}  {created}  {row.label}")


@app.command()
def revoke(
    key: Annotated[str, typer.Argument(help="Its id, as listed.")], data: Data = None
) -> None:
    """Revoke a key, with immediate effect on running services."""
    row = _change(data, lambda connection: records.revoke(connection, _actor(), key))
    if row is None:
        typer.echo("there is no such key", err=True)
        raise typer.Exit(1)
    typer.echo(f"{row.id} is revoked")


@app.command()
def audit(data: Data = None) -> None:
    """Print who made and revoked which keys, newest first."""
    for row in _change(data, lambda connection: records.acts(connection, None, 500)):
        when = datetime.fromtimestamp(row.time, UTC).isoformat(timespec="seconds")
        line = {"time": when, "actor": row.actor, "act": row.act, "subject": row.subject}
        typer.echo(json.dumps(line | json.loads(row.about)))


def _change(data: Path | None, operation: Callable[[Connection], Value]) -> Value:
    settings = exits.settings(data=data)
    with (
        exits.reported(),
        closing(RecordAccess(records.open_keys(settings.database_url))) as access,
    ):
        return access.write_now(operation)


def _actor() -> str:
    return f"command line of {getpass.getuser()}"[:80]


if __name__ == "__main__":
    app()
