"""Real processes that can be killed, and the record of the chunks that their workers computed."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import httpx2

HERE = Path(__file__).parent
SLOW = 90.0
"""Seconds that a condition may take to become true."""


def until(condition: Callable[[], Any], what: str, seconds: float = SLOW) -> Any:
    """Wait for a condition and return its value."""
    end = time.monotonic() + seconds
    while True:
        value = condition()
        if value:
            return value
        assert time.monotonic() < end, f"after {seconds} s: {what}"
        time.sleep(0.02)


class Begun(NamedTuple):
    """A chunk that a worker began or stored."""

    what: str
    result: str
    index: int
    pid: int
    time: float


class Record:
    """The notes of the workers."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def noted(self) -> list[Begun]:
        """Return all notes, in order."""
        if not self.path.exists():
            return []
        lines = [line.split() for line in self.path.read_text().splitlines()]
        return [Begun(w, r, int(i), int(p), float(t)) for w, r, i, p, t in lines]

    def begun(self) -> list[Begun]:
        """Return all chunks that were begun, in order."""
        return [note for note in self.noted() if note.what == "begun"]

    def after(self, moment: float, *but: int) -> Begun | None:
        """Return the first chunk that was begun after a moment, not by some processes."""
        later = (b for b in self.begun() if b.time > moment and b.pid not in but)
        return next(later, None)

    def repeated(self) -> int:
        """Return how many chunks were begun more often than once, counting each repetition."""
        times = Counter((b.result, b.index) for b in self.begun())
        return sum(count - 1 for count in times.values())

    def check(self, unreachable: int = 0) -> None:
        """Check that only chunks that were being computed were repeated, and none that was stored.

        `unreachable` is how many may be stored twice, because a worker that could not be reached
        went on with its calls.
        """
        stored: set[tuple[str, int]] = set()
        twice = 0
        for note in self.noted():
            chunk = (note.result, note.index)
            if note.what == "stored":
                twice += chunk in stored
                stored.add(chunk)
            else:
                assert chunk not in stored, f"{note} is computed again though it was stored"
        print("chunks begun again:", self.repeated(), "of them stored twice:", twice)
        assert twice <= unreachable


class Process:
    """A process of the service with its own group, so that all of it can be ended."""

    def __init__(self, command: Sequence[str], folder: Path, **environment: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.errors = folder / "stderr.txt"
        places = os.pathsep.join(filter(None, (str(HERE), os.environ.get("PYTHONPATH"))))
        with self.errors.open("ab") as errors:
            self.process = subprocess.Popen(
                command,
                env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": places, **environment},
                stdout=errors,
                stderr=errors,
                start_new_session=True,
            )

    def kill(self) -> float:
        """Kill the process, not its children, without warning; return when."""
        moment = time.time()
        self.process.kill()
        self.process.wait(30)
        return moment

    def end(self) -> None:
        """End it and all its children."""
        if self.process.poll() is None:
            self.process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(20)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait(30)


class Replica(Process):
    """A service with HTTP; `within` is written before its command, as for another namespace."""

    def __init__(
        self, folder: Path, record: Record, within: Sequence[str] = (), **settings: str
    ) -> None:
        self.note = folder / "service.json"
        self.note.unlink(missing_ok=True)
        # Names in capitals are variables as they are.
        environment = {
            name if name.isupper() else f"VIBROIMPACT_{name.upper()}": value
            for name, value in settings.items()
        }
        # Quick jobs are sent through the queue and the workers, where more can go wrong.
        defaults = {
            "VIBROIMPACT_PORT": "0",
            "VIBROIMPACT_DATA": str(folder),
            "VIBROIMPACT_ON_SUBMISSION_SECONDS": "0",
        }
        command = [*within, sys.executable, str(HERE / "replica.py")]
        super().__init__(
            command,
            folder,
            **{"RECORD": str(record.path), "VIBROIMPACT_WORKERS": "1", **defaults, **environment},
        )
        until(lambda: self.note.exists() or self.process.poll() is not None, "no HTTP")
        assert self.process.poll() is None, self.errors.read_text()
        self.http = httpx2.Client(base_url=json.loads(self.note.read_text())["url"], timeout=30)

    def ready(self) -> bool:
        """Whether its readiness endpoint answers yes."""
        try:
            return bool(self.http.get("/v1/health/ready").is_success)
        except httpx2.TransportError:
            return False

    def end(self) -> None:
        """End it and all its children."""
        self.http.close()
        super().end()


def stat(process: int) -> list[str]:
    """Return what the system tells of a process: its state, its parent and more; or nothing."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return []


def children(process: int) -> list[int]:
    """Return the children of a process that live."""
    everyone = (int(path.name) for path in Path("/proc").glob("[0-9]*"))
    told = ((each, stat(each)) for each in everyone)
    return [each for each, fields in told if fields[1:2] == [str(process)] and fields[0] != "Z"]


def forkservers(replicas: Sequence[Replica]) -> list[int]:
    """Return the processes from which the workers of replicas are forked."""
    return [
        child
        for replica in replicas
        for child in children(replica.process.pid)
        if "forkserver" in _command(child)
    ]


def _command(process: int) -> str:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/cmdline").read_text()
    return ""


def program(*arguments: str) -> list[str]:
    """Return the command line of ``vibroimpact …``."""
    start = "import sys; from vibroimpact.cli import main; sys.argv[0] = 'vibroimpact'; main()"
    return [sys.executable, "-c", start, *arguments]
