"""Whatever hangs, a process that was told to stop ends, with those that it started."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import httpx2
import pytest

HANGING = """
import ctypes, subprocess, sys, threading
from vibroimpact_service import stopping
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"],
    stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
child.send_signal(19)
print(child.pid, flush=True)
stopping.begin(0.5, 1.0)
{hang}
"""
HANGS = {
    "a lock": "threading.Event().wait()",
    "a thread": "threading.Thread(target=threading.Event().wait).start()",
    "a loop": "while True: pass",
    "the interpreter": "ctypes.PyDLL(None).sleep(600)",
}


def gone(process: int) -> bool:
    """Whether a process has ended, or ends within a minute."""
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        try:
            state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state == "Z":
            return True
        time.sleep(0.05)
    return False


@pytest.mark.parametrize("where", HANGS)
def test_a_process_ends_whatever_hangs(where: str) -> None:
    script = HANGING.format(hang=HANGS[where])
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    child = int(process.stdout.readline())
    try:
        _, told = process.communicate(timeout=120)
        if where == "the interpreter":
            assert "most recent call first" in told
        else:
            assert process.returncode == 0
            assert gone(child)
    finally:
        process.kill()
        process.communicate()
        if Path(f"/proc/{child}").exists():
            os.kill(child, signal.SIGKILL)


def children(process: int) -> dict[int, str]:
    pids = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(file.read_text().rpartition(")")[2].split()[1])
            if parent == process:
                pids[int(file.parent.name)] = (file.parent / "cmdline").read_text()
        except (OSError, IndexError):
            continue
    return pids


def test_the_service_ends_while_the_forkserver_stands_still(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "vibroimpact_service", "--port", "0", "--data", str(tmp_path)]
    environment = {**os.environ, "VIBROIMPACT_WORKERS": "1", "VIBROIMPACT_INLINE_THREADS": "1"}
    log = (tmp_path / "log").open("w")
    service = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=log, env=environment, text=True
    )
    assert service.stdout is not None
    forkserver = None
    try:
        assert service.stdout.readline().startswith("http://")
        started = children(service.pid)
        forkserver = next(pid for pid, line in started.items() if "forkserver" in line)
        os.kill(forkserver, signal.SIGSTOP)
        service.send_signal(signal.SIGTERM)
        assert service.wait(60) == 0
        assert gone(forkserver)
    finally:
        service.kill()
        service.wait()
        service.stdout.close()
        log.close()
        if forkserver is not None and Path(f"/proc/{forkserver}").exists():
            os.kill(forkserver, signal.SIGKILL)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "SIGTERM"])
def test_the_service_ends_in_silence_where_all_its_processes_are_told_to(
    tmp_path: Path, how: signal.Signals
) -> None:
    """A terminal sends Ctrl-C to all of them, and systemd SIGTERM."""
    command = [sys.executable, "-m", "vibroimpact_service", "--port", "0", "--data", str(tmp_path)]
    errors = tmp_path / "stderr.txt"
    with errors.open("w") as log:
        service = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=log,
            env={**os.environ, "VIBROIMPACT_WORKERS": "2"},
            text=True,
            start_new_session=True,
        )
        assert service.stdout is not None
        try:
            url = service.stdout.readline().strip()
            end = time.monotonic() + 120
            while httpx2.get(f"{url}/v1/health/ready").status_code != 200:
                assert time.monotonic() < end
                time.sleep(0.2)
            os.killpg(service.pid, how)
            assert service.wait(60) == 0
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(service.pid, signal.SIGKILL)
            service.wait()
            service.stdout.close()
    said = [json.loads(line) for line in errors.read_text().splitlines()]
    assert said
    # A worker that ends before the service knows that it shall may be started once more.
    quiet = ("info", "debug") if how == signal.SIGINT else ("info", "debug", "warning")
    assert [each for each in said if each["level"] not in quiet] == []
