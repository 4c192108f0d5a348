"""``pytest --quick``: the tests that need nothing but Python, kernels being plain Python.

A test is quick unless its source says that it needs more (`tests.needs`) or it is marked, as
``@pytest.mark.needs("compiled kernels")``. A quick test that starts a process, opens a port,
compiles or takes long fails with a sentence that says which mark it lacks. ``pytest --plain``
runs whatever is asked for with kernels as plain Python, as debuggers want it.
"""

from __future__ import annotations

import multiprocessing.process
import os
import platform
import signal
import sys
from collections.abc import Callable, Iterator
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import Any, Final

import pytest

from tests import needs

VARIABLE: Final = "NUMBA_DISABLE_JIT"
MOST_SECONDS: Final = 5.0
"""Processor time of a quick test; those that take more than a second are marked."""
_EVENTS: Final = {
    "os.exec": needs.PROCESSES,
    "os.fork": needs.PROCESSES,
    "os.forkpty": needs.PROCESSES,
    "os.posix_spawn": needs.PROCESSES,
    "os.system": needs.PROCESSES,
    "socket.bind": needs.SERVER,
    "socket.connect": needs.SERVER,
    "subprocess.Popen": needs.PROCESSES,
}
"""What Python says of itself (`sys.addaudithook`) -> what a test needs that does it."""


class NotQuickError(BaseException):
    """A quick test does what it must not; no code that it calls takes this for an error of its own.

    Parameters
    ----------
    need : str
        What the test needs.
    done : str
        What it did.
    """

    def __init__(self, need: str, done: str) -> None:
        super().__init__(
            f"A quick test {needs.KNOWN[need]} ({done}): give it @pytest.mark.needs({need!r})."
        )


class Guard:
    """Stops a quick test that needs more than Python."""

    def __init__(self) -> None:
        self.running = False
        self.broken: NotQuickError | None = None
        self._listens = False
        platform.processor()  # asks another program, and remembers the answer
        sys.addaudithook(self._hear)
        start = multiprocessing.process.BaseProcess.start

        def starting(process: Any) -> None:
            self._refuse(needs.PROCESSES, "multiprocessing")
            start(process)

        multiprocessing.process.BaseProcess.start = starting  # type: ignore[method-assign]
        signal.signal(signal.SIGPROF, self._end)

    def _hear(self, event: str, given: tuple[Any, ...]) -> None:
        if not self.running or event not in _EVENTS:
            return
        if event.startswith("socket.") and not isinstance(given[1], tuple):
            return  # within this machine, by a name in the file system
        self._refuse(_EVENTS[event], event)

    def _refuse(self, need: str, done: str) -> None:
        if self.running:
            self.broken = self.broken or NotQuickError(need, done)
            raise self.broken

    def _listen(self) -> None:
        """Hear of what numba compiles, once it is there."""
        if self._listens or "numba" not in sys.modules:
            return
        from numba.core import event

        guard, self._listens = self, True

        class Compiling(event.Listener):  # type: ignore[misc]
            def on_start(self, event: Any) -> None:
                guard._refuse(needs.COMPILER, "numba")

            def on_end(self, event: Any) -> None:
                pass

        event.register("numba:compile", Compiling())

    def _end(self, *_: object) -> None:
        """End a test that takes long; called within it, once its processor time is up."""
        if self.running:
            self.broken = NotQuickError(needs.COMPILED, f"{MOST_SECONDS:g} s of processor time")
            raise self.broken

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        """Run a test; fail also where it has caught what was to stop it."""
        self._listen()
        self.running, self.broken = True, None
        signal.setitimer(signal.ITIMER_PROF, MOST_SECONDS)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            self.running = False
            if self.broken is not None:
                pytest.fail(str(self.broken), pytrace=False)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, request: pytest.FixtureRequest) -> Iterator[None]:
        """Set up a fixture; it must do no more than a quick test."""
        before, self.running = self.running, True
        try:
            return (yield)
        finally:
            self.running = before


def pytest_addoption(parser: pytest.Parser, pluginmanager: pytest.PytestPluginManager) -> None:
    """Add the options; kernels are plain Python before any test imports them."""
    group = parser.getgroup("vibroimpact")
    group.addoption("--quick", action="store_true", help="only tests that need nothing but Python")
    group.addoption("--plain", action="store_true", help="kernels as plain Python, for debuggers")
    config = pluginmanager.get_plugin("pytestconfig")
    assert isinstance(config, pytest.Config)
    if {"--quick", "--plain"} & set(config.invocation_params.args):
        os.environ[VARIABLE] = "1"  # other processes of pytest-xdist inherit it


def pytest_configure(config: pytest.Config) -> None:
    """Watch over quick tests."""
    if _plain(config) and os.environ.get(VARIABLE) in (None, "", "0"):
        raise pytest.UsageError(f"--quick and --plain on the command line, or {VARIABLE}=1 before")
    if config.option.quick and (hasattr(config, "workerinput") or not config.option.numprocesses):
        config.pluginmanager.register(Guard(), "guard of quick tests")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files of which no test is quick: they need not even be imported."""
    if config.option.quick and collection_path.match("test_*.py"):
        return True if needs.of_whole_file(collection_path) else None
    return None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is not quick, or what plain Python cannot do."""
    if not _plain(config):
        return
    hindered: Callable[[AbstractSet[str]], bool] = bool
    if not config.option.quick:
        hindered = {needs.COMPILER}.__le__
    left_out = [item for item in items if hindered(_needs(item))]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in set(left_out)]


def _plain(config: pytest.Config) -> bool:
    return bool(config.option.quick or config.option.plain)


def _needs(item: pytest.Item) -> AbstractSet[str]:
    """Return what a test needs, as it is marked or, if it is not marked quick, by its source."""
    marked = {need for mark in item.iter_markers("needs") for need in mark.args}
    if not marked <= needs.KNOWN.keys():
        known = ", ".join(map(repr, needs.KNOWN))
        raise pytest.UsageError(f"{item.nodeid}: a test can need {known}, not {marked}")
    if marked or item.get_closest_marker("quick") or not isinstance(item, pytest.Function):
        return marked
    if "postgresql" in item.name.partition("[")[2]:  # a parameter, next to SQLite
        return {needs.DATABASE}
    classes = [item.cls.__name__] if item.cls else []
    return needs.of_test(item.path, *classes, item.originalname)
