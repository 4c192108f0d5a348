"""What is compiled when something changes, and what people are told while it is."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import grimp
import numba
import pytest
from numba.core import event

from tests.forked import Forked
from vibroimpact_solvers.kernels import cache, inventory

KEEP = """
from pathlib import Path
from vibroimpact_solvers.kernels import inventory
for name, kernel in inventory.kernels().items():
    file = Path(kernel.stats.cache_path, name + "-kernel.py.nbi")
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(b".")
"""
LIST = """
import sys
from vibroimpact_service.cli import app
sys.argv[1:] = ["warm", "--dry-run"]
app()
"""
Listed = Callable[[], dict[str, int]]


@pytest.fixture(scope="module")
def forked() -> Iterator[Forked]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA")}
    process = Forked("numba", "vibroimpact_service.settings", environment=environment)
    yield process
    process.close()


def names(forked: Forked, place: Path) -> dict[str, int]:
    """Return the kernels that the solvers of a folder would compile, with seconds."""
    done = forked(LIST, places=(place,))
    assert done.returncode == 0, done.stderr
    *lines, total = done.stdout.splitlines()
    assert re.fullmatch(rf"{len(lines)} of \d+ kernels, about \d+ s", total)
    return {name: int(seconds) for name, seconds, _ in map(str.split, lines)}


@pytest.fixture(scope="module")
def kept(forked: Forked, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with solvers whose kernels count as compiled: there are files for them."""
    place = tmp_path_factory.mktemp("kept")
    copy = place / "vibroimpact_solvers"
    shutil.copytree(cache.KERNELS.parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    assert len(names(forked, place)) > 30
    done = forked(KEEP, places=(place,))
    assert done.returncode == 0, done.stderr
    assert names(forked, place) == {}
    return place


@pytest.fixture
def listed(forked: Forked, kept: Path, tmp_path: Path) -> Listed:
    """Return what lists the kernels that a copy of those solvers would compile."""
    shutil.copytree(kept, tmp_path, dirs_exist_ok=True)
    return lambda: names(forked, tmp_path)


def edit(tmp_path: Path, name: str, old: str, new: str) -> None:
    file = tmp_path / "vibroimpact_solvers" / name
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def importers(*modules: str) -> set[str]:
    """Return the kernels of modules that import others, as another program finds them."""
    graph = grimp.build_graph("vibroimpact_solvers", cache_dir=None)
    reached = set(modules).union(*(graph.find_downstream_modules(module) for module in modules))
    return {
        name
        for name, kernel in inventory.kernels().items()
        if kernel.__module__ in {f"vibroimpact_solvers.{each}" for each in modules} | reached
    }


def test_a_comment_compiles_nothing(listed: Listed, tmp_path: Path) -> None:
    edit(tmp_path, "kernels/arctangent.py", "\nimport", "\n\n# A comment.\nimport")
    edit(tmp_path, "kernels/flow.py", '"""', '"""Flow. ')
    assert listed() == {}


def test_a_number_compiles_what_imports_it(listed: Listed, tmp_path: Path) -> None:
    edit(tmp_path, "kernels/arctangent.py", "_FAR: Final = 32.0", "_FAR: Final = 33.0")
    assert listed().keys() == {"lossy_walls.printed_shapes", "lossy_walls.slow_flow"}


@pytest.mark.parametrize("module", ["kernels.flow", "kernels.phases", "arrays"])
def test_a_change_compiles_what_imports_the_module(
    listed: Listed, tmp_path: Path, module: str
) -> None:
    with (tmp_path / "vibroimpact_solvers" / f"{module.replace('.', '/')}.py").open("a") as file:
        file.write("\nCHANGED = 1\n")
    changed = listed()
    assert changed.keys() == importers(f"vibroimpact_solvers.{module}") - {
        "whole_soft_motion.whole_soft_motion"  # warming does not compile it: no request needs it
    }
    assert list(changed.values()) == sorted(changed.values(), reverse=True)


def test_a_file_that_is_gone_is_listed(listed: Listed, tmp_path: Path) -> None:
    (file,) = tmp_path.glob("vibroimpact_solvers/kernels/__pycache__/*/*/bands.survey-*.nbi")
    file.unlink()
    assert listed().keys() == {"bands.survey"}


@pytest.mark.needs("the compiler")
def test_times_are_those_of_kernels() -> None:
    assert inventory.SECONDS.keys() <= inventory.kernels().keys()


def test_cores_share_what_there_is_to_compile() -> None:
    longest = max(inventory.SECONDS, key=lambda name: inventory.SECONDS[name])
    total = sum(inventory.SECONDS.values())
    assert inventory.estimate(inventory.SECONDS) == pytest.approx(total)
    assert inventory.estimate(inventory.SECONDS, 2) == max(total / 2, inventory.SECONDS[longest])
    assert inventory.estimate(inventory.SECONDS, 100) == inventory.SECONDS[longest]
    assert inventory.notice(39.6) == "compiling kernels, about 40 s, once"
    assert inventory.notice(0.1) == "compiling kernels, about 1 s, once"


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the name of a module whose functions count as kernels."""
    name = "vibroimpact_solvers.kernels.planted"
    monkeypatch.setattr(cache, "folders", lambda: {name: "planted-0"})
    return name


def planted(module: str, name: str, **options: bool) -> object:
    """Return a function of a module, compiled when it is called."""

    def function(x: float) -> float:
        return x + 1.0

    function.__module__, function.__qualname__ = module, name
    return numba.njit(**options)(function)


def test_what_is_compiled_says_so_in_one_line(
    module: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines: list[str] = []
    monkeypatch.setattr(inventory, "SECONDS", {"planted.long": 41.0, "planted.other": 1.4})
    with event.install_listener("numba:compile", inventory.Announcing(lines.append)):
        planted("another.module", "long")(1.0)
        planted(module, "within", no_cpython_wrapper=True).compile("f8(f8)")
        assert lines == []
        first = planted(module, "other")
        for _ in range(2):
            assert first(1.0) == 2.0
        assert lines == ["compiling kernels, about 1 s, once"]
        planted(module, "small")(1.0)
        assert len(lines) == 1
        planted(module, "long")(1.0)
        assert lines[1:] == ["compiling kernels, about 41 s, once"]
    planted(module, "long")(1.0)
    assert len(lines) == 2
    with inventory.announced():
        planted(module, "long")(1.0)
    written = capsys.readouterr()
    assert (written.out, written.err) == ("", "compiling kernels, about 41 s, once\n")


def test_what_is_read_from_disk_says_nothing(tmp_path: Path, forked: Forked) -> None:
    copy = tmp_path / "vibroimpact_solvers"
    shutil.copytree(cache.KERNELS.parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "kernels" / "planted.py").write_text(
        "from vibroimpact_solvers.kernels.jit import kernel\n\n"
        "@kernel\ndef planted(x):\n    return x + 1.0\n"
    )
    code = (
        "from vibroimpact_solvers.kernels import inventory\n"
        "from vibroimpact_solvers.kernels.planted import planted\n"
        "with inventory.announced():\n    print(planted(1.0))\n"
    )
    for line in ("compiling kernels, about 1 s, once\n", ""):
        done = forked(code, places=(tmp_path,))
        assert (done.stdout, done.stderr) == ("2.0\n", line)
