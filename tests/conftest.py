"""A PostgreSQL of the tests' own, for whatever must hold on it as well as on SQLite."""

from __future__ import annotations

import gc
import os
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.quick import (  # noqa: F401
    pytest_addoption,
    pytest_collection_modifyitems,
    pytest_configure,
    pytest_ignore_collect,
)

# Each process of the suite has a core to itself, and so have the services that it starts: threads
# of linear algebra would only wait for one another. Read once, when numpy is loaded.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

GIVEN = "VIBROIMPACT_TEST_POSTGRESQL"
NOTICES = "VIBROIMPACT_TEST_NOTICES"
"""Environment variable with the file in which processes say that they compile kernels."""


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Return two processes for each core: many tests wait for a service, a timer or a disk.

    Quick ones wait for nothing.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2
    return cores if config.option.quick else 2 * cores


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile all kernels once, before each process of the whole suite would for itself."""
    config = session.config
    whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS
    plain = config.option.quick or config.option.plain
    if not hasattr(config, "workerinput") and not config.option.collectonly and not plain:
        _pass_on_notices(config)
        if whole:
            command = [sys.executable, "-m", "vibroimpact_service.cli", "warm"]
            with Path(os.environ[NOTICES]).open("a") as notices:
                subprocess.run(command, check=True, stderr=notices)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Load the tests without looking for garbage, and never look at what stays loaded.

    Each look goes through the libraries and the sources of the tests as trees, all of which stay.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_finish(session: pytest.Session) -> None:
    """Let a process in which kernels are compiled say so; what it writes itself is captured."""
    # Where kernels run as plain Python, numba is not there.
    compiling = {"numba", "vibroimpact_solvers.kernels.jit"} <= sys.modules.keys()
    if compiling and NOTICES in os.environ:
        from numba.core import event

        from vibroimpact_solvers.kernels.inventory import Announcing

        def say(line: str) -> None:
            with Path(os.environ[NOTICES]).open("a") as notices:
                notices.write(f"{line}\n")

        event.register("numba:compile", Announcing(say))


def _pass_on_notices(config: pytest.Config) -> None:
    """Show once what the processes of the tests append to a file while they compile kernels."""
    number, name = tempfile.mkstemp(prefix="vibroimpact-notices-")
    os.close(number)
    os.environ[NOTICES] = name
    ended = threading.Event()

    def show() -> None:
        shown: set[str] = set()
        writer = config.get_terminal_writer()
        with Path(name).open() as notices:
            last = False
            while not last:
                last = ended.wait(0.2)
                for line in notices:
                    if line not in shown:
                        writer.line(line.rstrip())
                        shown.add(line)

    thread = threading.Thread(target=show, name="notices", daemon=True)
    thread.start()

    def end() -> None:
        ended.set()
        thread.join()
        Path(name).unlink()

    config.add_cleanup(end)


@pytest.fixture(scope="session", autouse=True)
def _each_kernel_has_one_signature() -> Iterator[None]:
    """Fail where a kernel was called with arrays of another type or layout than those before.

    It would be compiled once more, for seconds, in the midst of a request: `vibroimpact warm`
    does not know of it.
    """
    yield
    several = {
        f"{module}.{name}": function.signatures
        for module, content in tuple(sys.modules.items())
        if module.startswith("vibroimpact_solvers.kernels.")
        for name, function in vars(content).items()
        if getattr(function, "__module__", None) == module
        and len(getattr(function, "signatures", ())) > 1
        and "no_cpython_wrapper" not in function.targetoptions  # called by Python
    }
    assert not several


@pytest.fixture(autouse=True)
def _closed_figures() -> Iterator[None]:
    """Close the pictures of a test, of which matplotlib keeps hold."""
    yield
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is not None:
        pyplot.close("all")


@pytest.fixture(autouse=True)
def _processor_time() -> Iterator[None]:
    """Take away the limit that a worker's code has set where a test called it in this process.

    The system would end the process in the midst of a later test.
    """
    before = resource.getrlimit(resource.RLIMIT_CPU)
    yield
    resource.setrlimit(resource.RLIMIT_CPU, before)


class PostgreSQL:
    """A server on a free port of this machine, which can be killed and started again.

    `host` is its address, and `within` is written before its command: it may be in a network
    namespace, where all who reach it are trusted.
    """

    def __init__(self, programs: Path, host: str = "127.0.0.1", within: Sequence[str] = ()) -> None:
        self._programs, self._host, self._within = programs, host, within
        self.folder = Path(tempfile.mkdtemp(prefix="vibroimpact-postgresql-"))
        # The server refuses to run as root.
        self._as: dict[str, Any] = {}
        if os.geteuid() == 0:
            self._as = {"user": "nobody", "group": "nogroup", "extra_groups": []}
            shutil.chown(self.folder, "nobody", "nogroup")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port: int = free.getsockname()[1]
        self._run(
            "initdb", "-D", self._data, "-U", "test", "-A", "trust", "-E", "UTF8",
            "--locale=C", "--no-sync",
        )  # fmt: skip
        if within:
            with Path(self._data, "pg_hba.conf").open("a") as rules:
                rules.write("host all all samenet trust\n")
        self.process: subprocess.Popen[bytes] | None = None
        self.start()

    @property
    def _data(self) -> str:
        return str(self.folder / "data")

    def _run(self, program: str, *arguments: str) -> None:
        command = [str(self._programs / program), *arguments]
        ended = subprocess.run(
            command, cwd=self.folder, capture_output=True, text=True, check=False, **self._as
        )
        assert ended.returncode == 0, ended.stderr

    def start(self) -> None:
        """Start it and wait until it takes connections."""
        command = [
            str(self._programs / "postgres"), "-D", self._data, "-h", self._host,
            "-p", str(self.port), "-k", str(self.folder), "-c", "max_connections=200",
        ]  # fmt: skip
        user = self._as
        if self._within:  # only root may enter it
            as_nobody = ["setpriv", "--reuid=nobody", "--regid=nogroup", "--clear-groups"]
            command, user = [*self._within, *as_nobody, *command], {}
        with (self.folder / "log").open("ab") as log:
            self.process = subprocess.Popen(
                command, cwd=self.folder, stdout=log, stderr=log, **user
            )
        end = time.monotonic() + 60
        while not self._answers():
            log_text = (self.folder / "log").read_text()
            assert self.process.poll() is None, log_text
            assert time.monotonic() < end, log_text
            time.sleep(0.05)

    def _answers(self) -> bool:
        import psycopg

        try:
            self._ask("SELECT 1", "postgres")
        except psycopg.OperationalError:
            return False
        return True

    def kill(self) -> None:
        """Kill it without warning."""
        assert self.process is not None
        self.process.kill()
        self.process.wait(60)

    def stop(self) -> None:
        """Stop it and remove its data."""
        if self.process is not None and self.process.poll() is None:
            # At once: a checkpoint of what is removed next may take longer than its disk allows.
            self.process.send_signal(signal.SIGQUIT)
            self.process.wait(60)
        shutil.rmtree(self.folder)

    def _ask(self, statement: str, database: str) -> None:
        import psycopg

        url = f"postgresql://test@{self._host}:{self.port}/{database}"
        with psycopg.connect(url, autocommit=True, connect_timeout=5) as connection:
            connection.execute(statement)

    def new(self) -> str:
        """Make a database and return its URL."""
        name = f"vibroimpact_{uuid.uuid4().hex}"
        self._ask(f"CREATE DATABASE {name}", "postgres")
        return f"postgresql://test@{self._host}:{self.port}/{name}"


def programs() -> Path:
    """Return the folder of PostgreSQL's programs.

    Where there are none the tests cannot be run; a failure if the environment variable
    VIBROIMPACT_TEST_POSTGRESQL_REQUIRED says so, as the project's own check does.
    """
    places = [*Path("/usr/lib/postgresql").glob("*/bin"), *Path("/usr/pgsql").glob("*/bin")]
    on_path = shutil.which("initdb")
    if on_path is not None:
        places.append(Path(on_path).resolve().parent)
    for place in sorted(places, reverse=True):
        if (place / "initdb").exists() and (place / "postgres").exists():
            return place
    missing = f"PostgreSQL is not installed, and {GIVEN} names none"
    if os.environ.get(f"{GIVEN}_REQUIRED"):
        pytest.fail(missing)
    pytest.skip(missing)


@pytest.fixture(scope="session")
def postgresql() -> Iterator[Callable[[], str]]:
    """Return the function that makes an empty database and returns its URL.

    The environment variable VIBROIMPACT_TEST_POSTGRESQL can name a server whose user may create
    databases, as ``postgresql://user@host:port/database``.
    """
    given = os.environ.get(GIVEN)
    if given is not None:
        yield lambda: _in_given(given)
        return
    server = PostgreSQL(programs())
    yield server.new
    server.stop()


@pytest.fixture
def killable_postgresql() -> Iterator[PostgreSQL]:
    """Return a server that no other test uses."""
    server = PostgreSQL(programs())
    yield server
    server.stop()


def _in_given(url: str) -> str:
    import psycopg

    name = f"vibroimpact_{uuid.uuid4().hex}"
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}")
    return url.rsplit("/", 1)[0] + f"/{name}"
