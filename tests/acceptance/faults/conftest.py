"""Seeds, records and the end of all processes of the fault tests."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from processes import Process, Record

Some = TypeVar("Some", bound=Process)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.faults)


@pytest.fixture
def moments() -> random.Random:
    """Return the source of random moments; VIBROIMPACT_SEED repeats a run."""
    seed = int(os.environ.get("VIBROIMPACT_SEED", "0")) or random.randrange(1, 10**9)
    print(f"VIBROIMPACT_SEED={seed}")
    return random.Random(seed)


@pytest.fixture
def record(tmp_path: Path) -> Record:
    return Record(tmp_path / "record")


@pytest.fixture
def started() -> Iterator[Callable[[Some], Some]]:
    """Return a function that takes note of a process, which is ended after the test."""
    all_of_them: list[Any] = []

    def note(process: Some) -> Some:
        all_of_them.append(process)
        return process

    yield note
    for process in reversed(all_of_them):
        process.end()


_IMPORT_SECONDS = 1.5


@pytest.fixture
def slowness() -> float:
    """Return how much slower than an idle machine this one is at the moment, 1 or more.

    The limits are those of an idle machine with two cores. Others may be at work on this one.
    """
    started_at = time.monotonic()
    subprocess.run([sys.executable, "-c", "import vibroimpact_service.app"], check=True)
    factor = max(1.0, (time.monotonic() - started_at) / _IMPORT_SECONDS)
    print(f"slower than an idle machine by {factor:.1f}")
    return factor
