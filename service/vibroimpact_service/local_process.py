"""The process that computes for a caller without a server, with the memory of a worker.

It reads requests from its standard input and answers on its standard output, both as pickled
tuples: ``(kind, content, seconds)``, and for each any number of ``("progress", done, total)``
before ``("result", entries)``, of its file, ``("refused", document)`` or ``("failed", text)``. It
ends with its caller.
"""

from __future__ import annotations

import math
import os
import pickle
import queue
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any, BinaryIO, Final

from vibroimpact_schema.entries import Entry
from vibroimpact_service import kinds, problems
from vibroimpact_service.documents import decode, planning, requests
from vibroimpact_service.jobs import process_limits
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results import hdf5
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import computation
from vibroimpact_solvers.kernels import inventory
from vibroimpact_solvers.meter import LimitPassedError, StopSignal

Request = tuple[str, dict[str, Any], float]
"""A kind, a request document, and the processor time that it may take, seconds."""

CALLER: Final = "local"
_PROGRESS_SECONDS: Final = 0.05


class _Signal(StopSignal):
    """Stops a computation after its processor time, and tells its progress."""

    def __init__(self, answers: BinaryIO) -> None:
        super().__init__(enforce=partial(process_limits.limit_call, CALLER))
        self._answers, self._told = answers, False
        self._next = time.monotonic() + _PROGRESS_SECONDS

    def __call__(self, done: int, total: int) -> None:
        """Raise `LimitPassedError` where the computation is to stop."""
        super().__call__(done, total)
        now = time.monotonic()
        if now >= self._next or (self._told and done >= total):
            self._next, self._told = now + _PROGRESS_SECONDS, True
            write(self._answers, ("progress", done, total))


def write(stream: BinaryIO, message: tuple[Any, ...]) -> None:
    """Write a message at once."""
    pickle.dump(message, stream, pickle.HIGHEST_PROTOCOL)
    stream.flush()


@cache
def no_systems() -> Store:
    """Return an empty store, in a folder that is not there: servers alone store systems."""
    return Store(str(Path(tempfile.gettempdir()) / f"vibroimpact-none-{os.getpid()}"))


def _compute(
    kind: str, content: Mapping[str, Any], seconds: float, answers: BinaryIO
) -> list[Entry]:
    """Return all that the HDF5 file of the result of a request has."""
    request = requests.read(CALLER, kinds.named(kind, "kind"), dict(content))
    with inventory.announced():
        planned = planning.plan(no_systems(), request.kind, request.document)
        signal = _Signal(answers)
        if seconds < math.inf:
            signal.allow(seconds)
        try:
            result = computation.compute(planned, request.digest, request.canonical, signal)
        except LimitPassedError:
            detail = (
                f"It took more than the {seconds:.3g} s of processor time that it was given; "
                f"{planned.seconds:.3g} s were planned, and {signal.fraction:.0%} was done."
            )
            raise ProblemError(problems.LIMIT_PASSED, detail) from None
        return list(hdf5.entries(result))


def _answer(
    kind: str, content: Mapping[str, Any], seconds: float, answers: BinaryIO
) -> tuple[Any, ...]:
    try:
        return "result", _compute(kind, content, seconds, answers)
    except MemoryError:
        detail = "It needs more memory than a worker has."
        fault = ProblemError(problems.LIMIT_PASSED, detail)
    except Exception as error:
        fault = problems.of(error)
        if fault.type is problems.INTERNAL:
            return "failed", traceback.format_exc()
    return "refused", fault.document(CALLER).model_dump(mode="json")


def _read(given: BinaryIO, waiting: queue.SimpleQueue[Request]) -> None:
    """Hand over what is read, and end the process, whatever it computes, with its caller."""
    while True:
        try:
            waiting.put(pickle.load(given))
        except EOFError:
            os._exit(0)


def main() -> None:
    """Answer requests until the caller ends."""
    given, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what anything prints is no answer
    settings = Settings()
    limit = process_limits.worker_memory(settings.worker_memory_bytes, 1)
    process_limits.limit_memory(limit)
    decode.KNOWN.resize(settings.structures_bytes)
    waiting = queue.SimpleQueue[Request]()
    threading.Thread(target=_read, args=(given, waiting), daemon=True).start()
    while True:
        write(answers, _answer(*waiting.get(), answers))


if __name__ == "__main__":
    main()
