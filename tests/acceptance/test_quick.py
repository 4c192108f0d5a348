"""Which tests are quick, and what becomes of one that is not: on small files, by pytest itself."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests import needs

ROOT = needs.ROOT
CONFTEST = """
from tests.quick import (
    pytest_addoption, pytest_collection_modifyitems, pytest_configure, pytest_ignore_collect,
)
"""
SETTINGS = f"""
[tool.pytest.ini_options]
pythonpath = ["{ROOT}"]
markers = ["needs(what)", "quick"]
"""

Written = Callable[[str], Path]


@pytest.fixture
def written(tmp_path: Path) -> Written:
    """Return the function that writes a file of tests."""

    def write(text: str) -> Path:
        file = tmp_path / f"test_{len(list(tmp_path.iterdir()))}.py"
        file.write_text(text)
        return file

    return write


def test_what_a_test_uses_is_followed_to_the_modules_that_it_needs(written: Written) -> None:
    file = written("""
import subprocess as programs
import pytest
from tests.forked import Forked

COMMAND = ["true"]
def run(): return programs.run(COMMAND)
runner = Forked
class Started:
    def begin(self): return run()
@pytest.fixture
def started(): return Started()
@pytest.fixture
def again(started): return started

def test_nothing(): assert COMMAND
def test_a_function(): run()
def test_a_fixture_of_a_fixture(again): pass
@pytest.mark.usefixtures("again")
def test_a_named_fixture(): pass
def test_another_module(): runner("json")
def test_an_import_of_its_own():
    from numba import njit
class TestClass:
    def test_nothing(self): pass
    def test_something(self, started): pass
""")

    def found(*names: str) -> set[str]:
        return needs.of_test(file, *names)

    assert found("test_nothing") == set()
    assert found("test_a_function") == {needs.PROCESSES}
    assert found("test_a_fixture_of_a_fixture") == {needs.PROCESSES}
    assert found("test_a_named_fixture") == {needs.PROCESSES}
    assert found("test_another_module") == {needs.PROCESSES}
    assert found("test_an_import_of_its_own") == {needs.COMPILER}
    assert found("TestClass", "test_nothing") == set()
    assert found("TestClass", "test_something") == {needs.PROCESSES}
    assert needs.of_whole_file(file) == set()


def test_fixtures_of_the_folders_around_a_test_are_followed() -> None:
    service = ROOT / "tests/acceptance/test_http.py"
    assert needs.of_whole_file(service) >= {needs.PROCESSES}
    database = ROOT / "tests/service/jobs/test_replicas.py"
    assert needs.PROCESSES in needs.of_whole_file(database)


@pytest.mark.parametrize(
    ("text", "whole"),
    [
        ("import subprocess\ndef test_a(): subprocess.run('true')\n", {needs.PROCESSES}),
        ("import subprocess\ndef test_a(): subprocess.run('true')\ndef test_b(): pass\n", set()),
        ("pytestmark = pytest.mark.needs('a server')\ndef test_a(): pass\n", {needs.SERVER}),
        ("@pytest.mark.needs('compiled kernels')\ndef test_a(): pass\n", {needs.COMPILED}),
        ("import numba\n@pytest.mark.quick\ndef test_a(): numba\n", set()),
    ],
)
def test_files_without_a_quick_test_are_not_imported(
    written: Written, text: str, whole: set[str]
) -> None:
    assert needs.of_whole_file(written(text)) == whole


BAD = {
    needs.PROCESSES: "import os, subprocess\ndef test_it(): subprocess.run('true')",
    needs.SERVER: "import socket\ndef test_it(): socket.create_server(('127.0.0.1', 0))",
    needs.COMPILER: (
        "import numba\n"
        "def test_it(monkeypatch):\n"
        "    monkeypatch.setattr('numba.config.DISABLE_JIT', False)\n"
        "    numba.njit(lambda a: a + 1)(1)"
    ),
    needs.COMPILED: (
        "import itertools, tests.quick as quick\n"
        "quick.MOST_SECONDS = 0.01\n"
        "def test_it():\n"
        "    for _ in itertools.count(): pass"
    ),
}
CAUGHT = """
import pytest, multiprocessing, subprocess
@pytest.mark.quick
def test_it():
    try: multiprocessing.get_context("spawn").Process(target=print).start()
    except BaseException: pass
"""
SETTING_UP = """
import pytest, subprocess
@pytest.fixture
def program(): return subprocess.run("true")
@pytest.mark.quick
def test_it(program): pass
"""


def run(folder: Path, *options: str, **environment: str) -> subprocess.CompletedProcess[str]:
    (folder / "conftest.py").write_text(CONFTEST)
    (folder / "pyproject.toml").write_text(SETTINGS)
    inherited = {name: each for name, each in os.environ.items() if "NUMBA" not in name}
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-q", *options, str(folder)],
        cwd=folder, env=inherited | environment, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("need", [*BAD, "caught", "setting up"])
def test_a_quick_test_that_needs_more_fails_with_a_sentence(
    written: Written, tmp_path: Path, need: str
) -> None:
    marked = "import pytest\n" + BAD.get(need, "").replace("def ", "@pytest.mark.quick\ndef ")
    written({"caught": CAUGHT, "setting up": SETTING_UP}.get(need, marked))
    ended = run(tmp_path, "--quick")
    named = need if need in BAD else needs.PROCESSES
    sentence = f"give it @pytest.mark.needs({named!r})."
    assert f"A quick test {needs.KNOWN[named]} (" in ended.stdout
    assert sentence in ended.stdout
    assert "1 passed" not in ended.stdout
    assert ended.returncode == 1


SOME = """
import os, pytest, subprocess
def test_plain(): assert os.environ["NUMBA_DISABLE_JIT"] == "1"
def test_process(): subprocess.run("true")
@pytest.mark.needs("compiled kernels")
def test_long(): pass
@pytest.mark.needs("the compiler")
def test_compiler(): pass
"""


def test_what_needs_more_is_left_out(written: Written, tmp_path: Path) -> None:
    written(SOME)
    assert "1 passed, 3 deselected" in run(tmp_path, "--quick").stdout
    assert "3 passed, 1 deselected" in run(tmp_path, "--plain").stdout
    assert "4 passed" in run(tmp_path, NUMBA_DISABLE_JIT="1").stdout
    assert "1 failed, 3 passed" in run(tmp_path).stdout


def test_options_that_come_too_late_or_mean_nothing_are_refused(
    written: Written, tmp_path: Path
) -> None:
    written("import pytest\n@pytest.mark.needs('luck')\ndef test_it(): pass\n")
    ended = run(tmp_path, "--quick")
    assert ended.returncode == 4
    assert "a test can need 'the compiler'" in ended.stderr
    late = run(tmp_path, PYTEST_ADDOPTS="--quick")
    assert late.returncode == 4
    assert "on the command line" in late.stderr
