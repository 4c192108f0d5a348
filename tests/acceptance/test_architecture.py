"""The architecture as docs/architecture.md states it: no import cycles, the path of a request."""

from __future__ import annotations

import ast
import gc
import graphlib
import re
import sys
import threading
from collections.abc import Iterator
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
from vibroimpact_service.documents import decode
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_solvers import spectrum

ROOT = Path(__file__).parents[2]
PACKAGES = ("vibroimpact_solvers", "vibroimpact_schema", "vibroimpact_service", "vibroimpact")
FOLDERS = {
    "service": "service/vibroimpact_service",
    "schema": "openapi/vibroimpact_schema",
    "solvers": "solvers/vibroimpact_solvers",
}
"""Abbreviation of a folder in the page -> the folder."""
UNLISTED = {"service/logs.py", "service/metrics.py", "service/settings.py"}
STEPS = 14
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


def _body(n: int) -> dict[str, Any]:
    return {
        "system": {"preset": "chain", "n": n, "constraints": [{"dof": 2, "gap": 0.2}]},
        "frequency": {"start": 0.6, "stop": 2.4, "num": 50},
        "outputs": ["impulse", "exists"],
    }


def _is_stored(store: Store, answer: Response) -> bool:
    name = answer.headers["Content-Location"].rpartition("/")[2]
    return store.results.has(name)


def test_a_request_visits_the_files_that_the_page_lists(tmp_path: Path) -> None:
    """Compiled kernels leave no trace (since Python 3.12); the functions that call them do."""
    route = "/v1/compute/impact-modes"
    with _application(tmp_path / "first") as http:
        while http.post(route, json=_body(11)).status_code != 200:
            pass  # kernels are being compiled
    store = Store(Settings(data=tmp_path / "second").store_url)
    spectrum.CACHE.clear()  # else large spectra of other tests may be dropped meanwhile
    decode.KNOWN.clear()  # nor are their structures counted
    with _traced() as trace, _application(tmp_path / "second") as http:
        assert _is_stored(store, http.post(route, json=_body(13)))
        trace.on = True
        answer = http.post(route, json=_body(17))
        trace.on = False
    assert _is_stored(store, answer)
    assert answer.status_code == 200
    assert answer.headers["Cache-Status"] == "vibroimpact; fwd=miss"
    visited = list(trace.files)
    items = _listed("The path of a request")
    listed = {file for item in items for file in item}
    assert set(visited) - listed == set(), "visited, but not in docs/architecture.md"
    missed = {file for file in listed - set(visited) if not _is_compiled(file)}
    assert missed == set(), "in docs/architecture.md, but not visited"
    steps = [item[0] for item in items]
    assert steps == [file for file in visited if file in steps], "the order of the first visits"
    assert len(steps) <= STEPS


@pytest.mark.parametrize(
    ("of", "most_steps", "most_files"), [("a time history", 8, 8), ("a job", 10, 15)]
)
def test_the_files_of_a_path_are_there(of: str, most_steps: int, most_files: int) -> None:
    items = _listed(f"The path of {of}")
    files = [file for item in items for file in item]
    assert 0 < len(items) <= most_steps
    assert len(set(files)) <= most_files
    assert [file for file in files if not _path(file).is_file()] == []


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
