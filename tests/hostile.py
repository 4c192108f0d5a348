"""Requests of all kinds with numbers that are meant to hurt, and how long they look at no signal.

``python -m tests.hostile 2000`` tries so many; a case that looks at nothing for ten seconds of
its thread's processor time ends the process, which names it.
"""

from __future__ import annotations

import copy
import itertools
import json
import os
import random
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from typing import Any, Final

from vibroimpact_schema import examples
from vibroimpact_service.documents import planning
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_solvers.errors import Cancelled, SolverError

SETTINGS: Final = Settings()
SECONDS: Final = 0.25
"""Processor time after which a case is cancelled."""
_HUNG: Final = 10.0
_POWERS: Final = (-12, -9, -6, -3, 3, 6, 9, 12)
_NEAR_ONE: Final = (1.0 - 1e-9, 1.0 - 1e-4, 1e-9, 1.0)
_FIELDS: Final = ("zeta", "restitution", "exponent")  # that are no scales

Path = tuple[str | int, ...]


def _numbers(document: Any, path: Path = ()) -> Iterator[tuple[Path, float]]:
    """Yield the places of all numbers."""
    if isinstance(document, dict | list):
        parts = document.items() if isinstance(document, dict) else enumerate(document)
        for name, value in parts:
            yield from _numbers(value, (*path, name))
    elif isinstance(document, int | float) and not isinstance(document, bool):
        yield path, document


def _placed(document: Any, path: Path, value: float) -> None:
    for name in path[:-1]:
        document = document[name]
    document[path[-1]] = value


def cases(count: int, seed: int = 1) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield kinds and requests: examples of which one to three numbers are extreme."""
    rng = random.Random(seed)
    given = [
        (kind, example["request"]) for kind in KINDS for example in examples.requests(kind).values()
    ]
    for kind, request in itertools.islice(itertools.cycle(given), count):
        document = copy.deepcopy(request)
        if "system" in document and document["system"].get("preset") == "oscillator":
            document["system"] = {"Omega0": 1.0, "zeta": 0.01, **document["system"]}
        numbers = list(_numbers(document))
        for path, value in rng.sample(numbers, min(len(numbers), rng.randint(1, 3))):
            if isinstance(value, int) and path[-1] in {"dof", "constraint", "n", "side"}:
                continue
            extreme = (value or 1.0) * 10.0 ** rng.choice(_POWERS)
            if path[-1] in _FIELDS and rng.random() < 0.5:
                extreme = rng.choice(_NEAR_ONE)
            if path[-1] in {"settle", "observe", "points", "count", "periods", "switch", "size"}:
                extreme = int(value * rng.choice((3, 30)))
            _placed(document, path, extreme)
        yield kind, document


class Meter:
    """A tick that measures the longest processor time of its thread between two calls."""

    def __init__(self, seconds: float = SECONDS) -> None:
        self.thread, self.longest, self.looks = threading.get_ident(), 0.0, 0
        self.last = time.thread_time()
        self._end = self.last + seconds

    def __call__(self, done: int = 0, total: int = 1) -> None:
        """Note the pause; end what takes too long."""
        if threading.get_ident() != self.thread:
            return
        now = time.thread_time()
        self.longest = max(self.longest, now - self.last)
        self.looks += 1
        self.last = time.thread_time()
        if now > self._end:
            raise Cancelled


def _watch(current: dict[str, Any]) -> None:
    """Name where a case looks at no signal for long."""
    while True:
        time.sleep(0.02)
        meter = current.get("meter")
        if meter is None:
            continue
        now = time.clock_gettime(time.pthread_getcpuclockid(meter.thread)) - meter.last
        if now > 0.06:
            frame = sys._current_frames().get(meter.thread)
            current["stack"] = traceback.extract_stack(frame)[-9:]
        if now > _HUNG:
            _tell(now, "HUNG", current)
            os._exit(3)


def _tell(pause: float, what: str, current: dict[str, Any]) -> None:
    stack = " > ".join(f"{f.filename.split('/')[-1]}:{f.lineno}" for f in current["stack"])
    print(current["index"], f"{pause:.3f}", what, current["kind"], stack, flush=True)
    print("   ", json.dumps(current["document"])[:1500], flush=True)


def longest_pause(
    kind: str, document: dict[str, Any], current: dict[str, Any] | None = None
) -> Meter:
    """Plan and compute a request for a while, as a thread does; current is what `_watch` sees."""
    meter, of = Meter(), KINDS[kind]
    if current is not None:
        current["meter"] = meter
    try:
        request = of.request.model_validate(document)
        planned = planning.plan(None, of, request, SETTINGS, meter)  # type: ignore[arg-type]
        of.solver.solve(planned.problem, planned.plan, meter)
        meter()
    except (SolverError, ProblemError, ValueError):
        pass
    return meter


def warm() -> None:
    """Compile and import what the examples need."""
    for kind in KINDS:
        for example in examples.requests(kind).values():
            longest_pause(kind, example["request"])


def _main(count: int, first: int = 0, seed: int = 1) -> None:
    warm()
    current: dict[str, Any] = {}
    threading.Thread(target=_watch, args=(current,), daemon=True).start()
    for index, (kind, document) in enumerate(cases(count, seed)):
        if index < first:
            continue
        current |= {"index": index, "kind": kind, "document": document, "stack": []}
        meter = longest_pause(kind, document, current)
        current["meter"] = None
        if meter.longest > 0.05:
            _tell(meter.longest, "pause", current)
    print("tried", count)


if __name__ == "__main__":
    _main(*map(int, sys.argv[1:]))
