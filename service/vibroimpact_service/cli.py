"""The commands of the service: serve, scheduler, worker, warm, certificates, the contract.

Those of operators are in `operations.commands`.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import structlog
import typer
import uvicorn

from vibroimpact_service import exits, logs, stopping, use_case
from vibroimpact_service.connection import connection
from vibroimpact_service.jobs import forkserver
from vibroimpact_service.operations import commands
from vibroimpact_service.settings import (
    Settings,
    check_certificates,
    check_listening,
    renamed,
    unknown,
)
from vibroimpact_service.store import private

if TYPE_CHECKING:
    from fastapi import FastAPI

    from vibroimpact_service.metrics_port import MetricsServer

log = structlog.get_logger("vibroimpact.cli")

_CONTRACT = Path(__file__).resolve().parents[2] / "openapi" / "openapi.json"

_NO_START = "The service does not start: "
_STOPPING_SECONDS = 2.0
"""Time that computations have to notice that the service stops."""

Tls = Annotated[
    Path | None, typer.Option(help="Folder of `vibroimpact certificates` (VIBROIMPACT_TLS_…).")
]

# Pretty tracebacks show local variables, and with them passwords, in the logs.
app = typer.Typer(
    help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)
app.add_typer(commands.app)


@app.command()
def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on (127.0.0.1).")] = None,
    port: Annotated[int | None, typer.Option(help="Port; 0 takes a free one (8000).")] = None,
    data: Annotated[
        Path | None, typer.Option(help="Folder for records and results (./vibroimpact-data).")
    ] = None,
    metrics_port: Annotated[
        int | None, typer.Option(help="Port for metrics and health alone, without keys (none).")
    ] = None,
) -> None:
    """Start the service: HTTP, job queue, workers and store, until SIGTERM or Ctrl-C.

    All other settings are environment variables VIBROIMPACT_….
    """
    # Worker processes import this module too.
    from vibroimpact_service.access.authenticator import ExposedError, any_keys, keys_needed
    from vibroimpact_service.jobs import data_folder
    from vibroimpact_service.operations import migration

    settings = exits.settings(host=host, port=port, data=data, metrics_port=metrics_port)
    with exits.reported(data_folder.DataInUseError, where=_NO_START):
        check_listening(settings)
        if settings.scheduler is not None:
            check_certificates(settings)
        private.folder(settings.data)
        try:
            keys_required = keys_needed(settings)
        except ExposedError as error:
            exits.end(f"{_NO_START}{error}", exits.INVALID)
        # The application does both too; what fails there has a traceback in the log.
        if settings.database is None:
            data_folder.lock(settings.data).close()
        migration.migrate(settings)
        logs.to_stderr()
        _say("the service starts; its address is shown when it answers")
        _say(f"records and results are kept in {settings.data.absolute()}")
        if keys_required and settings.oidc_issuer is None and not any_keys(settings):
            _say(f"there are no keys yet: vibroimpact keys create NAME --data {settings.data}")
    # Before libraries of linear algebra are loaded: their threads spin while they wait,
    # which takes small products ten times as long where other processes compute as well.
    os.environ.update(forkserver.ENVIRONMENT)
    if settings.scheduler is None:
        # It loads the numerical libraries while this process loads those of HTTP.
        forkserver.start(use_case.NUMERICAL)
    from vibroimpact_service.app import create_app
    from vibroimpact_service.use_case.warming import Warming

    for name in unknown(os.environ):
        log.warning("there is no such setting", variable=name)
    for old, new in renamed(os.environ).items():
        log.warning("the setting has a new name", variable=old, now=new)
    _say("loading the numerical libraries")
    use_case.load()
    # By default, Python would let threads keep the event loop waiting for 5 ms at a time.
    sys.setswitchinterval(0.001)
    warming = Warming()
    server = Server(create_app(settings, warming=warming), settings)
    with warming.in_background():
        server.run()
    _end_threads()
    if not server.started:
        raise typer.Exit(3)


@app.command()
def scheduler(
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; 0 takes a free one.")] = 8786,
    tls: Tls = None,
) -> None:
    """Run a scheduler for workers on several machines, until SIGTERM or Ctrl-C."""
    from vibroimpact_service.jobs import cluster

    logs.to_stderr()
    settings = _cluster_settings(tls)
    with exits.reported(where=f"{host}:{port}: "):
        cluster.schedule(settings, host, port, typer.echo)


@app.command()
def worker(
    address: Annotated[
        str | None, typer.Argument(help="tls://… of the scheduler (VIBROIMPACT_SCHEDULER).")
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Processes (one per core).")] = None,
    tls: Tls = None,
) -> None:
    """Run workers for a scheduler elsewhere, until SIGTERM or Ctrl-C.

    They need the same store as the services: VIBROIMPACT_STORE of the services must be an
    address that these workers can reach too. They survive restarts of the scheduler.
    """
    from vibroimpact_service.jobs import cluster
    from vibroimpact_service.use_case import chunks
    from vibroimpact_service.use_case.warming import Warming

    settings = _cluster_settings(tls, scheduler=address, workers=workers)
    if settings.scheduler is None:
        exits.end("the address of the scheduler must be given, as tls://host:port", exits.INVALID)
    logs.to_stderr()
    with Warming().in_background():
        cluster.work(settings, chunks.WORK.modules, lambda count: typer.echo(f"{count} workers"))


@app.command()
def warm(
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run", help="Only list the kernels that would be compiled, the longest first."
        ),
    ] = False,
) -> None:
    """Compile the kernels of all kinds of computations and keep them on disk.

    Services and workers do so by themselves, in the background. This command does it beforehand,
    as when an image is built, and ends at once where all is compiled.
    """
    from vibroimpact_service.use_case.warming import FolderNotWritableError, Warming, missing
    from vibroimpact_solvers.kernels import inventory

    if dry_run:
        names = sorted(missing(), key=lambda name: (-inventory.estimate([name]), name))
        for name in names:
            typer.echo(f"{name:40} {inventory.estimate([name]):4.0f} s")
        total = inventory.estimate(names) if names else 0.0
        typer.echo(f"{len(names)} of {len(inventory.kernels())} kernels, about {total:.0f} s")
        return
    logs.to_stderr()
    warming = Warming()
    try:
        place = warming.start()
    except FolderNotWritableError as error:
        typer.echo(f"{error}; NUMBA_CACHE_DIR can name one", err=True)
        raise typer.Exit(3) from None
    if warming.notice:
        typer.echo(warming.notice, err=True)
    try:
        with typer.progressbar(length=len(warming.states), label="Compiling kernels") as bar:
            for done in warming.progress():
                bar.update(done - bar.pos)
    finally:
        warming.close()
    failed = [kind for kind, state in warming.states.items() if state != "warm"]
    if failed:
        typer.echo(f"not compiled: {', '.join(failed)}", err=True)
        raise typer.Exit(1)
    typer.echo(f"Kernels are kept in {place}")


@app.command()
def certificates(
    folder: Annotated[Path, typer.Argument(help="Where to write ca.pem, cert.pem and key.pem.")],
    days: Annotated[int, typer.Option(min=1, help="Days for which they are valid.")] = 825,
) -> None:
    """Write the keys and certificates with which services, scheduler and workers authenticate."""
    from vibroimpact_service.jobs import certificates as files

    try:
        paths = files.write(folder, days)
    except FileExistsError as error:
        typer.echo(f"{error.filename} exists already", err=True)
        raise typer.Exit(1) from None
    for name, path in zip(files.FILES, paths, strict=True):
        typer.echo(f"VIBROIMPACT_TLS_{name}={path.absolute()}")


def _cluster_settings(tls: Path | None, **given: Any) -> Settings:
    from vibroimpact_service.jobs.certificates import FILES

    if tls is not None:
        given |= {f"tls_{name.lower()}": tls / file for name, file in FILES.items()}
    settings = exits.settings(**given)
    with exits.reported():
        check_certificates(settings)
    return settings


@app.command()
def openapi(
    check: Annotated[
        bool, typer.Option("--check", help="Only check whether the committed one is current.")
    ] = False,
) -> None:
    """Write the OpenAPI document to openapi/openapi.json of the source tree."""
    text = contract_text()
    if not check:
        _CONTRACT.write_text(text)
        typer.echo(f"wrote {_CONTRACT}")
    elif not _CONTRACT.exists() or _CONTRACT.read_text() != text:
        typer.echo("openapi/openapi.json is not up to date; write it again", err=True)
        raise typer.Exit(1)


def contract_text() -> str:
    """Return the OpenAPI document as it is committed."""
    from vibroimpact_service.api import openapi
    from vibroimpact_service.app import create_app

    document = openapi.document(create_app(Settings()))
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _say(text: str) -> None:
    """Tell whoever starts the service: plainly in a terminal, else by a line of the log."""
    if sys.stderr.isatty():
        typer.echo(text, err=True)
    else:
        log.info(text)


def _end_threads() -> None:
    """End the process if a computation does not stop in time.

    Its result is no longer awaited, and files appear whole or not at all; the interpreter would
    wait for its thread without limit.
    """
    end = time.monotonic() + _STOPPING_SECONDS
    others = [each for each in threading.enumerate() if each is not threading.current_thread()]
    for thread in others:
        if not thread.daemon:
            thread.join(max(0.0, end - time.monotonic()))
    if any(thread.is_alive() and not thread.daemon for thread in others):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def _address(server: uvicorn.Server) -> str:
    """Return the URL at which a server listens."""
    host, port = server.servers[0].sockets[0].getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


class Server(uvicorn.Server):
    """uvicorn that announces its address and tells the application when to stop."""

    def __init__(self, application: FastAPI, settings: Settings) -> None:
        config = uvicorn.Config(
            application,
            host=settings.host,
            port=settings.port,
            http=connection(settings),
            log_config=None,
            access_log=False,
            server_header=False,
            ws="none",
            lifespan="on",
            timeout_graceful_shutdown=8,
            timeout_keep_alive=30,
            reset_contextvars=True,
        )
        super().__init__(config)
        self._application, self._note = application, settings.data / "service.json"
        self._metrics: MetricsServer | None = None
        if settings.metrics_port is not None:
            # Worker processes import this module too.
            from vibroimpact_service.metrics_port import MetricsServer

            self._metrics = MetricsServer(application.state.services, settings.metrics_port)

    async def startup(self, sockets: list[object] | None = None) -> None:  # type: ignore[override]
        """Listen, then write and print the address."""
        await super().startup(sockets)  # type: ignore[arg-type]
        if self.should_exit or not self.servers:
            return
        if self._metrics is not None:
            try:
                await self._metrics.start()
            except SystemExit:
                await super().shutdown()
                raise
        url = _address(self)
        note: dict[str, Any] = {"url": url, "pid": os.getpid()}
        if notice := self._application.state.services.evaluation.warming.notice:
            note["notice"] = notice  # for a client that has started the service
        if self._metrics is not None:
            note["metrics"] = _address(self._metrics)
            log.info("metrics and health", url=note["metrics"])
        # Other processes wait for this file, and must not read half of it.
        passing = self._note.with_suffix(".tmp")
        # If records and results are elsewhere, the folder may not exist.
        private.folder(self._note.parent)
        with open(passing, "w", opener=private.opener) as file:
            file.write(json.dumps(note))
        passing.replace(self._note)
        typer.echo(url)

    async def shutdown(self, sockets: list[object] | None = None) -> None:  # type: ignore[override]
        """Remove the file and stop."""
        self._note.unlink(missing_ok=True)
        if self._metrics is not None:
            await self._metrics.shutdown()
        await super().shutdown(sockets)  # type: ignore[arg-type]

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        if not self.should_exit:
            stopping.begin()
        # Event streams and long polls end themselves; uvicorn would wait for them.
        self._application.state.services.drain.set()
        self._application.state.services.evaluation.queue.engine.end()
        # uvicorn would raise the signal again at the end; a service that stopped because it
        # was asked to has succeeded.
        self.force_exit = self.should_exit and sig == signal.SIGINT
        self.should_exit = True


if __name__ == "__main__":
    app()
