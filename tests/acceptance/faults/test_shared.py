"""The clock by which the limits of these tests are measured."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import shared


@pytest.mark.parametrize(
    ("used", "ours", "there"),
    [
        (0, 0, 1.0),
        (100, 100, 1.0),  # the test has the processors to itself
        (50, 0, 1.0),  # another program has one of two, the other one idles
        (100, 50, 0.5),  # it has one of two that the test could have used
        (100, 0, 0.0),
        (75, 0, 0.5),
        (30, 31, 1.0),  # ticks of processes are read a moment later than those of the machine
    ],
)
def test_the_share_of_the_processors(used: int, ours: int, there: float) -> None:
    assert shared.share(100, used, ours) == there


@pytest.fixture
def stat(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Return the function that writes what the system tells of the processors."""
    file = tmp_path / "stat"
    monkeypatch.setattr(shared, "STAT", file)

    def write(*, user: int = 0, nice: int = 0, system: int = 0, idle: int = 0) -> None:
        file.write_text(f"cpu {user} {nice} {system} {idle} 0 0 0 0 0 0\ncpu0 1\n")

    return write


def test_programs_of_low_priority_take_nothing_away(stat: Callable[..., None]) -> None:
    stat(user=7, nice=80, system=3, idle=10)
    busy, passed = shared.ticks()
    assert (busy, passed) == (10, 100)
    assert shared.share(passed, busy, 0) == 1.0
