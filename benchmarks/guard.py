"""Counts the instructions of the watched kernels under valgrind: none may need 3 % more than usual.

    python -m benchmarks.guard                       # fails where a kernel needs more than usual
    python -m benchmarks.guard --usual               # stores the counts as the usual ones
    python -m benchmarks.guard --usual "NAME"        # those of some kernels, such as new ones
    python -m benchmarks.guard --against CHECKOUT    # the kernels of another checkout beside ours

Instructions are counted, as no neighbour on the machine changes their number. The kernels are
those of `benchmarks.hot`. They are compiled for one processor, whatever this one is, and run once
under valgrind's cachegrind, as many processes at a time as there are cores: for each kernel the
process is forked, the child runs it and ends, and the counts of children that do nothing are taken
off. The processes that run kernels are given this file and `benchmarks.hot` of their checkout,
0.1.0 or later, and import nothing else of the benchmarks: this module neither.
"""

from __future__ import annotations

import argparse
import gc
import hashlib
import json
import os
import pickle
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, NamedTuple
from unittest import mock

TOLERANCE: Final = 1.03
"""Times the usual number of instructions at which the guard fails."""
OTHER_VERSIONS: Final = 1.25
"""The same where Python, the compiler or the mathematical library are other versions."""
USUAL: Final = Path(__file__).with_name("usual.json")
ROOT: Final = Path(__file__).parent.parent
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
_MISSING: Final = (
    "valgrind is not installed, and the guard counts instructions by nothing else: "
    "apt install valgrind (CONTRIBUTING.md names what the checks need)"
)
_NOTHING: Final = "nothing"
_FORMER_NAMES: Final[Mapping[str, str]] = {
    "members with their motion": "motion of one constraint",
    "members of two constraints": "motion of two constraints",
    "walks along limits": "certified path check",
    "stability, flights": "stability, free motion",
}
"""Names of kernels as they are now, by those that they had in 0.1.0."""

Works = Mapping[str, Callable[[], object]]
"""What is counted, by name; it can be pickled."""


class Comparison(NamedTuple):
    """The instructions of a kernel beside the usual ones, or those of another checkout.

    None where one of both is not known; more than the tolerance times the usual is too much.
    """

    name: str
    counted: int | None
    usual: int | None
    tolerance: float

    @property
    def good(self) -> bool:
        """Whether the kernel needs no more than it may."""
        if self.counted is None or self.usual is None:
            return False
        return self.counted <= self.usual * self.tolerance

    def __str__(self) -> str:
        if self.usual is None:
            return f"{self.name}: nothing to compare with; python -m benchmarks.guard --usual"
        if self.counted is None:
            return f"{self.name}: was not counted"
        times = self.counted / self.usual
        what = "" if self.good else f", too many: at most {self.tolerance}"
        return f"{self.name}: {self.counted:,} instructions, {times:.4f} times the usual{what}"


def compared(
    counted: Mapping[str, int], usual: Mapping[str, int], tolerance: float = TOLERANCE
) -> list[Comparison]:
    """Compare the counts of every kernel that either of both knows."""
    names = dict.fromkeys([*usual, *counted])
    return [Comparison(name, counted.get(name), usual.get(name), tolerance) for name in names]


def versions() -> dict[str, str]:
    """Return the versions that instructions depend on."""
    python = ".".join(platform.python_version_tuple()[:2])
    libraries = {name: version(name) for name in ("numba", "llvmlite", "numpy")}
    return {"python": python, **libraries, "libc": " ".join(platform.libc_ver())}


def usual() -> tuple[dict[str, int], float]:
    """Return the usual counts, and the tolerance that the installed versions need."""
    stored = json.loads(USUAL.read_text())
    tolerance = TOLERANCE if stored["versions"] == versions() else OTHER_VERSIONS
    return stored["instructions"], tolerance


def store(counted: Mapping[str, int]) -> None:
    """Store counts as the usual ones."""
    document = {"versions": versions(), "instructions": dict(counted)}
    USUAL.write_text(json.dumps(document, indent=2) + "\n")


@dataclass(frozen=True, slots=True)
class Checkout:
    """A checkout whose kernels are counted, and its interpreter."""

    root: Path = ROOT
    python: Path = Path(sys.executable)

    def counts(self, names: Sequence[str] = ()) -> dict[str, int]:
        """Return the instructions of its watched kernels, of all for no names."""
        if shutil.which(_VALGRIND[0]) is None:
            raise FileNotFoundError(_MISSING)
        folder = self.compiled()
        names = names or self._run(("--names",), folder)[0].splitlines()
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
        size = -(-len(names) // cores)  # neighbours share what is compiled
        groups = [names[start : start + size] for start in range(0, len(names), size)]
        with ThreadPoolExecutor(cores) as pool:
            parts = list(pool.map(lambda group: self._recorded(group, folder), groups))
        return {name: count for part in parts for name, count in part.items()}

    def works(self, works: Works, folder: Path) -> dict[str, int]:
        """Return the instructions of some works; `folder` keeps what is compiled for them."""
        with tempfile.NamedTemporaryFile(dir=folder) as file:
            file.write(pickle.dumps(dict(works)))
            file.flush()
            return self._counted(Path(file.name), folder)

    def compiled(self) -> Path:
        """Return the folder of compiled kernels: one for each state of all sources that matter.

        Numba itself looks at the file of a kernel alone, and not at those of kernels that it calls.
        """
        kernels = (self.root / "solvers" / "vibroimpact_solvers" / "kernels").rglob("*.py")
        text = hashlib.sha256(f"{self.root} {versions()}".encode())
        for path in sorted(kernels):
            text.update(path.read_bytes())
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = home / "vibroimpact" / "guard" / text.hexdigest()[:16]
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        for old in sorted(folder.parent.iterdir(), key=lambda path: path.stat().st_mtime)[:-4]:
            shutil.rmtree(old, ignore_errors=True)
        return folder

    def _recorded(self, names: Sequence[str], folder: Path) -> dict[str, int]:
        with tempfile.NamedTemporaryFile(dir=folder) as file:
            self._run(("--record", file.name, *names), folder)
            return self._counted(Path(file.name), folder)

    def _counted(self, file: Path, folder: Path) -> dict[str, int]:
        inside = ("--inside", str(file))
        self._run(inside, folder)  # compiles, which is nothing to wait for under valgrind
        valgrind = (*_VALGRIND, f"--cachegrind-out-file={folder}/%p")
        output, log = self._run(inside, folder, valgrind)
        children = re.findall(r"^(\d+) (.+)$", output, re.M)
        counts = {
            pid: int(number.replace(",", ""))
            for pid, number in re.findall(r"==(\d+)== I\s+refs:\s+([\d,]+)", log)
        }
        for pid, _ in children:
            (folder / pid).unlink(missing_ok=True)
        ordered = [counts[pid] for pid, _ in children]
        return {
            name: ordered[i] - (ordered[i - 1] + ordered[i + 1]) // 2
            for i, (_, name) in enumerate(children)
            if name != _NOTHING
        }

    def _run(
        self, arguments: Sequence[str], folder: Path, before: Sequence[str] = ()
    ) -> tuple[str, str]:
        """Run this file by the checkout's interpreter; return what it writes, output and errors."""
        places = {"NUMBA_CACHE_DIR": str(folder), "PYTHONPATH": str(self.root)}
        done = subprocess.run(
            # -P: the folder of this file stays off the path, modules are those of the checkout.
            [*before, str(self.python), "-P", str(Path(__file__).resolve()), *arguments],
            capture_output=True,
            text=True,
            env={**os.environ, **_ENVIRONMENT, **places},
            cwd=self.root,
            check=False,
        )
        if done.returncode:
            raise RuntimeError(done.stderr[-2000:])
        return done.stdout, done.stderr


def record(file: Path, names: Sequence[str]) -> None:
    """Write watched kernels with their arguments to a file; each has been called once."""
    from benchmarks.hot import HOT

    # 0.1.0 records the first call of any thread: with one core there is one.
    with mock.patch.object(os, "sched_getaffinity", return_value={0}):
        works: dict[str, Any] = {name: HOT[name]() for name in names}
    for work in works.values():
        work()
    file.write_bytes(pickle.dumps(works))


def inside(file: Path) -> None:
    """Run each work of a file in a child of its own; print the number of the child.

    Before the first one, between them and after the last one there is a child that does nothing:
    a child counts what its parent did before, and half of the two beside it is taken off.
    """
    works: dict[str, Callable[[], object]] = pickle.loads(file.read_bytes())
    for work in works.values():  # whatever is made at the first call
        work()
    gc.disable()  # in one child it might run, and not in another
    for _ in range(3):  # the first ones take more of the parent
        _in_child(_NOTHING, int)
    for name, work in works.items():
        _in_child(name, work)
        _in_child(_NOTHING, int)


def _in_child(name: str, work: Callable[[], object]) -> None:
    """Fork: the child does some work and ends, the parent waits and prints its number."""
    child = os.fork()
    if child == 0:
        work()
        os._exit(0)
    os.waitpid(child, 0)
    print(child, name, flush=True)


def main() -> int:
    """Fail where a kernel needs too many instructions."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.guard")
    parser.add_argument("--usual", action="store_true", help="store the counts as the usual ones")
    parser.add_argument("--against", type=Path, help="a checkout whose counts are the usual ones")
    parser.add_argument("--python", type=Path, help="its interpreter; else that of its .venv")
    parser.add_argument("names", nargs="*", help="kernels; all for none")
    given = parser.parse_args()
    if given.usual and given.names and usual()[1] != TOLERANCE:
        parser.error("counts of some kernels go with the versions of the others: leave out names")
    try:
        counted = Checkout().counts(given.names)
    except FileNotFoundError as error:
        print(error, file=sys.stderr)
        return 2
    if given.usual:
        store({**usual()[0], **counted} if given.names else counted)
    known, tolerance = usual()
    if given.against is not None:
        python = given.python or given.against.resolve() / ".venv/bin/python"
        theirs = Checkout(given.against.resolve(), python).counts()
        known = {_FORMER_NAMES.get(name, name): count for name, count in theirs.items()}
        tolerance = TOLERANCE
        for name in sorted(counted.keys() ^ known.keys()):
            print(f"{name}: watched in one of the checkouts only")
        counted = {name: count for name, count in counted.items() if name in known}
    if given.names or given.against:
        known = {name: known[name] for name in given.names or counted if name in known}
    comparisons = compared(counted, known, tolerance)
    for comparison in comparisons:
        print(comparison)
    if tolerance != TOLERANCE:
        print(f"Versions differ from those in {USUAL.name}: the tolerance is {tolerance}.")
    return int(not all(comparison.good for comparison in comparisons))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--names"]:
        from benchmarks.hot import HOT

        print("\n".join(HOT))
    elif sys.argv[1:2] == ["--record"]:
        record(Path(sys.argv[2]), sys.argv[3:])
    elif sys.argv[1:2] == ["--inside"]:
        inside(Path(sys.argv[2]))
    else:
        sys.exit(main())
