"""Runs random cases of a set in processes of their own: nothing that hangs or dies stops it."""

from __future__ import annotations

import json
import multiprocessing
import os
import resource
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from tests.truth.sets import SETS
from tests.truth.verdicts import Case, Report

_MEMORY = 6 * 2**30
_REFERENCE_LIMIT = 60.0  # seconds of the processor after which a reference is given up
_START_LIMIT = 120.0
_TICK = os.sysconf("SC_CLK_TCK")


@dataclass
class Outcome:
    """What a set gave, case after case."""

    name: str
    cases: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    ratios: dict[str, list[float]] = field(default_factory=dict)
    failures: list[dict[str, Any]] = field(default_factory=list)

    def add(self, index: int, about: dict[str, Any]) -> None:
        """Add the report of a case."""
        self.cases += 1
        self.counts.update(about["counts"])
        for what, ratios in about["ratios"].items():
            self.ratios.setdefault(what, []).extend(ratios)
        for kind, message in about["failures"]:
            entry = {"index": index, "case": about["name"], "kind": kind, "message": message}
            self.failures.append(entry)

    @property
    def failed(self) -> Counter[str]:
        """Numbers of failures by kind."""
        return Counter(entry["kind"] for entry in self.failures)


def _work(name: str, seed: int, indices: list[int], pipe: Connection) -> None:
    """Run cases one after the other and send what they give."""
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    for index in indices:
        report = Report(tell=lambda *phase: pipe.send(("phase", *phase)))
        pipe.send(("begin", index))
        case = SETS[name].case(seed, index)
        checked(name, case, report)
        pipe.send(("end", index, report.plain(case.name)))


def checked(name: str, case: Case, report: Report) -> None:
    """Check a case; what it raises is a failure."""
    try:
        SETS[name].check(case, report)
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(last.filename).name}:{last.lineno}"
        report.fail(type(error).__name__, f"{where}: {str(error)[:300]}")


class _Worker:
    def __init__(self, name: str, seed: int, indices: list[int]) -> None:
        self.name, self.seed, self.left = name, seed, indices
        self.start()

    def start(self) -> None:
        self.pipe, far = multiprocessing.Pipe()
        self.process = multiprocessing.Process(
            target=_work, args=(self.name, self.seed, self.left, far), daemon=True
        )
        self.process.start()
        far.close()
        self._begin("start", _START_LIMIT)

    def _begin(self, phase: str, limit: float) -> None:
        self.phase, self.until = phase, self._processor_time() + limit

    def _processor_time(self) -> float:
        """Return the seconds that the process has computed for: others may keep it waiting."""
        try:
            fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:  # it has ended
            return 0.0
        return (int(fields[11]) + int(fields[12])) / _TICK

    def messages(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield the reports of cases that ended, or were ended."""
        try:
            while self.pipe.poll():
                message = self.pipe.recv()
                if message[0] == "phase":
                    self._begin(message[1], message[2] or _REFERENCE_LIMIT)
                elif message[0] == "begin":
                    self._begin("start", _START_LIMIT)
                elif message[0] == "end":
                    self.left = self.left[1:]
                    yield message[1], message[2]
        except EOFError:
            if self.left:
                yield self._ended("the process died")
            return
        if self.left and self._processor_time() > self.until:
            self.process.kill()
            yield self._ended("hangs")

    def _ended(self, what: str) -> tuple[int, dict[str, Any]]:
        self.process.join()
        self.pipe.close()
        index, self.left = self.left[0], self.left[1:]
        report = Report()
        if self.phase == "reference":
            report.count(f"reference: {what}")
        else:
            report.fail(what, f"during {self.phase}")
        if self.left:
            self.start()
        return index, report.plain("?")


def run(
    name: str, seed: int, indices: list[int], jobs: int = 1, chunk: int = 250
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the reports of cases, in the order in which they end."""
    chunks = [indices[i : i + chunk] for i in range(0, len(indices), chunk)]
    workers: list[_Worker] = []
    while chunks or workers:
        while chunks and len(workers) < jobs:
            workers.append(_Worker(name, seed, chunks.pop(0)))
        wait([worker.pipe for worker in workers], timeout=0.5)
        for worker in workers:
            yield from worker.messages()
        workers = [worker for worker in workers if worker.left]


def follow(name: str, seed: int, count: int, jobs: int, folder: Path | None) -> Outcome:
    """Run a set, or the rest of it if the folder knows a part; show progress."""
    outcome, done = Outcome(name), set[int]()
    store = None
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{name}-{seed}.jsonl"
        if path.exists():
            for line in path.read_text().splitlines():
                index, about = json.loads(line)
                if index < count:
                    done.add(index)
                    outcome.add(index, about)
        store = path.open("a")
    began = time.monotonic()
    for index, about in run(name, seed, [i for i in range(count) if i not in done], jobs):
        outcome.add(index, about)
        if store is not None:
            store.write(json.dumps([index, about]) + "\n")
            store.flush()
        if outcome.cases % 500 == 0:
            taken = time.monotonic() - began
            print(f"{name}: {outcome.cases} of {count} in {taken:.0f} s", flush=True)
    if store is not None:
        store.close()
    return outcome
