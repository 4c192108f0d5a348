"""An earlier version and this one side by side, under load: `nox -s upgrade`.

VIBROIMPACT_EARLIER names the command `vibroimpact` of the earlier version, in an environment of
its own. All replicas have one database and one store.
"""

from __future__ import annotations

import json
import os
import random
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import pytest
from processes import Process, program, until
from users import impulses, sweep

CLIENTS = 8
SECONDS = 10.0
"""How long each stage of the upgrade lasts."""
WAIT = 120.0


class Replica(Process):
    """A service of some version, ready for work."""

    def __init__(self, command: list[str], folder: Path, **settings: str) -> None:
        environment = {f"VIBROIMPACT_{name.upper()}": value for name, value in settings.items()}
        note = folder / "service.json"
        # Nothing of this checkout may be imported by the other version.
        if command[0] == os.environ["VIBROIMPACT_EARLIER"]:
            environment["PYTHONPATH"] = ""
        arguments = [*command, "serve", "--port", "0", "--data", str(folder)]
        super().__init__(arguments, folder, VIBROIMPACT_WORKERS="1", **environment)
        until(lambda: note.exists() or self.process.poll() is not None, "no HTTP")
        assert self.process.poll() is None, self.errors.read_text()
        self.url: str = json.loads(note.read_text())["url"]
        until(lambda: httpx2.get(f"{self.url}/v1/health/ready").is_success, "not ready", WAIT)


class Client:
    """Asks replicas in turn; notes what they acknowledge and what they answer wrongly."""

    def __init__(self, number: int, replicas: list[Replica]) -> None:
        self.number, self.replicas = number, replicas
        self.random = random.Random(number)
        self.acknowledged: dict[str, dict[str, Any]] = {}
        self.did: Counter[str] = Counter()
        self.wrong: list[str] = []
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        with httpx2.Client(timeout=WAIT) as http:
            while not self.stop.is_set():
                self._ask(http)
                time.sleep(self.random.uniform(0.0, 0.5))

    def _ask(self, http: httpx2.Client) -> None:
        content = sweep(0.6 + 0.4 * self.random.random(), self.random.choice([20, 2000, 20_000]))
        url = self.random.choice(list(self.replicas)).url
        if self.random.random() < 0.3:
            answer = http.post(f"{url}/v1/compute/impact-modes", json=content)
            self.did["computed"] += 1
        else:
            body = {"kind": "impact-modes", "request": content}
            key = f"{self.number}-{self.did['submitted']}"
            answer = http.post(f"{url}/v1/jobs", json=body, headers={"Idempotency-Key": key})
            self.did["submitted"] += 1
            if answer.is_success:
                self.acknowledged[answer.json()["id"]] = content
        if not answer.is_success:
            self.wrong.append(f"{answer.status_code}: {answer.text}")


@contextmanager
def loading(replicas: list[Replica]) -> Iterator[list[Client]]:
    """Let clients ask; at the end no answer may have been wrong."""
    clients = [Client(number, replicas) for number in range(CLIENTS)]
    for client in clients:
        client.thread.start()
    try:
        yield clients
    finally:
        for client in clients:
            client.stop.set()
        for client in clients:
            client.thread.join(WAIT)
            assert not client.thread.is_alive()
    assert [wrong for client in clients for wrong in client.wrong] == []


@pytest.mark.timeout(900)
def test_replicas_are_replaced_one_after_another(tmp_path: Path, postgresql: Any) -> None:
    shared = {"database": postgresql(), "store": str(tmp_path / "store")}
    earlier, present = [os.environ["VIBROIMPACT_EARLIER"]], program()
    processes: list[Replica] = []

    def started(command: list[str], name: str) -> Replica:
        processes.append(Replica(command, tmp_path / name, **shared))
        return processes[-1]

    def stopped(replica: Replica) -> None:
        """Stop a replica as a proxy does that has been told to: it is asked for nothing new."""
        replicas.remove(replica)
        time.sleep(1.0)
        replica.end()
        assert replica.process.returncode == 0

    try:
        replicas = [started(earlier, "a"), started(earlier, "b")]
        for replica in replicas:  # the earlier version compiles what it was not asked for yet
            url = f"{replica.url}/v1/compute/impact-modes"
            assert httpx2.post(url, json=sweep(1.0, 20), timeout=WAIT).is_success
        with loading(replicas) as clients:
            time.sleep(SECONDS)
            for name, old in zip("cd", list(replicas), strict=True):
                replicas.append(started(present, name))
                time.sleep(SECONDS)
                stopped(old)
                time.sleep(SECONDS)
        did = sum((client.did for client in clients), Counter[str]())
        jobs = {name: each for client in clients for name, each in client.acknowledged.items()}
        print(f"{did['computed']} computed, {len(jobs)} jobs acknowledged")
        assert len(jobs) == did["submitted"] > 100
        check(replicas[0].url, jobs)
    finally:
        for process in reversed(processes):
            process.end()


def check(url: str, jobs: dict[str, dict[str, Any]]) -> None:
    """Check that every job ended well, and the numbers of some."""
    compared = set(random.Random(1).sample(sorted(jobs), 50))
    with httpx2.Client(base_url=url, timeout=WAIT) as http:
        for name, content in jobs.items():
            document = until(lambda j=name: ended(http, j), f"{name} does not end", WAIT)
            assert document["state"] == "succeeded", document
            if name in compared:
                answer = http.get(document["result"]).json()
                np.testing.assert_allclose(answer["impulse"], impulses(content), rtol=1e-9)


def ended(http: httpx2.Client, job: str) -> dict[str, Any] | None:
    """Return the document of a job that has ended, else None."""
    document: dict[str, Any] = http.get(f"/v1/jobs/{job}?wait=5").json()
    return document if document.get("final") else None
