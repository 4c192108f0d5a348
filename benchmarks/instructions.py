"""Instructions of hot kernels, counted by valgrind: a guard that no neighbour disturbs.

    python -m benchmarks.instructions

Kernels are compiled for one processor, whatever this one is, and run once under valgrind's
cachegrind. For each of them the process is forked: the child runs it and ends, and the counts of
both differ by the kernel alone. What is compared with the usual is the number of instructions
over that of a plain loop compiled beside it, so that other versions of the compiler matter less.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final

MARGIN: Final = 1.25
"""Times the usual at which the guard fails."""

# Instructions over those of the reference of `benchmarks.guard`.
USUAL: Final[Mapping[str, float]] = {
    "impulse of one constraint": 0.551,
    "members with their motion": 0.900,
    "walks along limits": 0.867,
    "displacements": 1.092,
}

_ENVIRONMENT: Final = {
    # Valgrind knows no wider vectors; these are what every server of the last ten years has.
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "+avx,+avx2,+fma,+sse4.2",
    "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL "
    "AVX512_SPR",
    "OPENBLAS_CORETYPE": "Haswell",
    "OMP_NUM_THREADS": "1",
    "PYTHONHASHSEED": "0",
}
_NOTHING: Final = "nothing"


def counts() -> dict[str, tuple[int, int]]:
    """Return the instructions of kernels and of their references."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, **_ENVIRONMENT, "NUMBA_CACHE_DIR": folder}
        command = [sys.executable, "-m", "benchmarks.instructions", "--inside"]
        # The first run compiles, which is nothing to wait for under valgrind.
        for before in ((), ("valgrind", "--tool=cachegrind", "--cache-sim=no")):
            out = () if not before else (f"--cachegrind-out-file={folder}/%p",)
            done = subprocess.run(
                [*before, *out, *command],
                capture_output=True,
                text=True,
                env=environment,
                cwd=Path(__file__).parent.parent,
                check=False,
            )
            if done.returncode:
                raise RuntimeError(done.stderr[-2000:])
    names = dict(re.findall(r"^(\d+) (.+)$", done.stdout, re.M))
    found = {
        names[pid]: int(number.replace(",", ""))
        for pid, number in re.findall(r"==(\d+)== I\s+refs:\s+([\d,]+)", done.stderr)
        if pid in names
    }
    base = found[_NOTHING]
    return {name: (found[name] - base, found[f"{name}: reference"] - base) for name in USUAL}


def inside() -> None:
    """Run each kernel, its reference and nothing, in a child each that tells its number."""
    from benchmarks.guard import watched

    kernels = watched()
    for one in kernels:  # whatever is made at the first call
        one.work()
        one.reference()
    runs: list[tuple[str, Callable[[], object]]] = [(_NOTHING, int)]
    for one in kernels:
        runs += [(one.name, one.work), (f"{one.name}: reference", one.reference)]
    for name, work in runs:
        child = os.fork()
        if child == 0:
            work()
            os._exit(0)
        os.waitpid(child, 0)
        print(child, name, flush=True)


def rows() -> Iterator[tuple[str, int, float, float, float]]:
    """Yield kernels with instructions, over the reference, usual and the most allowed."""
    for name, (kernel, reference) in counts().items():
        yield name, kernel, kernel / reference, USUAL[name], USUAL[name] * MARGIN


def main() -> int:
    """Fail where a kernel has become longer."""
    slow = 0
    for name, kernel, over, usual, most in rows():
        slow += over > most
        print(f"{name}: {kernel} instructions, {over:.3f} of its reference (usually {usual:.3f})")
    return 1 if slow else 0


if __name__ == "__main__":
    if "--inside" in sys.argv:
        inside()
    else:
        sys.exit(main())
