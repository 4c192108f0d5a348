"""Fixtures of the fault tests: random moments, records of the work, clean-up of processes."""

from __future__ import annotations

import os
import random
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from processes import Process, Record
from shared import Machine

Some = TypeVar("Some", bound=Process)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Repeat faults at random moments as often as VIBROIMPACT_SEEDS says, each with its seed."""
    count = int(os.environ.get("VIBROIMPACT_SEEDS", "1"))
    if "moments" in metafunc.fixturenames and count > 1:
        metafunc.parametrize("moments", range(count), indirect=True)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    here = [item for item in items if Path(__file__).parent in item.path.parents]
    for item in here:
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
def machine() -> Iterator[Machine]:
    """Return the clock by which limits are measured."""
    clock = Machine()
    yield clock
    clock.close()


@pytest.fixture
def started(machine: Machine) -> Iterator[Callable[[Some], Some]]:
    """Return a function that registers a process to be ended after the test."""
    processes: list[Any] = []

    def register(process: Some) -> Some:
        processes.append(process)
        machine.owns(process.process.pid)
        return process

    yield register
    for process in reversed(processes):
        process.end()
