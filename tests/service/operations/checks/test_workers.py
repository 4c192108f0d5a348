"""A scheduler that is gone, has no workers, or workers of another version."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from vibroimpact_service.jobs import certificates, versions
from vibroimpact_service.operations.checks.workers import workers
from vibroimpact_service.settings import Settings

Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture(scope="module")
def tls(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    paths = certificates.write(tmp_path_factory.mktemp("tls"), days=2)
    return dict(zip(("tls_ca", "tls_cert", "tls_key"), paths, strict=True))


@pytest.fixture
def start(tls: dict[str, Path]) -> Iterator[Start]:
    processes = []

    def run(*arguments: str) -> subprocess.Popen[str]:
        code = "import sys; from vibroimpact_service.cli import app; app(sys.argv[1:])"
        folder = str(tls["tls_ca"].parent)
        process = subprocess.Popen(
            [sys.executable, "-c", code, *arguments, "--tls", folder],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        processes.append(process)
        return process

    yield run
    for process in reversed(processes):
        process.terminate()
        process.communicate(timeout=60)


def said(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def states(settings: Settings) -> list[tuple[str, str]]:
    return [(check.name, check.state) for check in workers(settings)]


def test_a_cluster(start: Start, tls: dict[str, Path]) -> None:
    address = said(start("scheduler", "--port", "0"))
    settings = Settings(scheduler=address, **tls)  # type: ignore[arg-type]
    assert states(settings) == [("scheduler", "ok"), ("workers", "failed")]
    assert said(start("worker", address, "--workers", "1")) == "1 workers"
    assert states(settings) == [("scheduler", "ok"), ("workers", "ok")]


def test_versions_that_differ(
    start: Start, tls: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    address = said(start("scheduler", "--port", "0"))
    assert said(start("worker", address, "--workers", "1")) == "1 workers"
    settings = Settings(scheduler=address, **tls)  # type: ignore[arg-type]
    here = versions.here()
    monkeypatch.setattr(versions, "here", lambda: here | {"vibroimpact": "9.9"})
    scheduler, worker = workers(settings)
    assert (scheduler.state, worker.name, worker.state) == ("failed", "worker", "failed")
    for check in (scheduler, worker):
        assert check.seen.endswith(f"vibroimpact {here['vibroimpact']} instead of 9.9")


def test_strangers_and_nobody(start: Start, tls: dict[str, Path], tmp_path: Path) -> None:
    address = said(start("scheduler", "--port", "0"))
    other = dict(zip(tls, certificates.write(tmp_path / "tls", days=2), strict=True))
    assert states(Settings(scheduler=address, **other)) == [("scheduler", "failed")]  # type: ignore[arg-type]
    nobody: Any = Settings(scheduler="tls://127.0.0.1:1", **tls)  # type: ignore[arg-type]
    assert states(nobody) == [("scheduler", "failed")]
    assert states(Settings(scheduler="tcp://127.0.0.1:1")) == [("scheduler", "failed")]
    assert states(Settings()) == []
