"""Processor time that compiling the kernels takes, over that of one fixed function.

    python -m benchmarks.compile_times            # fails where a kernel takes a quarter more
    python -m benchmarks.compile_times --usual    # stores the ratios as the usual ones

Each kernel is compiled from nothing in a process of its own, and the fixed function, `measure`,
before and after it: a slow or a busy machine takes longer for both. Whoever installs the project,
and whoever changes a kernel, waits for these times.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

from benchmarks.guard import versions

TOLERANCE: Final = 1.25
"""Times the usual ratio at which the guard fails."""
USUAL: Final = Path(__file__).with_name("usual_compile_times.json")
ROOT: Final = Path(__file__).parent.parent
KERNELS: Final = (
    "time history, N=13",
    "motion of two constraints",
    "certified path check",
    "existence bands",
    "stability, zeros",
    "soft limiters",
)
"""Watched kernels of `benchmarks.hot`, one for each long compilation; the longest first."""
_REPEATS: Final = 3


def measure() -> float:
    """Return the seconds of processor time in which a fixed function is compiled."""
    import numba
    import numpy as np

    def fixed(a: Any, b: Any, n: int) -> float:
        total = 0.0
        for i in range(n):
            for j in range(a.shape[1]):
                if a[i, j] > b[j]:
                    total += a[i, j] * b[j] - np.sqrt(abs(a[i, j]))
                else:
                    b[j] = total / (1.0 + a[i, j] * a[i, j])
            for j in range(a.shape[1]):
                a[i, j] = np.sin(b[j]) * np.exp(-abs(total)) + a[i, j - 1]
        return total

    begun = time.process_time()
    numba.njit(nogil=True, error_model="numpy")(fixed)(np.ones((2, 3)), np.ones(3), 2)
    return time.process_time() - begun


def one(name: str) -> float:
    """Return the ratio of one kernel: what compiling its first call takes, over `measure`."""
    from benchmarks.hot import HOT

    measure()  # what numba loads at its first compilation
    fixed = [measure() for _ in range(_REPEATS)]
    begun = time.process_time()
    HOT[name]()()
    taken = time.process_time() - begun
    fixed += [measure() for _ in range(_REPEATS)]
    return taken / statistics.median(fixed)


def ratios(names: Sequence[str] = KERNELS) -> dict[str, float]:
    """Return the ratios of kernels, as many at a time as there are cores."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return dict(zip(names, pool.map(_ratio, names), strict=True))


def _ratio(name: str) -> float:
    """Return the ratio of a kernel, measured in a new process with an empty folder."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.compile_times", "--one", name],
            capture_output=True,
            text=True,
            check=True,
            cwd=ROOT,
            env=os.environ | {"NUMBA_CACHE_DIR": folder, "OMP_NUM_THREADS": "1"},
        )
    return float(done.stdout.split()[-1])


def too_long(
    measured: Mapping[str, float], known: Mapping[str, float], tolerance: float = TOLERANCE
) -> list[str]:
    """Return a sentence for each kernel that takes too long, or has no usual ratio."""
    sentences = []
    for name, ratio in measured.items():
        usual = known.get(name)
        if usual is None:
            sentences.append(f"{name}: nothing to compare with; store it by --usual")
        elif ratio > tolerance * usual:
            sentences.append(
                f"{name}: compiling takes {ratio:.1f} times the fixed function, usually "
                f"{usual:.1f}; at most {tolerance} times that"
            )
    return sentences


def main() -> int:
    """Fail where compiling takes too long."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.compile_times")
    parser.add_argument("--usual", action="store_true", help="store the ratios as the usual ones")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    parser.add_argument("names", nargs="*", help="kernels; all for none")
    given = parser.parse_args()
    if given.one:
        print(one(given.one))
        return 0
    measured = ratios(given.names or KERNELS)
    for name, ratio in measured.items():
        print(f"{name}: {ratio:.1f} times the fixed function")
    if given.usual:
        document = {"versions": versions(), "ratios": {k: round(v, 1) for k, v in measured.items()}}
        USUAL.write_text(json.dumps(document, indent=2) + "\n")
        return 0
    document = json.loads(USUAL.read_text())
    if document["versions"] != versions():
        print(f"Versions differ from those in {USUAL.name}: nothing is compared.")
        return 0
    sentences = too_long(measured, document["ratios"])
    print("\n".join(sentences))
    return int(bool(sentences))


if __name__ == "__main__":
    sys.exit(main())
