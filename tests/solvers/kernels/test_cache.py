"""Compiled kernels are never those of other sources, and old ones do not pile up."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numba
import pytest
from llvmlite import binding

from tests.forked import Forked
from vibroimpact_solvers.kernels import cache

SOLVERS = cache.KERNELS.parent
HELPER = '''"""A helper."""

from vibroimpact_solvers.kernels.jit import {how}


@{how}
def helper(x: float) -> float:
    """Return its answer."""
    return {answer}
'''
CALLER = '''"""A kernel that calls the helper; this file is never touched."""

from vibroimpact_solvers.kernels.helper import helper
from vibroimpact_solvers.kernels.jit import kernel


@kernel
def caller(x: float) -> float:
    """Return what the helper returns."""
    return helper(x)
'''
PROGRAM = """
from vibroimpact_solvers.kernels.caller import caller
print(caller(1.0), caller.stats.cache_hits[caller.signatures[0]] if caller.stats.cache_hits else 0)
"""


def write(place: Path, how: str, answer: float) -> None:
    (place / "kernels" / "helper.py").write_text(HELPER.format(how=how, answer=answer))
    (place / "kernels" / "caller.py").write_text(CALLER)


def _environment() -> dict[str, str]:
    return {k: v for k, v in os.environ.items() if not k.startswith("NUMBA")}


def _told(done: subprocess.CompletedProcess[str]) -> tuple[float, int]:
    assert done.returncode == 0, done.stderr
    value, hits = done.stdout.split()
    return float(value), int(hits)


Answer = Callable[[Path], tuple[float, int]]


@pytest.fixture(scope="module")
def answer() -> Iterator[Answer]:
    """Return what gives the kernel's answer, and how often it was taken from the cache.

    Each time in a new process, with the solvers of a folder; numba alone is loaded before.
    """
    forked = Forked("numba", environment=_environment())
    yield lambda path: _told(forked(PROGRAM, places=(path,)))
    forked.close()


@pytest.mark.parametrize("how", ["kernel", "inline"])
def test_a_changed_helper_is_compiled_into_callers_that_were_not_touched(
    answer: Answer, tmp_path: Path, how: str
) -> None:
    copy = tmp_path / "vibroimpact_solvers"
    shutil.copytree(SOLVERS, copy, ignore=shutil.ignore_patterns("__pycache__"))
    write(copy, how, 6.0)
    assert answer(tmp_path) == (6.0, 0)
    assert answer(tmp_path) == (6.0, 1)
    write(copy, how, 7.0)
    assert answer(tmp_path) == (7.0, 0)
    assert len(list((copy / "kernels" / "__pycache__").glob("compiled-*"))) == 1


def copied(folder: Path) -> Path:
    """Copy the solvers into a folder, with a kernel that calls a helper; return the copy."""
    copy = folder / "vibroimpact_solvers"
    shutil.copytree(SOLVERS, copy, ignore=shutil.ignore_patterns("__pycache__"))
    write(copy, "inline", 6.0)
    return copy


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def test_comments_and_docstrings_compile_nothing(answer: Answer, tmp_path: Path) -> None:
    """Not even where they move all lines, in the kernel's own file and in what it imports."""
    kernels = copied(tmp_path) / "kernels"
    assert answer(tmp_path) == (6.0, 0)
    edit(kernels / "helper.py", '"""A helper."""', '"""A helper.\n\nIt helps.\n"""\n# It does.\n')
    edit(kernels / "helper.py", "Return its answer.", "Return the\n    answer.\n    ")
    edit(kernels / "caller.py", "\n\n\n@kernel", "\n\n# A kernel:\n\n\n\n@kernel")
    edit(kernels / "caller.py", "Return what", "Answer what")
    edit(kernels / "caller.py", "return helper(x)", "return helper(  # more than lines\n    x)")
    edit(kernels / "jit.py", '"""How', '"""Why and how')
    assert answer(tmp_path) == (6.0, 1)


@pytest.mark.parametrize("file", ["jit", "cache", "sources"])
def test_how_kernels_are_compiled_and_kept_is_a_part_of_them(
    answer: Answer, tmp_path: Path, file: str
) -> None:
    kernels = copied(tmp_path) / "kernels"
    assert answer(tmp_path) == (6.0, 0)
    with (kernels / f"{file}.py").open("a") as module:
        module.write("\nCHANGED = 1\n")
    assert answer(tmp_path) == (6.0, 0)


STATE = '''"""What a kernel reads."""

from typing import NamedTuple


class State(NamedTuple):
    """Two numbers."""

    first: float
    second: float
'''
READER = '''"""A kernel that reads a field by its name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vibroimpact_solvers.kernels.jit import kernel

if TYPE_CHECKING:
    from vibroimpact_solvers.state import State


@kernel
def caller(state: State) -> float:
    """Return it."""
    return state.first
'''
READ = """
from vibroimpact_solvers.state import State
from vibroimpact_solvers.kernels.caller import caller
print(caller(State(first=1.0, second=2.0)), caller.stats.cache_hits[caller.signatures[0]]
      if caller.stats.cache_hits else 0)
"""


def test_fields_that_change_places_are_found_in_their_new_ones(tmp_path: Path) -> None:
    """A kernel looks at the place of a field; that of its class is in another room."""
    forked = Forked("numba", environment=_environment())
    copy = copied(tmp_path)
    (copy / "state.py").write_text(STATE)
    (copy / "kernels" / "caller.py").write_text(READER)
    try:
        assert _told(forked(READ, places=(tmp_path,))) == (1.0, 0)
        assert _told(forked(READ, places=(tmp_path,))) == (1.0, 1)
        edit(copy / "state.py", "    first: float\n", "")
        edit(copy / "state.py", "    second: float\n", "    second: float\n    first: float\n")
        assert _told(forked(READ, places=(tmp_path,))) == (1.0, 0)
    finally:
        forked.close()


def test_equal_sources_share_their_kernels(tmp_path: Path) -> None:
    """Wherever they are: an installation finds what another one has compiled."""
    forked = Forked("numba", environment=_environment())
    shared = f"import numba; numba.config.CACHE_DIR = {str(tmp_path / 'shared')!r}\n"
    places = [tmp_path / name for name in ("one", "two", "three")]
    for place in places:
        copied(place)
    write(places[2] / "vibroimpact_solvers", "inline", 7.0)
    try:
        answers = [_told(forked(shared + PROGRAM, places=(place,))) for place in places]
    finally:
        forked.close()
    assert answers == [(6.0, 0), (6.0, 1), (7.0, 0)]


def wheel(folder: Path, version: str, value: float) -> Path:
    """Write a wheel that holds the solvers alone; pip removes what it wrote, numba's files stay."""
    source = folder / version / "vibroimpact_solvers"
    shutil.copytree(SOLVERS, source, ignore=shutil.ignore_patterns("__pycache__"))
    write(source, "kernel", value)
    files = {str(file.relative_to(source.parent)): file.read_text() for file in _texts(source)}
    about = f"solvers-{version}.dist-info"
    files[f"{about}/METADATA"] = f"Metadata-Version: 2.1\nName: solvers\nVersion: {version}\n"
    files[f"{about}/WHEEL"] = "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    record = f"{about}/RECORD"
    files[record] = "".join(f"{name},,\n" for name in (*files, record))
    path = folder / f"solvers-{version}-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return path


def _texts(folder: Path) -> list[Path]:
    return [file for file in folder.rglob("*") if file.is_file()]


def test_an_upgrade_by_pip_computes_the_new_numbers(tmp_path: Path) -> None:
    place = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", str(place)], check=True, timeout=120)
    python = str(place / "bin" / "python")
    libraries = next(place.glob("lib/python3*/site-packages"))
    # Behind the environment's own packages: those of this one.
    (libraries / "libraries.pth").write_text(str(Path(numba.__file__).parents[1]))
    answers = []
    for version, value in (("1.0", 6.0), ("1.1", 7.0)):
        install = ["-m", "pip", "install", "-q", "--upgrade", str(wheel(tmp_path, version, value))]
        subprocess.run([python, *install], check=True, timeout=120)
        done = subprocess.run(
            [python, "-c", PROGRAM], env=_environment() | {"PYTHONPATH": ""},
            capture_output=True, text=True, check=False, timeout=120,
        )  # fmt: skip
        answers.append(_told(done))
    assert answers == [(6.0, 0), (7.0, 0)]
    assert len(list(libraries.glob("vibroimpact_solvers/kernels/__pycache__/compiled-*"))) == 1


def test_the_name_of_the_folder_tells_compilers_and_processors_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = [cache.environment()]
    assert cache.environment() == names[0]
    for what, value in (
        ("numba.config.CPU_NAME", "x86-64-v3"),
        ("numba.config.CPU_FEATURES", "+avx2"),
        ("numba.config.OPT", 0),
        ("numba.config.BOUNDSCHECK", 1),
        ("numba.config.SLP_VECTORIZE", 1),
        ("numba.__version__", "0.1"),
        ("llvmlite.__version__", "0.1"),
        ("numpy.__version__", "0.1"),
        ("scipy.__version__", "0.1"),
        ("sys.abiflags", "t"),
    ):
        monkeypatch.setattr(what, value)
        names.append(cache.environment())
    assert len(set(names)) == len(names)


def test_the_folder_of_a_module_is_named_by_its_sources(tmp_path: Path) -> None:
    """By those that the process runs, even if the file is another one by now."""
    (tmp_path / "one.py").write_text("a = 1")
    name = f"{tmp_path.parent.name}.{tmp_path.name}.one"
    first = cache.folders(tmp_path)[name]
    assert first.startswith("one-")
    (tmp_path / "one.py").write_text("a = 2")
    assert cache.folders(tmp_path)[name] == first
    place = cache.folder(tmp_path)
    assert place is not None
    (place / first).mkdir()
    cache.folder(tmp_path)
    assert not (place / first).exists()  # no other process will need it


def test_old_folders_of_the_package_are_removed(tmp_path: Path) -> None:
    inside = tmp_path / "__pycache__"
    (tmp_path / "one.py").write_text("a = 1")
    former = inside / "compiled-0123456789abcdef"  # of a release up to 0.2.0
    for folder in (inside / "compiled-old", inside / "compiled-other", former):
        folder.mkdir(parents=True)
    # Another Python may be used with the same files, turn by turn.
    (inside / "compiled-other" / "used").touch()
    (former / "used").touch()
    (inside / "a.nbi").touch()
    (inside / "a.cpython-311.pyc").touch()
    place = cache.folder(tmp_path)
    assert place is not None
    left = {place.name, "compiled-other", "a.cpython-311.pyc"}
    assert {file.name for file in inside.iterdir()} == left
    present = set(cache.folders(tmp_path).values())
    for name in (*present, "one-old", "two-old"):
        (place / name).mkdir()
    assert cache.folder(tmp_path) == place
    assert {file.name for file in place.iterdir()} == {*present, "used", "sources.json"}


def test_without_a_writable_package_the_caches_of_the_user_serve(tmp_path: Path) -> None:
    package, user = tmp_path / "package", tmp_path / "user"
    package.mkdir()
    (package / "__pycache__").touch()  # no folder can be made there, whoever runs this
    user.mkdir()
    month = 31 * 86400.0
    for name, age in (("compiled-other", 0.0), ("compiled-old", month)):
        (user / name).mkdir()
        (user / name / "used").touch()
        os.utime(user / name / "used", (time.time() - age,) * 2)
    (user / "compiled-never").mkdir()
    (package / "one.py").write_text("a = 1")
    (user / "compiled-other" / "one-of-another").mkdir()
    place = cache.folder(package, user)
    assert place is not None
    assert {folder.name for folder in user.iterdir()} == {place.name, "compiled-other"}
    # Modules of other installations are there until they have not been used for a month.
    (mine,) = cache.folders(package).values()
    for name, age in ((mine, 2 * month), ("one-of-another", 0.5 * month), ("one-old", month)):
        (place / name).mkdir()
        os.utime(place / name, (time.time() - age,) * 2)
    for _ in range(2):
        assert cache.folder(package, user) == place
        assert {folder.name for folder in place.iterdir() if folder.is_dir()} == {
            mine, "one-of-another",
        }  # fmt: skip
    assert time.time() - (place / mine).stat().st_mtime < month  # for installations with others

    nowhere = tmp_path / "file"
    nowhere.touch()
    assert cache.folder(package, nowhere) is None


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_files_that_a_crash_cut_short_are_removed(
    answer: Answer, tmp_path: Path, ending: str
) -> None:
    copy = copied(tmp_path)
    assert answer(tmp_path) == (6.0, 0)
    (folder,) = (copy / "kernels" / "__pycache__").glob("compiled-*")
    files = list(folder.glob(f"*/caller*.{ending}"))
    assert files
    for content in (b"", files[0].read_bytes()[:-20], bytes(files[0].stat().st_size)):
        (folder / "sweep.warm").write_text("0.1.0")
        files[0].write_bytes(content)
        assert answer(tmp_path) == (6.0, 0)
        assert answer(tmp_path) == (6.0, 1)
        assert not (folder / "sweep.warm").exists()


def test_kernels_of_a_package_that_cannot_be_written_to_are_copied(tmp_path: Path) -> None:
    """As in an image: root compiled them, another user runs the service."""
    package, user = tmp_path / "package", tmp_path / "user"
    package.mkdir()
    (package / "one.py").write_text("a = 1")
    inside = cache.folder(package, user)
    assert inside is not None
    assert inside.parent.parent == package
    (module,) = cache.folders(package).values()
    (inside / module).mkdir()
    (inside / module / "a.nbi").write_bytes(b"x.")
    (inside / module / "b.nbi").write_bytes(b"cut sho")
    (inside / "sweep.warm").write_text("0.1.0")
    (inside / "used").unlink()
    (inside / "used").symlink_to(tmp_path / "nothing" / "there")  # whoever runs this
    for _ in range(2):
        place = cache.folder(package, user)
        assert place == user / inside.name
        assert (place / module / "a.nbi").read_bytes() == b"x."
        assert not (place / module / "b.nbi").exists()
        assert (place / "sweep.warm").read_text() == "0.1.0"
        assert (place / "sources.json").read_text() == (inside / "sources.json").read_text()
        assert [folder.name for folder in user.iterdir()] == [inside.name]
        assert not list(place.rglob(".*"))
    # What was compiled there meanwhile stays, and what a later image brings comes beside it.
    (place / module / "a.nbi").write_bytes(b"y.")
    (inside / module / "c.nbi").write_bytes(b"z.")
    cache.folder(package, user)
    assert (place / module / "a.nbi").read_bytes() == b"y."
    assert (place / module / "c.nbi").read_bytes() == b"z."


def test_a_processor_that_lacks_what_numba_is_told_of_gets_code_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own = cache.environment()
    there = {name for name, is_there in binding.get_host_cpu_features().items() if is_there}
    some = ",".join(f"+{name}" for name in sorted(there)[:3])
    monkeypatch.setattr("numba.config.CPU_NAME", "x86-64-v3")
    monkeypatch.setattr("numba.config.CPU_FEATURES", some)
    told = cache.environment()
    assert told != own
    assert cache.environment() == told
    monkeypatch.setattr("numba.config.CPU_FEATURES", f"{some},+no-such-feature")
    assert cache.environment() == own


def test_the_folder_that_numba_is_given_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "chosen"))
    place = cache.folder(tmp_path)
    assert place is not None
    assert place.parent == tmp_path / "chosen"
    assert not (tmp_path / "__pycache__").exists()
