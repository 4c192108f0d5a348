"""Instructions of hot kernels, counted by valgrind: a guard that no neighbour disturbs.

    python -m benchmarks.instructions            # fails where a kernel is longer than usual
    python -m benchmarks.instructions --usual    # takes what it finds for the usual

Kernels are compiled for one processor, whatever this one is, and run once under valgrind's
cachegrind, as many processes at a time as there are cores. For each kernel the process is forked:
the child runs it and ends, and the counts of a child that does nothing are taken off. What is
compared with the usual is the number of instructions over that of a plain loop compiled beside
it, so that other versions of the compiler matter less.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from benchmarks import usual

MARGIN: Final = 1.25
"""Times the usual at which the guard fails; a slowdown of 1.5 is beyond it."""

_ENVIRONMENT: Final = {
    # Valgrind knows no wider vectors; these are what every server of the last ten years has.
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": "+avx,+avx2,+fma,+sse4.2",
    "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL "
    "AVX512_SPR",
    "OPENBLAS_CORETYPE": "Haswell",
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "PYTHONHASHSEED": "0",
}
_VALGRIND: Final = ("valgrind", "--tool=cachegrind", "--cache-sim=no")
_COMMAND: Final = (sys.executable, "-m", "benchmarks.instructions")
_NOTHING: Final = "nothing"

Works = Mapping[str, Callable[[], object]]
"""What is counted, by name; it can be pickled."""


def counts(works: Works, folder: Path) -> dict[str, int]:
    """Return the instructions of some works, which are run in processes of their own.

    Parameters
    ----------
    works : mapping
    folder : Path
        Where kernels are compiled to, and everything else stands that these processes leave.
    """
    with tempfile.NamedTemporaryFile(dir=folder) as file:
        file.write(pickle.dumps(dict(works)))
        file.flush()
        return _counts(Path(file.name), folder)


def ratios(names: Sequence[str]) -> dict[str, float]:
    """Return instructions of hot kernels over those of their references."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
    # Neighbours share what is compiled.
    size = -(-len(names) // cores)
    groups = [names[start : start + size] for start in range(0, len(names), size)]
    folder = compiled()
    with ThreadPoolExecutor(cores) as pool:
        found = pool.map(lambda group: _ratios(group, folder), groups)
        together = {name: ratio for part in found for name, ratio in part.items()}
    return {name: together[name] for name in names}


def compiled() -> Path:
    """Return the folder of compiled kernels: one for each state of all sources that matter.

    Numba itself looks at the file of a kernel alone, and not at those of kernels that it calls.
    """
    here = Path(__file__).parent
    kernels = (here.parent / "solvers" / "vibroimpact_solvers" / "kernels").glob("*.py")
    text = hashlib.sha256(f"{version('numba')} {version('llvmlite')} {sys.version}".encode())
    for path in [*sorted(kernels), here / "hot.py"]:
        text.update(path.read_bytes())
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = home / "vibroimpact" / "guard" / text.hexdigest()[:16]
    if not folder.exists():
        shutil.rmtree(folder.parent, ignore_errors=True)
        folder.mkdir(parents=True)
    return folder


def _ratios(names: Sequence[str], folder: Path) -> dict[str, float]:
    with tempfile.NamedTemporaryFile(dir=folder) as file:
        _run((*_COMMAND, "--record", file.name, *names), folder)
        found, works = _counts(Path(file.name), folder), pickle.loads(file.read())
    return {name: found[name] / found[works[name].reference] for name in names}


def _counts(file: Path, folder: Path) -> dict[str, int]:
    command = (*_COMMAND, "--inside", str(file))
    _run(command, folder)  # compiles, which is nothing to wait for under valgrind
    said, counted = _run((*_VALGRIND, f"--cachegrind-out-file={folder}/%p", *command), folder)
    names = dict(re.findall(r"^(\d+) (.+)$", said, re.M))
    found = {
        names[pid]: int(number.replace(",", ""))
        for pid, number in re.findall(r"==(\d+)== I\s+refs:\s+([\d,]+)", counted)
        if pid in names
    }
    return {name: number - found[_NOTHING] for name, number in found.items()}


def _run(command: Sequence[str], folder: Path) -> tuple[str, str]:
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        env={**os.environ, **_ENVIRONMENT, "NUMBA_CACHE_DIR": str(folder)},
        cwd=Path(__file__).parent.parent,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    return done.stdout, done.stderr


def record(file: Path, names: Sequence[str]) -> None:
    """Write hot kernels and all references to a file; each has been called, and is compiled."""
    from benchmarks.hot import HOT, references

    works: dict[str, Any] = {**references(), **{name: HOT[name]() for name in names}}
    for work in works.values():
        work()
    file.write_bytes(pickle.dumps(works))


def inside(file: Path) -> None:
    """Run each work of a file, and nothing, in a child each that tells its number."""
    works: dict[str, Callable[[], object]] = {_NOTHING: int, **pickle.loads(file.read_bytes())}
    for work in works.values():  # whatever is made at the first call
        work()
    for name, work in works.items():
        with _child() as child:
            if child == 0:
                work()
        print(child, name, flush=True)


@contextmanager
def _child() -> Iterator[int]:
    """Fork: yield 0 in the child, which ends afterwards, and its number in the parent."""
    child = os.fork()
    yield child
    if child == 0:
        os._exit(0)
    os.waitpid(child, 0)


def main(*, keep: bool) -> int:
    """Fail where a kernel has become longer."""
    from benchmarks.hot import HOT

    found = ratios(list(HOT))
    if keep:
        usual.save("instructions", found)
    return usual.told(usual.compared(found, usual.load("instructions"), MARGIN))


if __name__ == "__main__":
    arguments = sys.argv[1:]
    if arguments[:1] == ["--record"]:
        record(Path(arguments[1]), arguments[2:])
    elif arguments[:1] == ["--inside"]:
        inside(Path(arguments[1]))
    else:
        sys.exit(main(keep="--usual" in arguments))
