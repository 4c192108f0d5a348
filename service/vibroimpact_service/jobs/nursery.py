"""Where worker processes come from: a process that has loaded everything and forks them."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing import forkserver
from typing import Final

METHOD: Final = "forkserver"
BORN_WITH: Final = ("distributed", "distributed.nanny")
"""What every worker needs, whatever it computes."""

_ENVIRONMENT: Final[Mapping[str, str]] = {
    # Each worker has one core: threads of linear algebra would only disturb one another.
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MALLOC_TRIM_THRESHOLD_": "65536",
}


def open_nursery(modules: Sequence[str]) -> None:
    """Begin to start the process that forks workers, unless it runs already.

    It imports the modules once, beside `BORN_WITH`. A worker that takes the place of a killed
    one is then there in a few tenths of a second, and shares their memory with the others.
    """
    multiprocessing.get_context(METHOD).set_forkserver_preload([*BORN_WITH, *modules])
    with _environment():
        forkserver.ensure_running()


@contextmanager
def _environment() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in _ENVIRONMENT}
    os.environ.update(_ENVIRONMENT)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
