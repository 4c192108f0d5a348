"""The commands as operators run them: what they say of themselves and of mistakes."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

HELP = {
    ("serve",): ["127.0.0.1", "8000", "./vibroimpact-data"],
    ("scheduler",): ["8786", "VIBROIMPACT_TLS_"],
    ("worker",): ["VIBROIMPACT_SCHEDULER", "one per core"],
    ("certificates",): ["825", "ca.pem"],
    ("keys", "create"): ["read, submit", "./vibroimpact-data"],
    ("keys", "list"): ["./vibroimpact-data"],
    ("keys", "revoke"): ["./vibroimpact-data"],
    ("keys", "audit"): ["./vibroimpact-data"],
    ("gallery",): ["[FIG]...", "10.19"],
    ("demo",): ["demo"],
    ("bench",): ["--list"],
}


def _environment(**settings: object) -> dict[str, str]:
    own = {f"VIBROIMPACT_{name.upper()}": str(value) for name, value in settings.items()}
    return {**os.environ, "COLUMNS": "200", "OMP_NUM_THREADS": "1", **own}


def _run(*arguments: str, **settings: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "vibroimpact.cli", *arguments],
        env=_environment(**settings), capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("command", HELP, ids=" ".join)
def test_help_tells_defaults(command: tuple[str, ...]) -> None:
    done = _run(*command, "--help")
    assert done.returncode == 0, done.stderr
    shown = re.sub(r"\s+", " ", done.stdout.replace("│", " "))
    assert [word for word in HELP[command] if word not in shown] == []
    assert "[[" not in shown


def test_a_wrong_setting_is_one_line(tmp_path: Path) -> None:
    done = _run("serve", "--data", str(tmp_path), port="eight")
    assert done.returncode == 2
    assert done.stderr.startswith("Invalid setting: VIBROIMPACT_PORT: ")
    assert done.stderr.count("\n") == 1


def test_a_database_that_does_not_answer_is_told(tmp_path: Path) -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        database = f"postgresql://ann:secret@127.0.0.1:{closed.getsockname()[1]}/x"
        done = _run("serve", "--data", str(tmp_path), host="0.0.0.0", database=database)
    assert done.returncode == 3
    assert done.stderr.startswith("The service does not start: the database cannot be reached")
    assert "Traceback" not in done.stderr
    assert "secret" not in done.stderr


@pytest.mark.parametrize("command", [("scheduler",), ("worker", "tls://127.0.0.1:1")])
def test_certificates_that_lack_are_named(command: tuple[str, ...], tmp_path: Path) -> None:
    done = _run(*command, "--tls", str(tmp_path / "tls"))
    assert done.returncode == 2
    assert str(tmp_path / "tls" / "key.pem") in done.stderr
    done = _run(*command)
    assert done.returncode == 2
    assert "VIBROIMPACT_TLS_CA" in done.stderr


def test_the_service_makes_its_folder_and_logs_json(tmp_path: Path) -> None:
    """Records and store lie elsewhere, as in a cluster; nothing but the address is on stdout."""
    data, errors = tmp_path / "not" / "there", tmp_path / "stderr.txt"
    with errors.open("wb") as log:
        service = subprocess.Popen(
            [sys.executable, "-m", "vibroimpact_service", "--port", "0", "--data", str(data)],
            env=_environment(
                database=f"sqlite:///{tmp_path / 'records.sqlite'}",
                store=tmp_path / "store", workers=1, worker=2,
            ),
            stdout=subprocess.PIPE, stderr=log, text=True,
        )  # fmt: skip
    end = time.monotonic() + 60
    while not (data / "service.json").exists():
        assert service.poll() is None, errors.read_text()
        assert time.monotonic() < end
        time.sleep(0.05)
    url = json.loads((data / "service.json").read_text())["url"]
    service.send_signal(signal.SIGTERM)
    said, _ = service.communicate(timeout=60)
    assert service.returncode == 0, errors.read_text()
    assert said == f"{url}\n"
    lines = [json.loads(line) for line in errors.read_text().splitlines()]
    assert [line["variable"] for line in lines if "variable" in line] == ["VIBROIMPACT_WORKER"]
