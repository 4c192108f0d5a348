"""Make a data folder with the service of version 0.1.0, and note what it answered.

Run with the environment of a checkout of the tag v0.1.0, whose modules it uses::

    python make_data.py data-0.1.0.tar.xz
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

CHAIN = {"preset": "chain", "n": 7, "constraints": [{"dof": 2, "gap": 0.2}]}
OSCILLATOR = {
    "preset": "oscillator",
    "Omega0": 1.0,
    "zeta": 0.02,
    "constraints": [{"dof": 0, "gap": 1.0, "restitution": 0.8}],
}
MOTION = {
    "system": OSCILLATOR,
    "initial": {"x": [0.0], "v": [2.0]},
    "t_end": 20.0,
    "t": {"num": 5},
    "outputs": ["x", "v", "impacts", "energy"],
}
IMPACT_MODES = {
    "system": CHAIN,
    "frequency": {"start": 1.0, "stop": 3.0, "num": 9},
    "outputs": ["impulse", "exists", "reason", "shape", "energy", "stability"],
}
INLINE = {
    "impact-modes": IMPACT_MODES,
    "existence-bands": {"system": CHAIN, "frequency": {"start": 0.8, "stop": 3.0}},
    "resonances": {"system": CHAIN},
    "time-history": MOTION,
    "ensemble": {**MOTION, "initial": {"x": [[0.0], [0.1]], "v": [[2.0], [1.0]]}},
    "slow-flow": {
        "system": {
            "preset": "oscillator",
            "Omega0": 1.0,
            "constraints": [{"dof": 0, "gap": 1.0, "restitution": 0.9}],
        },
        "model": "restitution",
        "variant": "exact",
        "initial": {"omega": 5.0},
        "t": {"start": 0.0, "stop": 5.0, "num": 6},
    },
    "sweep": {
        "kind": "impact-modes",
        "base": IMPACT_MODES,
        "axes": [{"path": "system.stiffness", "name": "stiffness", "values": [1.0, 1.4]}],
    },
}
SLOW = {
    "system": {"preset": "chain", "n": 300, "constraints": [{"dof": 5, "gap": 0.2}]},
    "frequency": {"start": 0.6, "stop": 2.4, "num": 900_000},
    "outputs": ["impulse"],
}


class Service:
    """A running service of 0.1.0, without inline work where `long_way`."""

    def __init__(self, data: Path, key: str, *, long_way: bool = False) -> None:
        self._key, note = key, data / "service.json"
        environment = {"VIBROIMPACT_SPOT_SECONDS": "0"} if long_way else {}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "vibroimpact_service", "--port", "0", "--data", str(data)],
            env={**os.environ, "VIBROIMPACT_WORKERS": "1", **environment},
        )
        while not note.exists():
            time.sleep(0.1)
        self._url = json.loads(note.read_text())["url"]
        while b"true" not in self.ask("GET", "/v1/health/ready", statuses=(200, 503)):
            time.sleep(0.1)

    def ask(
        self, method: str, path: str, content: Any = None, statuses: tuple[int, ...] = (200, 201)
    ) -> bytes:
        """Return the body of an answer."""
        body = None if content is None else json.dumps(content).encode()
        head = {"Authorization": f"Bearer {self._key}", "Content-Type": "application/json"}
        request = urllib.request.Request(self._url + path, body, head, method=method)
        try:
            with urllib.request.urlopen(request) as answer:
                return bytes(answer.read())
        except urllib.error.HTTPError as error:
            if error.code not in statuses:
                raise RuntimeError(error.read()) from error
            return bytes(error.read())

    def document(self, *arguments: Any) -> Any:
        """Return the JSON document of an answer."""
        return json.loads(self.ask(*arguments))

    def job(self, kind: str, request: Any, **terms: Any) -> str:
        """Submit a job and return its id."""
        content = {"kind": kind, "request": request, **terms}
        return str(self.document("POST", "/v1/jobs", content)["id"])

    def ended(self, job: str) -> None:
        """Wait for the end of a job."""
        while not self.document("GET", f"/v1/jobs/{job}?wait=20")["final"]:
            continue

    def stop(self) -> None:
        """Stop it."""
        self._process.terminate()
        self._process.wait()


def fill(data: Path, key: str) -> dict[str, Any]:
    """Compute, submit, store; return what the service then answers about all of it."""
    service = Service(data, key, long_way=True)
    system = service.document("POST", "/v1/systems", CHAIN)["id"]
    for kind, request in INLINE.items():
        service.document("POST", f"/v1/compute/{kind}", request)
    # By reference to the stored system, in pieces; twice, so that one is reused.
    sweep = {"start": 0.5, "stop": 2.5, "num": 40}
    request = {"system": {"id": system}, "frequency": sweep, "outputs": ["impulse", "exists"]}
    for _ in range(2):
        service.ended(service.job("impact-modes", request))
    service.ended(service.job("existence-bands", {**INLINE["existence-bands"], "frequency": {
        "start": 0.9, "stop": 2.0}}))  # fmt: skip
    cancelled = service.job("impact-modes", SLOW)
    failed = service.job("impact-modes", {**SLOW, "outputs": ["exists"]}, deadline_seconds=1.0)
    service.ended(failed)
    service.document("DELETE", f"/v1/jobs/{cancelled}")
    service.stop()

    service = Service(data, key)
    service.ended(service.job("resonances", {"system": CHAIN, "odd_max": 5}))  # done on submission
    jobs = service.document("GET", "/v1/jobs")["jobs"]
    results = {}
    for store in sorted((data / "store" / "results").glob("*/*")):
        name = store.name.split(".", 1)[0]
        results[name] = service.document("GET", f"/v1/results/{name}")
    stored = {system: service.document("GET", f"/v1/systems/{system}")}
    service.stop()
    return {"key": key, "jobs": jobs, "results": results, "systems": stored}


def pin(data: Path, owner: str, result: str) -> None:
    """Pin a result, which HTTP does not offer."""
    from vibroimpact_service.jobs import ledger  # type: ignore[attr-defined]
    from vibroimpact_service.jobs.database import open_database

    engine = open_database(f"sqlite:///{data / 'records.sqlite'}")
    with engine.begin() as connection:
        ledger.pin(owner, result)(connection)
    engine.dispose()


def main(archive: str) -> None:
    """Write the archive: the folder ``data``, and ``answers.json``."""
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        command = (
            "import sys; from vibroimpact.cli import main; sys.argv[0] = 'vibroimpact'; main()"
        )
        made = subprocess.run(
            [sys.executable, "-c", command, "keys", "create", "ann", "--data", str(data)],
            check=True,
            capture_output=True,
            text=True,
        )
        answers = fill(data, made.stdout.strip())
        answers["pinned"] = [next(job["digest"] for job in answers["jobs"] if job["result"])]
        pin(data, "ann", answers["pinned"][0])
        shutil.rmtree(data / "store" / "chunks", ignore_errors=True)  # parts of what is there
        (Path(folder) / "answers.json").write_text(json.dumps(answers))
        with tarfile.open(archive, "w:xz") as tar:
            for name in ("answers.json", "data"):
                tar.add(Path(folder) / name, name)


if __name__ == "__main__":
    main(sys.argv[1])
