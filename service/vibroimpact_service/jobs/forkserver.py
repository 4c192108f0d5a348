"""The process from which worker processes are forked; it has imported everything they need.

A worker that replaces a killed one then starts in a few tenths of a second, and shares the memory
of the imported modules with the others.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing import forkserver
from typing import Final

_PRELOADED: Final = (
    "vibroimpact_service.jobs.without_interrupts",
    "distributed",
    "distributed.nanny",
)
"""Modules that every worker needs, whatever it computes."""

ENVIRONMENT: Final[Mapping[str, str]] = {
    # Each worker has one core: threads of linear algebra would only slow one another down.
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MALLOC_TRIM_THRESHOLD_": "65536",
}
"""Variables of processes that compute."""


def start(modules: Sequence[str]) -> None:
    """Begin to start the process, unless it runs already, with these modules imported too."""
    multiprocessing.set_start_method("forkserver", force=True)
    multiprocessing.set_forkserver_preload([*_PRELOADED, *modules])
    with _environment():
        forkserver.ensure_running()


@contextmanager
def _environment() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    os.environ.update(ENVIRONMENT)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
