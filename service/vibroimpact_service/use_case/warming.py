"""Compiling kernels before a request needs them, in processes of their own.

Processes of low priority, one a core, solve problems of one kind of computation after another, so
that every kernel they need is compiled and kept on disk (`kernels.cache`); a file beside the
kernels says which of them a kind needs, so that it is warm as long as these are there. While it
compiles what a kind needs, or one of two steps of it, a process holds a lock: several services that
start at the same time share the work.
"""

from __future__ import annotations

import fcntl
import functools
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from multiprocessing.process import BaseProcess
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final, Literal

import structlog

from vibroimpact_schema import examples
from vibroimpact_service import logs, use_case
from vibroimpact_service.documents import planning, requests
from vibroimpact_service.jobs import forkserver
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.store import Store
from vibroimpact_service.use_case.warming_problems import LIBRARY_ONLY, PROBLEMS
from vibroimpact_solvers.kernels import cache, files, inventory, threads

State = Literal["warming", "warm", "failed"]

log = structlog.get_logger("vibroimpact.warming")

_NICENESS: Final = 10
_PROGRESS_SECONDS: Final = 0.2
_ATTEMPTS: Final = 2
"""A process that was killed, for its memory perhaps, gets another chance."""
_SOFT: Final = "soft-time-history"
STEPS: Final[Mapping[str, str]] = {kind: kind for kind in KINDS} | {_SOFT: "time-history"}
"""What one process compiles at a time -> the kind that needs it.

Motions with rigid and with soft limiters have no long kernel in common: one after the other, they
would keep one core busy when all others have finished.
"""
_SHARED: Final = (
    ("time-history", "ensemble", "attractors", "calibration"),
    ("impact-modes", "existence-bands", "resonances", "natural-frequencies", "sweep"),
    ("periodic-motions", "branches"),
    (_SOFT,),
)
"""Steps that need the same kernels, to be compiled one after the other; the longest first."""
_VERSION: Final = version("vibroimpact")


def problems(step: str) -> list[Mapping[str, Any]]:
    """Return the requests of a step; those of all steps of a kind need all of its kernels."""
    kind = STEPS[step]
    shown = [example["request"] for example in examples.requests(kind).values()]
    asked = [*shown, *PROBLEMS.get(kind, ())]
    if kind != STEPS[_SOFT]:
        return asked
    return [each for each in asked if ("limiter" in each) == (step == _SOFT)]


def solve_problems(step: str) -> None:
    """Solve the problems of a step."""
    with tempfile.TemporaryDirectory() as folder:
        store = Store(folder)
        for content in problems(step):
            request = requests.read("warming", KINDS[STEPS[step]], content)
            planned = planning.plan(store, request.kind, request.document)
            planned.kind.solver.solve(planned.problem, planned.plan)


class FolderNotWritableError(OSError):
    """Kernels cannot be kept anywhere."""


class Warming:
    """Compiles the kernels of all kinds that are not warm yet, in background processes.

    Before `start` all kinds count as warm: kernels that are not are then compiled where they are
    needed first.

    Parameters
    ----------
    solve : callable
        Solves the problems of a step, in a process of its own.

    Attributes
    ----------
    states : dict
        Name of a kind -> "warming", "warm" or "failed".
    notice : str
        What those who wait are told while kernels are compiled; empty where none is.
    """

    def __init__(self, solve: Callable[[str], None] = solve_problems) -> None:
        self._solve = solve
        self.states: dict[str, State] = dict.fromkeys(KINDS, "warm")
        self.notice = ""
        self._threads: list[threading.Thread] = []
        self._processes: set[BaseProcess] = set()
        self._lock, self._closed = threading.Lock(), False

    def start(self) -> Path:
        """Begin.

        Returns
        -------
        Path
            The folder in which kernels are kept.

        Raises
        ------
        FolderNotWritableError
            Where there is none; all kinds have failed then.
        """
        place = cache.folder()
        if place is None:
            self.states = dict.fromkeys(KINDS, "failed")
            raise FolderNotWritableError("no folder for compiled kernels can be written to")
        cold = {step for step in STEPS if not is_done(place, step)}
        if not cold:
            return place
        self.states |= dict.fromkeys((STEPS[step] for step in cold), "warming")
        forkserver.start(use_case.NUMERICAL)
        if left := missing():
            self.notice = inventory.notice(inventory.estimate(left, threads.cores()))
        tracks: SimpleQueue[Sequence[str]] = SimpleQueue()
        alone = [(step,) for step in STEPS if not any(step in track for track in _SHARED)]
        for track in (*_SHARED, *alone):
            tracks.put([step for step in track if step in cold])
        for _ in range(threads.cores()):
            thread = threading.Thread(
                target=self._run, args=(place, tracks), name="warming", daemon=True
            )
            thread.start()
            self._threads.append(thread)
        return place

    @property
    def summary(self) -> str:
        """The state of all kinds: warm, warming, or which failed."""
        failed = [kind for kind, state in self.states.items() if state == "failed"]
        if failed:
            return f"failed: {', '.join(failed)}"
        return "warming" if "warming" in self.states.values() else "warm"

    def progress(self) -> Iterator[int]:
        """Yield how many kinds are warm or have failed, now and then, until all are."""
        while (left := list(self.states.values()).count("warming")) > 0:
            yield len(self.states) - left
            time.sleep(_PROGRESS_SECONDS)
        yield len(self.states)

    @contextmanager
    def in_background(self) -> Iterator[None]:
        """Start, and stop in the end; where no kernels can be kept, the log says so."""
        try:
            self.start()
        except FolderNotWritableError as error:
            log.warning("kernels are compiled anew in each process", reason=str(error))
        if self.notice:
            log.info(self.notice)
        try:
            yield
        finally:
            self.close()

    def close(self) -> None:
        """Stop: what is compiled stays on disk."""
        with self._lock:
            self._closed = True
            for process in self._processes:
                process.terminate()
        for thread in self._threads:
            thread.join()

    def _run(self, place: Path, tracks: SimpleQueue[Sequence[str]]) -> None:
        with suppress(Empty):
            while not self._closed:
                for step in tracks.get_nowait():
                    self._compile(place, step)

    def _compile(self, place: Path, step: str) -> None:
        """Compile what a step needs, and take note of the outcome."""
        kind = STEPS[step]
        for _ in range(_ATTEMPTS):
            self._process(place, step)
            if self._closed:
                return
            # Not by its exit code, which another thread that starts a process may have taken.
            if is_done(place, step):
                if is_warm(place, kind):
                    self.states[kind] = "warm"
                return
        log.error("kernels cannot be compiled", kind=kind)
        self.states[kind] = "failed"

    def _process(self, place: Path, step: str) -> None:
        """Compile what a step needs in a process of its own."""
        context = multiprocessing.get_context("forkserver")
        process = context.Process(target=compile_step, args=(place, step, self._solve), daemon=True)
        with self._lock:
            if self._closed:
                return
            try:
                process.start()
            except (OSError, EOFError) as error:  # no memory, no descriptor, no forkserver
                log.warning(
                    "no process to compile kernels in", kind=STEPS[step], reason=repr(error)
                )
                return
            self._processes.add(process)
        process.join()
        with self._lock:
            self._processes.discard(process)


def missing() -> list[str]:
    """Return the names of the kernels that warming would compile."""
    return [name for name in inventory.missing() if name not in LIBRARY_ONLY]


def is_warm(place: Path, kind: str) -> bool:
    """Whether the kernels of a kind are in a folder, compiled from the sources of this process."""
    return all(is_done(place, step) for step, of in STEPS.items() if of == kind)


def is_done(place: Path, step: str) -> bool:
    """Whether the kernels that a step needs are in a folder."""
    present = set(cache.folders().values())
    return any(
        release == _VERSION and all(each in present and (place / each).is_dir() for each in modules)
        for release, *modules in _marks(place, step)
    )


@functools.cache
def _place() -> Path | None:
    return cache.folder()


def is_compiled(kind: str) -> bool:
    """Whether the kernels of a kind are known to be there for this process.

    Once they are, no folder is looked at again: that takes as long as a small plan.
    """
    place = _place()
    if place is None:
        return False
    if (place, kind) not in _compiled and is_warm(place, kind):
        _compiled.add((place, kind))
    return (place, kind) in _compiled


_compiled: Final[set[tuple[Path, str]]] = set()


def compile_step(place: Path, step: str, solve: Callable[[str], None]) -> None:
    """Compile the kernels that a step needs in this process, unless another one does or has.

    Parameters
    ----------
    place : Path
        Folder of the kernels.
    step : str
    solve : callable
        Solves the problems of a step.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process ends this one
    logs.to_stderr()
    os.nice(_NICENESS)
    with _locked(lock_file(place, step)):
        if not is_done(place, step):
            solve(step)
            note_done(place, step, loaded())


def loaded() -> list[str]:
    """Return the folders of the kernels that this process has compiled or read."""
    modules = {name: sys.modules[name] for name in cache.folders() if name in sys.modules}
    kernels = [each for module in modules.values() for each in vars(module).values()]
    kept = (each.stats.cache_path for each in kernels if getattr(each, "signatures", ()))
    return sorted({Path(each).name for each in kept if each is not None})


def note_done(place: Path, step: str, modules: Iterable[str] = ()) -> None:
    """Write down that the kernels that a step needs are compiled.

    Parameters
    ----------
    place : Path
        Folder of the kernels.
    step : str
    modules : iterable of str
        Folders in it of these kernels.
    """
    others = [
        mark for mark in _marks(place, step) if all((place / each).is_dir() for each in mark[1:])
    ]
    marks = {" ".join(mark): None for mark in (*others, (_VERSION, *modules))}
    file = mark_file(place, step)
    passing = file.with_name(f".{file.name}-{os.getpid()}")
    passing.write_text("".join(f"{mark}\n" for mark in marks))
    passing.replace(file)


def mark_file(place: Path, step: str) -> Path:
    """Return the file that says what a step needs: a line for each state of the sources.

    Several installations may share the folder. A line holds the version and the folders of all
    modules with kernels that the step needs; one that is not complete counts for nothing.
    """
    return place / f"{step}{files.WARM}"


def lock_file(place: Path, step: str) -> Path:
    """Return the file on which a process holds a lock while it compiles a step."""
    return place / f"{step}.lock"


def _marks(place: Path, step: str) -> list[list[str]]:
    try:
        lines = mark_file(place, step).read_text().splitlines(keepends=True)
    except (OSError, ValueError):
        return []
    return [line.split() for line in lines if line.endswith("\n") and line.strip()]


@contextmanager
def _locked(file: Path) -> Iterator[None]:
    """Hold a lock on a file, where its file system knows locks."""
    with file.open("a") as opened:
        with suppress(OSError):
            fcntl.flock(opened, fcntl.LOCK_EX)
        yield
