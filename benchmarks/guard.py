"""Hot kernels against plain loops of the same kind of work, in one run: a guard for CI.

The ratio of a kernel's time to that of its reference hardly depends on the machine, as both
are loops of the same compiler over the same numbers. One that grows by half means that the
kernel does more work or that its loop is no longer a vector loop.

    python -m benchmarks.guard            # fails where a kernel is slower than usual
    python -m benchmarks.guard --usual    # takes what it finds for the usual

`benchmarks.instructions` counts instead of measuring, where valgrind is installed.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from typing import Any, Final

from benchmarks import usual
from benchmarks.hot import HOT, Watched, references
from benchmarks.tables import Goal, Table

MARGIN: Final = 1.4
"""Times the usual ratio at which the guard fails; a slowdown of 1.5 is beyond it."""

_SAMPLE: Final = 2e-3  # seconds of a sample, at least


def ratio(work: Watched, reference: Watched, rounds: int = 11) -> float:
    """Return the kernel's time over that of its reference: least over least, in turns."""
    works, repeats = (work, reference), [_repeats(work), _repeats(reference)]
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for one, count, found in zip(works, repeats, times, strict=True):
            found.append(_processor(one, count))
    return min(times[0]) / min(times[1])


def _repeats(work: Callable[[], object]) -> int:
    work()
    return max(1, round(_SAMPLE / max(_processor(work, 1), 1e-6)))


def _processor(work: Callable[[], object], count: int) -> float:
    start = time.process_time()
    for _ in range(count):
        work()
    return (time.process_time() - start) / count


def kernels() -> Table:
    """Time hot kernels over plain loops of the same kind; what a change must not raise."""
    rows: list[tuple[Any, ...]] = []
    plain, known = references(), usual.load("times")
    for name, make in HOT.items():
        one = make()
        found = statistics.median(ratio(one, plain[one.reference]) for _ in range(3))
        rows.append((name, found, known[name], known[name] * MARGIN))
    return Table(
        "Hot kernels over reference loops",
        ("kernel", "time over reference", "usually", "at most"),
        rows,
        f"The guard of the continuous integration fails above {MARGIN} times the usual ratio, "
        "or by instructions where valgrind is installed.",
        Goal("time over reference", "at most"),
    )


def main(*, keep: bool) -> int:
    """Fail where a kernel is too slow in each of three attempts."""
    plain, known, found = references(), usual.load("times"), dict[str, float]()
    for name, make in HOT.items():
        one, tries = make(), list[float]()
        for _ in range(3):
            tries.append(ratio(one, plain[one.reference]))
            if not keep and tries[-1] <= known.get(name, 0.0) * MARGIN:
                break
        found[name] = statistics.median(tries) if keep else min(tries)
    if keep:
        usual.save("times", found)
        known = usual.load("times")
    return usual.told(usual.compared(found, known, MARGIN))


TABLES: Final = (kernels,)

if __name__ == "__main__":
    sys.exit(main(keep="--usual" in sys.argv))
