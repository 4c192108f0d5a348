"""Computations without a server, jobs or a store, in a process of the caller's own.

The client imports this module by its name where it is installed; what it returns and raises are
arrays and documents, as over HTTP.
"""

from __future__ import annotations

import atexit
import math
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, BinaryIO, Final, cast

from vibroimpact_schema.entries import Entry
from vibroimpact_service import kinds, local_process, problems
from vibroimpact_service.documents import planning, requests
from vibroimpact_service.jobs import forkserver
from vibroimpact_service.problems import ProblemError
from vibroimpact_solvers.kernels import inventory

Process = subprocess.Popen[bytes]

_CALLER: Final = local_process.CALLER
_COMMAND: Final = [sys.executable, "-m", local_process.__name__]
_idle: Final[list[Process]] = []
"""Processes that wait for a request. Those of a program belong to it, not to its forks."""
os.register_at_fork(after_in_child=_idle.clear)


class RefusedError(Exception):
    """A request that is wrong or cannot be computed; `document` is its problem document."""

    def __init__(self, document: dict[str, Any]) -> None:
        super().__init__(document["detail"])
        self.document = document


class FailedError(RuntimeError):
    """A computation failed for no fault of the request; the text is its traceback."""


def compute(
    kind: str,
    content: Mapping[str, Any],
    tick: Callable[[int, int], None] | None = None,
    seconds: float = math.inf,
) -> list[Entry]:
    """Return the result of a request: all that its HDF5 file has.

    A small result would take longer to be written to a file and read from it than to be computed.

    A process beside this one computes it, with the memory of a worker, and is kept for the next
    request. Whatever ends the wait for it, such as Ctrl-C or an error of `tick`, ends the process.
    Where kernels have to be compiled, a line on standard error says so.

    Parameters
    ----------
    kind : str
        Kind of computation, such as ``"impact-modes"``.
    content : mapping
        The request document.
    tick : callable, optional
        Called with the work done and all work.
    seconds : float
        Processor time that it may take.

    Raises
    ------
    RefusedError
    """
    try:
        process = _idle.pop()
    except IndexError:
        process = _started()
    try:
        answer = _answered(process, (kind, dict(content), seconds), tick)
    except BaseException:
        _end(process)
        raise
    _idle.append(process)
    match answer:
        case "result", entries:
            return list(entries)
        case "refused", document:
            raise RefusedError(document)
        case _:
            raise FailedError(answer[1])


def _started() -> Process:
    """Return a new process that computes."""
    return subprocess.Popen(
        _COMMAND,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, **forkserver.ENVIRONMENT},
        start_new_session=True,  # Ctrl-C comes to the caller alone, who ends it
    )


def _answered(
    process: Process, request: local_process.Request, tick: Callable[[int, int], None] | None
) -> tuple[str, Any]:
    """Return the answer to a request.

    Raises
    ------
    RefusedError
        Where the process ended.
    """
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        local_process.write(cast(BinaryIO, process.stdin), request)
        while (answer := pickle.load(process.stdout))[0] == "progress":
            if tick is not None:
                tick(*answer[1:])
    except (EOFError, BrokenPipeError, pickle.UnpicklingError):
        fault = _death(process.wait())
        raise RefusedError(fault.document(_CALLER).model_dump(mode="json")) from None
    return cast("tuple[str, Any]", answer)


def _death(code: int) -> ProblemError:
    """Return the problem of a computation whose process ended with an exit code."""
    if code == -signal.SIGXCPU:
        detail = "It took more processor time than it was given, and its process was ended."
        return ProblemError(problems.LIMIT_PASSED, detail)
    why = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    detail = f"The process that computed it ended: {why}. It may need more memory than there is."
    return ProblemError(problems.WORKER_LOST, detail)


def _end(process: Process) -> None:
    """End a process, whatever it computes."""
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()


@atexit.register
def _end_all() -> None:
    """End the processes that wait."""
    while _idle:
        _end(_idle.pop())


def plan(kind: str, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the plan document of a request.

    Raises
    ------
    RefusedError
    """
    try:
        request = requests.read(_CALLER, kinds.named(kind, "kind"), dict(content))
        with inventory.announced():
            planned = planning.plan(local_process.no_systems(), request.kind, request.document)
    except Exception as error:
        fault = problems.of(error)
        if fault.type is problems.INTERNAL:
            raise
        raise RefusedError(fault.document(_CALLER).model_dump(mode="json")) from error
    answer = {"kind": kind, "digest": request.digest, "seconds": planned.seconds}
    return answer | {"cached": False, "inline": True} | planning.steps(planned.plan)
