"""The architecture as docs/architecture.md states it: no import cycles, the paths of requests."""

from __future__ import annotations

import ast
import asyncio
import gc
import graphlib
import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import grimp
import pytest
from httpx2 import Response
from starlette.testclient import TestClient

from tests.service.conftest import Queue
from vibroimpact_service.app import create_app
from vibroimpact_service.documents import decode, requests
from vibroimpact_service.jobs import worker
from vibroimpact_service.jobs.queue import JobQueue
from vibroimpact_service.jobs.records import NewJob
from vibroimpact_service.jobs.retention import Retention
from vibroimpact_service.jobs.runner import Runner
from vibroimpact_service.jobs.webhooks import Webhooks
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import chunks
from vibroimpact_solvers import spectrum

ROOT = Path(__file__).parents[2]
PACKAGES = ("vibroimpact_solvers", "vibroimpact_schema", "vibroimpact_service", "vibroimpact")
FOLDERS = {
    "service": "service/vibroimpact_service",
    "schema": "openapi/vibroimpact_schema",
    "solvers": "solvers/vibroimpact_solvers",
}
"""Abbreviation of a folder in the page -> the folder."""
UNLISTED = {"service/logs.py", "service/metrics.py", "service/jobs/metrics.py"}
UNLISTED |= {"service/settings.py"}
REQUEST, STORED = "The path of a request", "The path of a stored result"
HISTORY, JOB = "The path of a time history", "The path of a job"
MOST = {REQUEST: 47, STORED: 15, HISTORY: 62, JOB: 60}
"""Heading of a path in the page -> files that it visits at most."""
LONGEST_MODULE, LONGEST_FUNCTION = 400, 80
"""Lines of a module and of a function of the service."""


def test_there_are_no_import_cycles() -> None:
    """Imports within functions and those for type checking alone count as well."""
    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    imports = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    assert len(imports) > 150
    # Raises CycleError, which names the modules of a cycle.
    graphlib.TopologicalSorter(imports).prepare()


def _listed(heading: str) -> list[list[str]]:
    """Return the files of each numbered item below a heading of the page."""
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    section = page.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    items = re.findall(r"^\d+\. (.*(?:\n {3}.*)*)", section, re.M)
    return [re.findall(r"`((?:service|schema|solvers)/[\w/]+\.py)`", item) for item in items]


def _path(file: str) -> Path:
    room, _, rest = file.partition("/")
    return ROOT / FOLDERS[room] / rest


def _is_compiled(file: str) -> bool:
    """Whether a file has kernels alone, which their decorators compile."""
    nodes = ast.parse(_path(file).read_text(encoding="utf-8")).body
    return all(node.decorator_list for node in nodes if isinstance(node, ast.FunctionDef))


def _abbreviated(code_file: str) -> str | None:
    for room, folder in FOLDERS.items():
        path = Path(code_file)
        if path.is_relative_to(ROOT / folder):
            return f"{room}/{path.relative_to(ROOT / folder).as_posix()}"
    return None


class Trace:
    """The files of the project whose functions are called while `on` is true, in order."""

    def __init__(self) -> None:
        self.on = False
        self.files: dict[str, None] = {}

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        if self.on and event == "call":
            file = _abbreviated(frame.f_code.co_filename)
            if file is not None and file not in UNLISTED:
                self.files.setdefault(file)


@contextmanager
def _traced() -> Iterator[Trace]:
    """Trace this thread and those started from now on."""
    gc.collect()  # what other tests left ends here, and is no visit
    gc.disable()
    trace, earlier = Trace(), sys.getprofile()
    threading.setprofile(trace)
    sys.setprofile(trace)
    try:
        yield trace
    finally:
        gc.enable()
        sys.setprofile(earlier)
        threading.setprofile(None)  # type: ignore[arg-type]


def _application(data: Path) -> TestClient:
    """Return a client of the application, in this process and without workers."""
    # The memory of this process is that of all tests before this one.
    settings = Settings(data=data, hosts=("testserver",), inline_memory_bytes=2**50)
    return TestClient(create_app(settings, Queue(Store(settings.store_url))))  # type: ignore[arg-type]


def _modes(n: int) -> dict[str, Any]:
    """Return a request for impact modes of a chain."""
    return {
        "system": {"preset": "chain", "n": n, "constraints": [{"dof": 2, "gap": 0.2}]},
        "frequency": {"start": 0.6, "stop": 2.4, "num": 50},
        "outputs": ["impulse", "exists"],
    }


def _history(Omega0: float) -> dict[str, Any]:
    """Return a request for a motion from impact to impact."""
    stop = {"dof": 0, "gap": 0.5, "restitution": 0.8}
    return {
        "system": {"preset": "oscillator", "Omega0": Omega0, "zeta": 0.01, "constraints": [stop]},
        "initial": {"x": [0], "v": [1.2]},
        "t_end": 6,
        "t": {"num": 5},
        "outputs": ["x", "impacts"],
    }


def _is_stored(store: Store, answer: Response) -> bool:
    name = answer.headers["Content-Location"].rpartition("/")[2]
    return store.results.has(name)


def _forget() -> None:
    """Forget structures, so that what is decoded and prepared is so in every order of tests."""
    spectrum.CACHE.clear()  # else large spectra of other tests may be dropped meanwhile
    decode.KNOWN.clear()  # nor are their structures counted


def _visits_of_request(
    data: Path, kind: str, bodies: list[dict[str, Any]], cache: str
) -> list[str]:
    """Return the files that the last of some requests visits, all of which are answered."""
    route = f"/v1/compute/{kind}"
    with _application(data / "first") as http:
        while http.post(route, json=bodies[0]).status_code != 200:
            pass  # kernels are being compiled
    store = Store(Settings(data=data / "second").store_url)
    _forget()
    with _traced() as trace, _application(data / "second") as http:
        for body in bodies[1:-1]:
            assert _is_stored(store, http.post(route, json=body))
        trace.on = True
        answer = http.post(route, json=bodies[-1])
        trace.on = False
    assert _is_stored(store, answer)
    assert answer.status_code == 200
    assert answer.headers["Cache-Status"] == f"vibroimpact; {cache}"
    return list(trace.files)


def _check(heading: str, visited: list[str], unseen: frozenset[str] = frozenset()) -> None:
    """Compare the files that were visited with those that the page lists below a heading.

    Those of the path of a request need not be listed again. `unseen` are files that a double
    stands for.
    """
    items = _listed(heading)
    listed = {file for item in items for file in item}
    before = set() if heading == REQUEST else {f for item in _listed(REQUEST) for f in item}
    assert set(visited) - listed - before == set(), "visited, but not in docs/architecture.md"
    missed = {file for file in listed - set(visited) - unseen if not _is_compiled(file)}
    assert missed == set(), "in docs/architecture.md, but not visited"
    first = [item[0] for item in items if item[0] not in unseen]
    assert first == [file for file in visited if file in first], "the order of the first visits"
    assert len(visited) <= MOST[heading]


@pytest.mark.parametrize(
    ("heading", "kind", "bodies", "cache"),
    [
        (REQUEST, "impact-modes", [_modes(11), _modes(13), _modes(17)], "fwd=miss"),
        (STORED, "impact-modes", [_modes(11), _modes(17), _modes(17)], "hit"),
        (HISTORY, "time-history", [_history(1.1), _history(1.2), _history(1.3)], "fwd=miss"),
    ],
)
def test_a_request_visits_the_files_that_the_page_lists(
    heading: str, kind: str, bodies: list[dict[str, Any]], cache: str, tmp_path: Path
) -> None:
    """Compiled kernels leave no trace (since Python 3.12); the functions that call them do."""
    _check(heading, _visits_of_request(tmp_path, kind, bodies, cache))


class Call:
    """A call of a worker, made by a thread of this process."""

    def __init__(self, key: str) -> None:
        self.key = key
        self.value: Any = None
        self.error: BaseException | None = None

    def make(self, ended: Callable[[Call], None], function: Any, args: tuple[Any, ...]) -> None:
        try:
            self.value = worker.execute(function, self.key, False, *args)
        except Exception as error:
            self.error = error
        ended(self)

    def release(self) -> None:
        """Nothing to release."""


class Workers:
    """Stands for the engine: its workers are threads of this process."""

    ready, failure, workers = True, None, 1

    def start(self) -> None:
        """Nothing to start."""

    def close(self) -> None:
        """Nothing to close."""

    def submit(
        self, key: str, queue: str, priority: int, ended: Any, function: Any, *args: Any, used: Any
    ) -> Call:
        call = Call(key)
        threading.Thread(target=call.make, args=(ended, function, args)).start()
        return call

    def error(self, call: Call) -> BaseException | None:
        return call.error

    def values(self, calls: list[Call]) -> list[Any]:
        return [call.value for call in calls]

    def cancel(self, calls: list[Call]) -> None:
        """Nothing to cancel."""


async def _idle(*_: object) -> None:
    """Stand for what looks after other jobs, beside the path of this one."""
    await asyncio.Event().wait()


def _new_job(store: Store, n: int) -> NewJob:
    """Return a job, of a planned time for which its chunks are computed one by one."""
    request = requests.read("ann", KINDS["impact-modes"], _modes(n))
    block = requests.stored_form("ann", request.canonical)
    name = f"{n:064x}"
    store.requests.put(name, block)
    return NewJob(f"job_{n}", "ann", "impact-modes", name, request.digest, 0, 1.0, reused=False)


async def _visits_of_job(settings: Settings) -> list[str]:
    store = Store(settings.store_url)
    queue = JobQueue(settings, store, chunks.work(settings))
    queue.engine = Workers()  # type: ignore[assignment]
    earlier, later = _new_job(store, 11), _new_job(store, 17)
    with _traced() as trace:
        await queue.start()
        try:
            for new in (earlier, later):
                trace.on = new is later
                job = await queue.submit(new)
                ended = await queue.wait("ann", job.id, 600.0)
                assert ended is not None
                assert ended.state == "succeeded", ended.error
            trace.on = False
        finally:
            await queue.close()
    return list(trace.files)


def test_a_job_visits_the_files_that_the_page_lists(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the queue to a worker and back, with threads in place of workers."""
    monkeypatch.setattr(Runner, "renew_loop", _idle)
    monkeypatch.setattr(Webhooks, "loop", _idle)
    monkeypatch.setattr(Retention, "loop", _idle)
    _forget()
    chunks.KNOWN.clear()
    visited = asyncio.run(_visits_of_job(Settings(data=tmp_path)))
    _check(JOB, visited, frozenset({"service/use_case/evaluation.py", "service/jobs/engine.py"}))


def test_modules_and_functions_of_the_service_are_short() -> None:
    long = []
    for file in sorted((ROOT / FOLDERS["service"]).rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        if text.count("\n") > LONGEST_MODULE:
            long.append(file.name)
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                assert node.end_lineno is not None
                if node.end_lineno - node.lineno >= LONGEST_FUNCTION:
                    long.append(f"{file.name}: {node.name}")
    assert long == []
