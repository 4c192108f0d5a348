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


def test_the_name_of_the_folder_tells_sources_compilers_and_processors_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "one.py").write_text("a = 1")
    names = [cache.fingerprint(tmp_path)]
    assert cache.fingerprint(tmp_path) == names[0]
    (tmp_path / "one.py").write_text("a = 2")
    names.append(cache.fingerprint(tmp_path))
    (tmp_path / "two.py").write_text("")
    names.append(cache.fingerprint(tmp_path))
    for what, value in (
        ("config.CPU_NAME", "x86-64-v3"),
        ("config.CPU_FEATURES", "+avx2"),
        ("__version__", "0.1"),
    ):
        monkeypatch.setattr(f"numba.{what}", value)
        names.append(cache.fingerprint(tmp_path))
    monkeypatch.setattr("llvmlite.__version__", "0.1")
    names.append(cache.fingerprint(tmp_path))
    assert len(set(names)) == len(names)


def test_old_folders_of_the_package_are_removed(tmp_path: Path) -> None:
    inside = tmp_path / "__pycache__"
    (inside / "compiled-old").mkdir(parents=True)
    (inside / "a.nbi").touch()
    (inside / "a.cpython-311.pyc").touch()
    place = cache.folder(tmp_path)
    assert place is not None
    assert {file.name for file in inside.iterdir()} == {place.name, "a.cpython-311.pyc"}


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
    place = cache.folder(package, user)
    assert place is not None
    assert {folder.name for folder in user.iterdir()} == {place.name, "compiled-other"}

    nowhere = tmp_path / "file"
    nowhere.touch()
    assert cache.folder(package, nowhere) is None


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_files_that_a_crash_cut_short_are_removed(
    answer: Answer, tmp_path: Path, ending: str
) -> None:
    copy = tmp_path / "vibroimpact_solvers"
    shutil.copytree(SOLVERS, copy, ignore=shutil.ignore_patterns("__pycache__"))
    write(copy, "kernel", 6.0)
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
    inside = cache.folder(package, user)
    assert inside is not None
    assert inside.parent.parent == package
    (inside / "kernels").mkdir()
    (inside / "kernels" / "a.nbi").write_bytes(b"x.")
    (inside / "sweep.warm").write_text("0.1.0")
    (inside / "used").unlink()
    (inside / "used").symlink_to(tmp_path / "nothing" / "there")  # whoever runs this
    for _ in range(2):
        place = cache.folder(package, user)
        assert place == user / inside.name
        assert (place / "kernels" / "a.nbi").read_bytes() == b"x."
        assert (place / "sweep.warm").read_text() == "0.1.0"
        assert [folder.name for folder in user.iterdir()] == [inside.name]


def test_a_processor_that_lacks_what_numba_is_told_of_gets_code_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = cache.fingerprint(tmp_path)
    there = {name for name, is_there in binding.get_host_cpu_features().items() if is_there}
    some = ",".join(f"+{name}" for name in sorted(there)[:3])
    monkeypatch.setattr("numba.config.CPU_NAME", "x86-64-v3")
    monkeypatch.setattr("numba.config.CPU_FEATURES", some)
    told = cache.fingerprint(tmp_path)
    assert told != own
    assert cache.fingerprint(tmp_path) == told
    monkeypatch.setattr("numba.config.CPU_FEATURES", f"{some},+no-such-feature")
    assert cache.fingerprint(tmp_path) == own


def test_the_folder_that_numba_is_given_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "chosen"))
    place = cache.folder(tmp_path)
    assert place is not None
    assert place.parent == tmp_path / "chosen"
    assert not (tmp_path / "__pycache__").exists()
