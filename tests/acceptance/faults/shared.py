"""A clock that stands still while other programs use the processors."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

_EVERY = 0.2


class Machine:
    """A clock of the time in which the processors were idle or used by the tests.

    It agrees with the wall clock while no other program computes, and stands still while others
    use all processors. Limits therefore mean the same on a shared machine as on a quiet one, and
    beside other tests as alone.
    """

    def __init__(self) -> None:
        self._sessions: set[int] = set()
        self._used: dict[int, int] = {}
        self._ours = 0
        self._moments: list[tuple[float, float]] = []
        self._left = 0.0
        self._before = self._used_ticks(), _all()
        self._moments.append((time.time(), 0.0))
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def owns(self, process: int) -> None:
        """Count the session of a process, and with it all its descendants, as part of the tests."""
        self._sessions.add(process)

    def seconds(self, start: float, stop: float) -> float:
        """Return the time of this clock between two times of the wall clock."""
        while self._moments[-1][0] < stop:
            time.sleep(_EVERY)
        return self._at(stop) - self._at(start)

    def close(self) -> None:
        """Stop."""
        self._closing.set()
        self._thread.join()

    def _at(self, moment: float) -> float:
        before = self._moments[0]
        for after in self._moments[1:]:
            if after[0] >= moment:
                part = (moment - before[0]) / (after[0] - before[0])
                return before[1] + max(0.0, part) * (after[1] - before[1])
            before = after
        return before[1]

    def _run(self) -> None:
        while not self._closing.wait(_EVERY):
            ours, (busy, total) = self._used_ticks(), _all()
            ours_before, (busy_before, total_before) = self._before
            if total == total_before:
                continue
            others = max(0, busy - busy_before - (ours - ours_before))
            share = 1.0 - min(1.0, others / (total - total_before))
            now = time.time()
            self._left += share * (now - self._moments[-1][0])
            self._moments.append((now, self._left))
            self._before = ours, (busy, total)

    def _used_ticks(self) -> int:
        """Return the processor ticks of the processes of the tests, including ended ones.

        These are this process and its descendants, and the sessions that it owns.
        """
        told: dict[int, list[str]] = {}
        for stat in Path("/proc").glob("[0-9]*/stat"):
            with suppress(OSError):
                told[int(stat.parent.name)] = stat.read_text().rpartition(")")[2].split()
        for process, fields in told.items():
            if int(fields[3]) in self._sessions or _descends(process, told):
                used = int(fields[11]) + int(fields[12])
                self._ours += max(0, used - self._used.get(process, 0))
                self._used[process] = used
        return self._ours


def _descends(process: int, told: Mapping[int, Sequence[str]]) -> bool:
    """Whether a process is this one or a descendant of it."""
    while process in told:
        if process == os.getpid():
            return True
        process = int(told[process][1])
    return False


def _all() -> tuple[int, int]:
    """Return the busy ticks and all ticks of the processors so far."""
    line = Path("/proc/stat").read_text().splitlines()[0]
    user, nice, system, idle, iowait, irq, softirq, steal = map(int, line.split()[1:9])
    busy = user + nice + system + irq + softirq + steal
    return busy, busy + idle + iowait
