"""Clients who note what they were told, and what is checked of it in the end."""

from __future__ import annotations

import random
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import httpx2
import numpy as np
import psycopg
from processes import until
from users import history, impulses, sweep

from vibroimpact_schema.requests import TimeHistoryRequest
from vibroimpact_service.documents import decode
from vibroimpact_solvers import time_history

CLIENTS = 20
RETRIED = (404, 429, 502, 503, 504, 507)
PAUSE = 4.0
"""Longest pause of a client between two requests."""
CHECKED = 2000
"""Jobs at most whose results are checked again at the end; all are counted."""


class Job(NamedTuple):
    """A job that was acknowledged."""

    id: str
    kind: str
    content: dict[str, Any]
    cancelled: bool = False


class Client:
    """Submits jobs, each until it is acknowledged, and checks those that ended.

    `addresses` returns where it may ask; further arguments are those of its `httpx2.Client`.
    """

    def __init__(
        self, number: int, addresses: Callable[[], Sequence[str]], seed: int, **http: Any
    ) -> None:
        self.number, self.addresses = number, addresses
        self.random = random.Random(seed * 100 + number)
        self.acknowledged: dict[str, Job] = {}
        self.http = httpx2.Client(timeout=10, **http)
        self.did: Counter[str] = Counter()
        self.longest = 0.0
        self.checked = 0
        self.failure: BaseException | None = None
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)

    def ask(self, method: str, path: str, seconds: float = 120.0, **arguments: Any) -> Any:
        """Repeat a request at any address until it is answered."""
        began, last = time.monotonic(), "nothing was asked"
        while time.monotonic() < began + seconds:
            url = self.random.choice(self.addresses())
            try:
                answer = self.http.request(method, f"{url}/{path}", **arguments)
            except httpx2.TransportError as error:
                last = repr(error)
            else:
                if answer.status_code not in RETRIED:
                    assert answer.is_success, answer.text
                    self.longest = max(self.longest, time.monotonic() - began)
                    return answer
                last = answer.text
            time.sleep(0.2)
        raise AssertionError(f"{method} {path}: not answered: {last}")

    def _run(self) -> None:
        try:
            while not self.stop.is_set():
                do = self.random.choices(
                    (self._submit, self._compute, self._plan, self._cancel, self._hold, self._look),
                    (10, 3, 1, 1, 1, 6),
                )[0]
                do()
                self.did[do.__name__.strip("_")] += 1
                time.sleep(self.random.uniform(0.0, PAUSE))
        except BaseException as error:
            self.failure = error

    def _content(self) -> tuple[str, dict[str, Any]]:
        """Return a request: some are equal to those of others, some long, most small."""
        if self.random.random() < 0.05:
            return "time-history", history(200.0 * self.random.randrange(1, 5))
        num = self.random.choice([5, 20, 20, 20, 4000])
        steps = self.random.choice([40, 10**6])
        return "impact-modes", sweep(0.6 + 0.4 * self.random.randrange(steps) / steps, num)

    def _submit(self) -> str:
        kind, content = self._content()
        key = f"{self.number}-{len(self.acknowledged)}"
        body = {"kind": kind, "request": content}
        job = self.ask("POST", "v1/jobs", json=body, headers={"Idempotency-Key": key}).json()
        self.acknowledged[key] = Job(job["id"], kind, content)
        return key

    def _compute(self) -> None:
        content = sweep(0.6 + self.random.random() / 10, 20)
        key = f"compute-{self.number}-{self.did['compute']}"
        headers = {"Idempotency-Key": key}
        answer = self.ask("POST", "v1/compute/impact-modes", json=content, headers=headers)
        if answer.status_code == 202:  # it became a job, which is acknowledged like any other
            self.acknowledged[key] = Job(answer.json()["id"], "impact-modes", content)
        else:
            self._check_numbers("impact-modes", content, answer.json())

    def _plan(self) -> None:
        kind, content = self._content()
        assert self.ask("POST", f"v1/plan/{kind}", json=content).json()["steps"]

    def _cancel(self) -> None:
        key = self._submit()
        job = self.acknowledged[key]
        self.acknowledged[key] = job._replace(cancelled=True)
        self.ask("DELETE", f"v1/jobs/{job.id}")

    def _hold(self) -> None:
        job = self.acknowledged[self._submit()]
        self.ask("POST", f"v1/jobs/{job.id}/hold")
        time.sleep(self.random.uniform(0.0, 1.0))
        self.ask("POST", f"v1/jobs/{job.id}/release")

    def _look(self) -> None:
        if self.acknowledged:
            job = self.random.choice(list(self.acknowledged.values()))
            document = self.ask("GET", f"v1/jobs/{job.id}?wait=5").json()
            if document["final"]:
                self.check_result(document, job)

    def check_result(self, document: dict[str, Any], job: Job) -> None:
        """Check a job that has ended, and its numbers."""
        if job.cancelled and document["state"] == "cancelled":
            return
        assert document["state"] == "succeeded", document
        answer = self.ask("GET", document["result"].lstrip("/")).json()
        self._check_numbers(job.kind, job.content, answer)

    def _check_numbers(self, kind: str, content: dict[str, Any], answer: dict[str, Any]) -> None:
        if kind == "impact-modes":
            np.testing.assert_array_equal(np.array(answer["impulse"]), impulses(content))
        else:
            np.testing.assert_array_equal(np.array(answer["x"]), displacements(content["t_end"]))
        self.checked += 1


@cache
def displacements(t_end: float) -> np.ndarray[Any, Any]:
    """Return the displacements of a history that the solver computes in this process."""
    request = TimeHistoryRequest.model_validate(history(t_end))
    problem = decode.time_history(request, decode.system(request.system))
    x = time_history.solve(problem, time_history.plan(problem)).x
    assert x is not None
    return x


def size(process: int) -> tuple[float, int]:
    """Return the memory of a process in MB, and how many files it has open."""
    status = Path(f"/proc/{process}/status").read_text()
    kilobytes = int(status.partition("VmRSS:")[2].split()[0])
    return kilobytes / 1024, len(list(Path(f"/proc/{process}/fd").iterdir()))


def tell(
    seconds: float, clients: list[Client], counts: Counter[str], of_process: tuple[float, int]
) -> None:
    """Print what happened so far."""
    did = sum((client.did for client in clients), Counter[str]())
    print(
        f"{seconds:.0f} s: faults {sum(counts.values())} {dict(counts)}; requests {dict(did)}; "
        f"jobs acknowledged {sum(len(client.acknowledged) for client in clients)}; "
        f"results checked {sum(client.checked for client in clients)}; "
        f"longest answer {max(client.longest for client in clients):.1f} s; "
        f"{of_process[0]:.0f} MB, {of_process[1]} files",
        flush=True,
    )


def check_jobs(client: Client, acknowledged: dict[str, Job], own: set[str]) -> None:
    """Check that every acknowledged job is there once, and ended well, and that no other is.

    Apart from the service's `own`, into which nobody asked to put what they asked for.
    """
    end = time.monotonic() + 600.0
    while True:
        jobs = listed(client)
        unfinished = [job["id"] for job in jobs if not job["final"]]
        if not unfinished:
            break
        assert time.monotonic() < end, f"these do not end: {unfinished[:10]}"
        time.sleep(1.0)
    states = {job["id"]: job["state"] for job in jobs}
    assert len(states) == len(jobs)
    assert acknowledged.keys() <= states.keys()
    for name, job in acknowledged.items():
        allowed = {"succeeded", "cancelled"} if job.cancelled else {"succeeded"}
        assert states[name] in allowed, (name, job, states[name])
    assert states.keys() - acknowledged.keys() <= own
    print("jobs there:", len(states), "acknowledged:", len(acknowledged))


def check_results(clients: list[Client], source: random.Random) -> None:
    """Check the numbers of jobs, and that their keys stand for them still."""
    listed_jobs = [(key, job) for client in clients for key, job in client.acknowledged.items()]
    chosen = source.sample(listed_jobs, min(CHECKED, len(listed_jobs)))

    def check(client: Client, some: list[tuple[str, Job]]) -> None:
        for key, job in some:
            document = until(lambda j=job: final(client, j.id), f"{job.id} does not end", 300)
            client.check_result(document, job)
            body = {"kind": job.kind, "request": job.content}
            again = client.ask("POST", "v1/jobs", json=body, headers={"Idempotency-Key": key})
            assert again.json()["id"] == job.id

    with ThreadPoolExecutor(CLIENTS) as pool:
        parts = [pool.submit(check, client, chosen[i::CLIENTS]) for i, client in enumerate(clients)]
    for part in parts:
        part.result()
    print("results checked at the end:", len(chosen))


def final(client: Client, job: str) -> dict[str, Any] | None:
    """Return a job that has ended, or None."""
    document: dict[str, Any] = client.ask("GET", f"v1/jobs/{job}?wait=5").json()
    return document if document["final"] else None


def listed(client: Client) -> list[dict[str, Any]]:
    """Return all jobs that the service knows."""
    jobs: list[dict[str, Any]] = []
    cursor = ""
    while True:
        page = client.ask("GET", f"v1/jobs?limit=500{cursor}").json()
        jobs += page["jobs"]
        if page["next"] is None:
            return jobs
        cursor = f"&cursor={page['next']}"


def own(database: str) -> set[str]:
    """Return the jobs that the service made by itself.

    They compute lost results again, or what was to be answered at once and was not.
    """
    query = "SELECT job FROM idempotency WHERE key LIKE 'lost-%' OR key LIKE 'compute-%'"
    with psycopg.connect(database) as connection:
        return {job for (job,) in connection.execute(query).fetchall()}


def check_sizes(sizes: list[tuple[float, int]]) -> None:
    """Check that memory and open files of a process that lived throughout do not grow."""
    third = max(1, len(sizes) // 3)
    first, last = sizes[third : 2 * third] or sizes, sizes[-third:]
    for what, unit, room in ((0, "MB", 60.0), (1, "files", 40.0)):
        before, after = (median(each[what] for each in some) for some in (first, last))
        print(f"{before:.0f} to {after:.0f} {unit}")
        assert after <= 1.2 * before + room
