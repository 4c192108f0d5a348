"""The commands as operators run them: what they say of themselves and of mistakes."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from vibroimpact_service.jobs import data_folder

Run = Callable[..., subprocess.CompletedProcess[str]]

HELP = {
    ("serve",): ["127.0.0.1", "8000", "./vibroimpact-data"],
    ("scheduler",): ["8786", "VIBROIMPACT_TLS_"],
    ("worker",): ["VIBROIMPACT_SCHEDULER", "one per core"],
    ("certificates",): ["825", "ca.pem"],
    ("keys", "create"): ["read, submit", "./vibroimpact-data"],
    ("keys", "list"): ["./vibroimpact-data"],
    ("keys", "revoke"): ["./vibroimpact-data"],
    ("keys", "audit"): ["./vibroimpact-data"],
    ("migrate",): ["./vibroimpact-data", "--check"],
    ("doctor",): ["--service", "--data", "--json"],
    ("backup",): ["./vibroimpact-data", "Folder of the backup."],
    ("restore",): ["./vibroimpact-data", "--replace", "--check"],
    ("gallery",): ["[FIG]...", "10.19"],
    ("demo",): ["demo"],
    ("bench",): ["--list"],
    ("warm",): ["--dry-run", "the longest first"],
}


def _environment(**settings: object) -> dict[str, str]:
    own = {f"VIBROIMPACT_{name.upper()}": str(value) for name, value in settings.items()}
    return {**os.environ, "COLUMNS": "200", "OMP_NUM_THREADS": "1", **own}


@pytest.fixture
def run(commands: Run) -> Run:
    """Return the function that runs a command with some settings."""

    def given(*arguments: str, **settings: object) -> subprocess.CompletedProcess[str]:
        return commands(*arguments, environment=_environment(**settings))

    return given


@pytest.mark.parametrize("command", HELP, ids=" ".join)
def test_help_tells_defaults(run: Run, command: tuple[str, ...]) -> None:
    done = run(*command, "--help")
    assert done.returncode == 0, done.stderr
    shown = re.sub(r"\s+", " ", done.stdout.replace("│", " "))
    assert [word for word in HELP[command] if word not in shown] == []
    assert "[[" not in shown


def test_a_wrong_setting_is_one_line(run: Run, tmp_path: Path) -> None:
    done = run("serve", "--data", str(tmp_path), port="eight")
    assert done.returncode == 2
    assert done.stderr.startswith("Invalid setting VIBROIMPACT_PORT: ")
    assert done.stderr.count("\n") == 1


WRONG: dict[tuple[str, ...], tuple[str, str]] = {
    ("serve", "--port", "0"): ("limits_storage", "nothing://x"),
    ("serve", "--host", "300.1.1.1"): ("host", "300.1.1.1"),
    ("scheduler", "--port", "0"): ("store", "nothing://x"),
    ("worker", "tcp://127.0.0.1:1"): ("scheduler", "tls://s3cret"),
    ("keys", "list"): ("database", "postgresql://ann:s3cret@host:port/x"),
    ("migrate",): ("database", "s3cret"),
    ("doctor", "--service"): ("store", "s3:/bucket"),
    ("backup", "somewhere"): ("database", "mysql://ann:s3cret@host/x"),
}


@pytest.mark.parametrize("command", WRONG, ids=" ".join)
def test_a_wrong_address_is_one_line_from_every_command(
    run: Run, command: tuple[str, ...], tmp_path: Path
) -> None:
    name, value = WRONG[command]
    done = run(*command, **{name: value}, **({} if name == "data" else {"data": tmp_path}))
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith(f"Invalid setting VIBROIMPACT_{name.upper()}: ")
    assert done.stderr.count("\n") == 1
    assert "s3cret" not in done.stderr


def test_folders_that_cannot_be_made_are_one_line(run: Run) -> None:
    for command in (("serve", "--port", "0"), ("migrate",), ("keys", "list")):
        done = run(*command, data="/proc/x")
        assert done.returncode == 3
        assert done.stderr.endswith("/proc/x: No such file or directory\n")
        assert done.stderr.count("\n") == 1


def test_records_of_a_newer_version_are_one_line(run: Run, tmp_path: Path) -> None:
    assert run("migrate", "--data", str(tmp_path)).returncode == 0
    with closing(sqlite3.connect(tmp_path / "records.sqlite")) as records:
        records.execute("UPDATE alembic_version SET version_num = '9999'")
        records.commit()
    for command in (("serve", "--port", "0"), ("migrate",)):
        done = run(*command, "--data", str(tmp_path))
        assert done.returncode == 1, done.stderr
        assert "a newer version has migrated the records: revision 9999" in done.stderr
        assert done.stderr.count("\n") == 1


def test_a_data_folder_in_use_is_one_line(run: Run, tmp_path: Path) -> None:
    with data_folder.lock(tmp_path):
        done = run("serve", "--port", "0", "--data", str(tmp_path))
    assert done.returncode == 1, done.stderr
    assert done.stderr == f"The service does not start: another service runs on {tmp_path}\n"


def test_a_scheduler_that_cannot_listen_is_one_line(run: Run, tmp_path: Path) -> None:
    tls = str(tmp_path / "tls")
    assert run("certificates", tls).returncode == 0
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = str(other.getsockname()[1])
        done = run("scheduler", "--port", port, "--tls", tls)
    assert (done.returncode, done.stderr.count("\n")) == (3, 1), done.stderr
    assert done.stderr.startswith(f"127.0.0.1:{port}: ")
    done = run("scheduler", "--host", "300.1.1.1", "--tls", tls)
    assert (done.returncode, done.stderr.count("\n")) == (3, 1), done.stderr


def test_certificates_that_do_not_belong_together_are_named(run: Run, tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    for folder in (one, other):
        assert run("certificates", str(folder)).returncode == 0
    (one / "key.pem").write_bytes((other / "key.pem").read_bytes())
    done = run("worker", "tls://127.0.0.1:1", "--tls", str(one))
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("Invalid setting VIBROIMPACT_TLS_CERT: ")
    (one / "ca.pem").write_text("nothing")
    files = {f"tls_{name}": one / f"{name}.pem" for name in ("ca", "cert", "key")}
    given = {"scheduler": "tls://127.0.0.1:1", "data": tmp_path / "data", **files}
    done = run("serve", "--port", "0", **given)
    assert done.returncode == 2, done.stderr
    assert "Invalid setting VIBROIMPACT_TLS_CA: " in done.stderr


def test_a_database_that_does_not_answer_is_told(run: Run, tmp_path: Path) -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        database = f"postgresql://ann:secret@127.0.0.1:{closed.getsockname()[1]}/x"
        done = run("serve", "--data", str(tmp_path), host="0.0.0.0", database=database)
    assert done.returncode == 3
    assert done.stderr.startswith("The service does not start: the database cannot be reached")
    assert "Traceback" not in done.stderr
    assert "secret" not in done.stderr


@pytest.mark.parametrize("command", [("scheduler",), ("worker", "tls://127.0.0.1:1")])
def test_certificates_that_lack_are_named(
    run: Run, command: tuple[str, ...], tmp_path: Path
) -> None:
    done = run(*command, "--tls", str(tmp_path / "tls"))
    assert done.returncode == 2
    assert str(tmp_path / "tls" / "key.pem") in done.stderr
    done = run(*command)
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


def test_operators_look_after_an_installation(run: Run, tmp_path: Path) -> None:
    """Every step as it is typed: migrate, a key, check, back up, verify, restore elsewhere."""
    data, folder, other = (tmp_path / name for name in ("data", "backup", "other"))
    assert run("migrate", "--data", str(data)).returncode == 0
    for owner in ("ann", "elizabeth"):
        assert run("keys", "create", owner, "--data", str(data)).returncode == 0
    checked = run("doctor", "--data", str(data), "--json")
    assert (checked.returncode, json.loads(checked.stdout)["ok"]) == (0, True), checked.stderr
    saved = run("backup", str(folder), "--data", str(data))
    assert saved.stdout == f"{folder}: 0 jobs, 2 keys, 0 files, 0.0 MB; 0 new files\n"
    assert run("restore", str(folder), "--check").returncode == 0
    assert run("restore", str(folder), "--data", str(other)).returncode == 0
    listed = [run("keys", "list", "--data", str(each)).stdout for each in (data, other)]
    assert listed[0] == listed[1]
    assert [line.split()[2] for line in listed[0].splitlines()] == ["ann", "elizabeth"]
    assert len({line.index("read,submit") for line in listed[0].splitlines()}) == 1
    again = run("restore", str(folder), "--data", str(other))
    assert (again.returncode, again.stdout) == (1, "")
    assert again.stderr == "there are records already; --replace removes them\n"
    for arguments in (("backup", str(folder / "manifest.json" / "x")), ("backup", "/proc/x/y")):
        refused = run(*arguments, "--data", str(data))
        assert refused.returncode == 3, refused.stderr
        assert refused.stderr.count("\n") == 1


def test_a_port_for_metrics_that_is_taken_ends_the_start(run: Run, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = str(other.getsockname()[1])
        arguments = ("serve", "--port", "0", "--data", str(tmp_path), "--metrics-port", port)
        done = run(*arguments, workers=1)
    assert done.returncode == 3
    assert "address already in use" in done.stderr
    assert not (tmp_path / "service.json").exists()
