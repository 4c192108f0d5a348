"""A real service in a process of its own, as users start it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx2
import pytest

from tests.forked import Forked


class Service:
    """A running service."""

    def __init__(self, data: Path, **environment: str) -> None:
        data.mkdir(parents=True, exist_ok=True)
        command = [sys.executable, "-m", "vibroimpact_service", "--port", "0", "--data", str(data)]
        settings = {f"VIBROIMPACT_{name.upper()}": value for name, value in environment.items()}
        self.data, self.note = data, data / "service.json"
        self.errors = (data / "stderr.txt").open("ab")
        self.process = subprocess.Popen(
            command,
            env={**os.environ, "OMP_NUM_THREADS": "1", "VIBROIMPACT_WORKERS": "1", **settings},
            stdout=subprocess.PIPE,
            stderr=self.errors,
        )
        self._wait(self.note.exists)
        self.url: str = json.loads(self.note.read_text())["url"]
        self.http = httpx2.Client(base_url=self.url, timeout=60)

    def wait_ready(self) -> None:
        """Wait until there are workers."""
        self._wait(lambda: self.http.get("/v1/health/ready").is_success)

    def _wait(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + 600  # it takes minutes on a machine that is kept busy
        while not condition():
            assert self.process.poll() is None, (self.data / "stderr.txt").read_text()
            assert time.monotonic() < end, "the service does not start"
            time.sleep(0.05)

    def stop(self, sign: signal.Signals = signal.SIGTERM) -> int:
        """Stop it and return its exit code."""
        self.http.close()
        self.process.send_signal(sign)
        code = self.process.wait(60)
        assert self.process.stdout is not None
        self.process.stdout.close()
        self.errors.close()
        return code


@pytest.fixture(scope="session")
def start() -> Iterator[Callable[..., Service]]:
    """Return the function that starts a service; what still runs at the end is stopped.

    Kernels are compiled before, for else requests that need them would become jobs.
    """
    subprocess.run([sys.executable, "-m", "vibroimpact_service.cli", "warm"], check=True)
    started: list[Service] = []

    def starting(data: Path, **environment: str) -> Service:
        started.append(Service(data, **environment))
        return started[-1]

    yield starting
    for service in started:
        if service.process.poll() is None:
            service.stop()


@pytest.fixture(scope="session")
def commands() -> Iterator[Callable[..., subprocess.CompletedProcess[str]]]:
    """Return the function that runs ``vibroimpact`` with some arguments in a process of its own.

    Further arguments are those of `tests.forked.Forked`.
    """
    forked = Forked(
        "vibroimpact.cli.app",
        "vibroimpact_service.access.commands",
        "vibroimpact_service.app",
        "vibroimpact_service.cli",
        "vibroimpact_service.operations.commands",
        environment={**os.environ, "COLUMNS": "200", "OMP_NUM_THREADS": "1"},
    )
    code = "import sys; from vibroimpact.cli import main; sys.argv[0] = 'vibroimpact'; main()"

    def run(*arguments: str, **more: Any) -> subprocess.CompletedProcess[str]:
        return forked(code, *arguments, **more)

    yield run
    forked.close()


@pytest.fixture(scope="session")
def service(start: Callable[..., Service], tmp_path_factory: pytest.TempPathFactory) -> Service:
    """Return the service that tests which leave it running share."""
    return start(tmp_path_factory.mktemp("service"))
