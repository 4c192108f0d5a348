"""The commands of operators: migrate, doctor, backup, restore."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from vibroimpact_service import exits

Data = Annotated[
    Path | None, typer.Option(help="Folder of the service's data (./vibroimpact-data).")
]
Folder = Annotated[Path, typer.Argument(help="Folder of the backup.")]

app = typer.Typer()


@app.command()
def migrate(
    data: Data = None,
    check: Annotated[
        bool, typer.Option("--check", help="Only say whether there is something to do.")
    ] = False,
) -> None:
    """Bring the records to the newest revision, without starting the service.

    A service does so by itself when it starts. Several may do it at once, and beside replicas of
    the version before: migrations only add. With --check, the exit code is 1 if there is something
    to do.
    """
    from vibroimpact_service.operations import migration

    settings = exits.settings(data=data)
    with _reported():
        before = migration.of_settings(settings) if check else migration.migrate(settings)
    for tables, current, newest in before:
        change = "is the newest" if current == newest else f"→ {newest}"
        typer.echo(f"{tables}: revision {current or 'none'} {change}")
    if check and any(current != newest for _, current, newest in before):
        raise typer.Exit(1)


@app.command()
def doctor(
    data: Data = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Check an installation: settings, records, store, certificates, workers, kernels, room.

    Nothing is changed. The exit code is 1 if a check failed; warnings do not count.
    """
    from vibroimpact_service.operations import doctor

    outcomes = []
    for outcome in doctor.checks(exits.settings(data=data)):
        outcomes.append(outcome)
        if not as_json:
            typer.echo(doctor.lines(outcome))
    if as_json:
        typer.echo(doctor.document(outcomes))
    if doctor.any_failed(outcomes):
        raise typer.Exit(1)


@app.command()
def backup(folder: Folder, data: Data = None) -> None:
    """Copy records and store of an installation into a folder, also while services run on it.

    What the folder holds of an earlier or an interrupted backup is not copied again.
    """
    from vibroimpact_service.operations import backup

    settings = exits.settings(data=data)
    with _reported(), _progress("Copying") as begin:
        written = backup.write(settings, folder, begin)
    content = written.manifest
    typer.echo(f"{folder}: {_contents(content)}; {written.new} new files")
    if written.gone:
        typer.echo(f"{written.gone} files were removed or damaged meanwhile, and are left out")
    if content.rows.get("webhooks") and settings.webhook_key is None:
        key = settings.tls_key or settings.data / "webhook.key"
        typer.echo(f"{key}, which encrypts the secrets of webhooks, is not part of it")


@app.command()
def restore(
    folder: Folder,
    data: Data = None,
    replace: Annotated[
        bool, typer.Option("--replace", help="Remove the records that are there already.")
    ] = False,
    check: Annotated[bool, typer.Option("--check", help="Only verify the backup.")] = False,
) -> None:
    """Restore a backup into the database and the store of an installation on which nothing runs.

    All of it is verified before anything is written. An interrupted one is continued by the same
    command.
    """
    from vibroimpact_service.operations import restore

    settings = exits.settings(data=data)
    with _reported(), _progress("Verifying", "Copying") as begin:
        if check:
            content, _ = restore.verify(folder, begin)
        else:
            content = restore.restore(settings, folder, begin, replace=replace).manifest
    verb = "is sound" if check else "is restored"
    typer.echo(f"the backup of {content.began} {verb}: {_contents(content)}")


def _contents(content: Any) -> str:
    jobs, size = content.rows.get("jobs", 0), content.size / 1e6
    return (
        f"{jobs} jobs, {content.rows.get('api_keys', 0)} keys, {content.count} files, {size:.1f} MB"
    )


@contextmanager
def _reported() -> Iterator[None]:
    """End the process with a message, and an exit code, for what can go wrong."""
    from vibroimpact_service.jobs.data_folder import DataInUseError
    from vibroimpact_service.operations.backup import BackupBusyError, NoRecordsError
    from vibroimpact_service.operations.manifest import BackupInvalidError
    from vibroimpact_service.operations.restore import TargetNotEmptyError
    from vibroimpact_service.operations.rows import RowsDamagedError

    with exits.reported(
        BackupBusyError, BackupInvalidError, DataInUseError, NoRecordsError, RowsDamagedError,
        TargetNotEmptyError,
    ):  # fmt: skip
        yield


@contextmanager
def _progress(*labels: str) -> Iterator[Callable[[int], Callable[[int], None]]]:
    """Yield what begins a bar, one label after another, on a terminal."""
    left = iter(labels)
    bars: list[Any] = []

    def close() -> None:
        for bar in bars:
            bar.__exit__(None, None, None)
        bars.clear()

    def begin(length: int) -> Callable[[int], None]:
        close()
        if not sys.stderr.isatty():
            return lambda _: None
        bar = typer.progressbar(length=length, label=next(left), file=sys.stderr)
        bars.append(bar.__enter__())
        return bar.update

    try:
        yield begin
    finally:
        close()
