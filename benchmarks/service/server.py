"""A service in processes of its own, for the benchmarks that ask it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from httpx2 import Client, Response

from benchmarks.service.requests import COMPUTE

STARTING: Final = 120.0
"""Seconds until it must be ready."""
PATIENCE: Final = 120.0
"""Seconds that an answer may take."""
_STOPPING: Final = 30.0
_MEBI: Final = 1024.0  # kibibytes


class Server:
    """A service, and a client of it.

    Parameters
    ----------
    data : Path
        Its folder.
    workers : int
    checkout : Path, optional
        Another checkout of the project whose service is started.
    python : Path, optional
        The interpreter; without it that of this process, or of the other checkout's ``.venv``.
    environment : mapping, optional
        What it sees beside the environment of this process.
    """

    def __init__(
        self,
        data: Path,
        workers: int = 1,
        checkout: Path | None = None,
        python: Path | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        if python is None:
            python = Path(sys.executable) if checkout is None else checkout / ".venv/bin/python"
        self.data = data
        data.mkdir(parents=True, exist_ok=True)
        own = {"OMP_NUM_THREADS": "1", "VIBROIMPACT_WORKERS": str(workers)}
        with (data / "log").open("wb") as log:
            self.process = subprocess.Popen(
                [str(python), "-m", "vibroimpact_service", "--port", "0", "--data", str(data)],
                cwd=checkout,
                env={**os.environ, **own, **(environment or {})},
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self._client = Client(timeout=PATIENCE)
        try:
            self._wait()
        except BaseException:
            self.close()
            raise

    def _wait(self) -> None:
        end = time.monotonic() + STARTING
        note = self.data / "service.json"
        while True:
            if self.process.poll() is not None or time.monotonic() > end:
                raise RuntimeError(f"no service: {(self.data / 'log').read_text()[-2000:]}")
            if note.exists():
                self.url = str(json.loads(note.read_text())["url"])
                if self.ask("GET", "/v1/health/ready").status_code == 200:
                    return
            time.sleep(0.05)

    def ask(self, method: str, path: str, content: Any = None) -> Response:
        """Return an answer."""
        return self._client.request(method, self.url + path, json=content)

    def answered(self, method: str, path: str, content: Any = None, status: int = 200) -> Response:
        """Return an answer that must have a status."""
        answer = self.ask(method, path, content)
        if answer.status_code != status:
            raise RuntimeError(f"{path}: {answer.status_code} {answer.text[:500]}")
        return answer

    def stored(self, content: Any) -> Response:
        """Return an answer for impact modes whose result is stored.

        Where kernels must be compiled first, the first one becomes a job.
        """
        while (answer := self.ask("POST", COMPUTE, content)).status_code == 202:
            self.done(answer.json()["id"])
        if answer.status_code != 200:
            raise RuntimeError(answer.text[:500])
        return answer

    def job(self, content: Any) -> str:
        """Submit a job for impact modes and return its id."""
        job = {"kind": "impact-modes", "request": content}
        return str(self.answered("POST", "/v1/jobs", job, 201).json()["id"])

    def done(self, job: str) -> None:
        """Wait for a job."""
        while not (document := self.ask("GET", f"/v1/jobs/{job}?wait=20").json())["final"]:
            continue
        if document["state"] != "succeeded":
            raise RuntimeError(document)

    def processes(self) -> list[int]:
        """Return the ids of all its processes."""
        return session(self.process.pid)

    def memory(self) -> float:
        """Return mebibytes of the process that serves."""
        words = Path(f"/proc/{self.process.pid}/status").read_text().split("VmRSS:")[1].split()
        return int(words[0]) / _MEBI

    def memory_of_all(self) -> float:
        """Return mebibytes of all processes, pages that several share divided among them."""
        total = 0
        for process in self.processes():
            with suppress(OSError):
                lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
                total += sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
        return total / _MEBI

    def processor(self) -> float:
        """Return the seconds of processor time that the serving process has spent."""
        return seconds([self.process.pid])

    def close(self) -> None:
        """Stop it, and leave no process of it behind."""
        self._client.close()
        with suppress(ProcessLookupError):
            self.process.terminate()
        try:
            self.process.wait(_STOPPING)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        finally:
            end = time.monotonic() + 5.0
            while (left := self.processes()) and time.monotonic() < end:
                time.sleep(0.05)
            for process in left:
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)


@contextmanager
def running(workers: int = 1, environment: Mapping[str, str] | None = None) -> Iterator[Server]:
    """Give a service on an empty folder."""
    with (
        tempfile.TemporaryDirectory() as folder,
        closing(Server(Path(folder) / "data", workers, environment=environment)) as server,
    ):
        yield server


def session(leader: int) -> list[int]:
    """Return the ids of the processes of a session that have not ended."""
    alive = list[int]()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = stat.read_text().rpartition(")")[2].split()
            if int(fields[3]) == leader and fields[0] not in "ZX":
                alive.append(int(stat.parent.name))
    return alive


def seconds(processes: list[int]) -> float:
    """Return the processor time that some processes have spent."""
    ticks = 0
    for process in processes:
        with suppress(OSError):
            fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
            ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")
