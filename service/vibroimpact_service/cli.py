"""The commands of the service: serve, and write the contract."""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import structlog
import typer
import uvicorn

from vibroimpact_service.settings import Settings

if TYPE_CHECKING:
    from fastapi import FastAPI

_CONTRACT = Path(__file__).resolve().parents[2] / "openapi" / "openapi.json"

app = typer.Typer(help=__doc__, no_args_is_help=True, add_completion=False)


@app.command()
def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on [127.0.0.1].")] = None,
    port: Annotated[int | None, typer.Option(help="Port; 0 takes a free one [8000].")] = None,
    data: Annotated[
        Path | None, typer.Option(help="Folder for records and results [./vibroimpact-data].")
    ] = None,
) -> None:
    """Start the service: HTTP, job queue, workers and store, until SIGTERM or Ctrl-C.

    Everything else is set by environment variables VIBROIMPACT_….
    """
    from vibroimpact_service.app import create_app  # worker processes import this module too

    given: dict[str, Any] = {"host": host, "port": port, "data": data}
    settings = Settings(**{name: value for name, value in given.items() if value is not None})
    _log_to_stderr()
    server = _Server(create_app(settings), settings)
    server.run()
    if not server.started:
        raise typer.Exit(3)


@app.command()
def openapi(
    check: Annotated[
        bool, typer.Option("--check", help="Only tell whether the committed one is current.")
    ] = False,
) -> None:
    """Write the contract to openapi/openapi.json of the source tree."""
    text = contract_text()
    if not check:
        _CONTRACT.write_text(text)
        typer.echo(f"wrote {_CONTRACT}")
    elif not _CONTRACT.exists() or _CONTRACT.read_text() != text:
        typer.echo("openapi/openapi.json is not what the service speaks; write it anew", err=True)
        raise typer.Exit(1)


def contract_text() -> str:
    """Return the contract as it is committed."""
    from vibroimpact_service.api import contract
    from vibroimpact_service.app import create_app

    return (
        json.dumps(contract.document(create_app(Settings())), indent=1, ensure_ascii=False) + "\n"
    )


class _Server(uvicorn.Server):
    """uvicorn that says where it listens and tells the application when to stop."""

    def __init__(self, application: FastAPI, settings: Settings) -> None:
        config = uvicorn.Config(
            application,
            host=settings.host,
            port=settings.port,
            log_config=None,
            access_log=False,
            server_header=False,
            ws="none",
            lifespan="on",
            timeout_graceful_shutdown=8,
        )
        super().__init__(config)
        self._application, self._note = application, settings.data / "service.json"

    async def startup(self, sockets: list[object] | None = None) -> None:  # type: ignore[override]
        await super().startup(sockets)  # type: ignore[arg-type]
        if self.should_exit or not self.servers:
            return
        host, port = self.servers[0].sockets[0].getsockname()[:2]
        url = f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"
        # Whoever started this waits for the file, and must not read half of it.
        passing = self._note.with_suffix(".tmp")
        passing.write_text(json.dumps({"url": url, "pid": os.getpid()}))
        passing.replace(self._note)
        sys.stdout.write(f"{url}\n")
        sys.stdout.flush()

    async def shutdown(self, sockets: list[object] | None = None) -> None:  # type: ignore[override]
        self._note.unlink(missing_ok=True)
        await super().shutdown(sockets)  # type: ignore[arg-type]

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        # Event streams and long polls end themselves; uvicorn would wait for them.
        self._application.state.drain.set()
        # The signal is obeyed here and not raised again at the end, as uvicorn would:
        # a service that was asked to stop, and did, has succeeded.
        self.force_exit = self.should_exit and sig == signal.SIGINT
        self.should_exit = True


def _log_to_stderr() -> None:
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            structlog.processors.JSONRenderer(),
        ],
        logger_factory=structlog.WriteLoggerFactory(file=sys.stderr),
    )


if __name__ == "__main__":
    app()
