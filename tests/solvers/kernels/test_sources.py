"""What a module's code depends on: its syntax and all it imports, and nothing that readers see."""

from __future__ import annotations

import json
from pathlib import Path

import grimp
import pytest

from vibroimpact_solvers.kernels import cache, sources
from vibroimpact_solvers.kernels.sources import Sources

MODULES = {
    "__init__.py": '"""A package."""\n',
    "values.py": '"""Numbers."""\n\nNUMBER = 1.0\n"""One."""\n',
    "room/__init__.py": "",
    "room/helper.py": (
        '"""A helper."""\n\nfrom p.values import NUMBER\n\n\ndef helper(x):\n'
        '    """Return it."""\n    if x:\n        "a string"\n    return NUMBER + x  # here\n'
    ),
    "room/caller.py": "from p.room import helper\n\n\ndef caller(x):\n    return helper.helper(x)",
    "room/alone.py": "import math\n\n\ndef alone(x):\n    return math.sin(x)\n",
    "room/late.py": (
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from p.room.fields import Some\n"
    ),
    "room/fields.py": "class Some:\n    a: int\n    b: int\n",
    "room/near.py": "from . import alone\nfrom ..values import NUMBER\n",
    "room/whole.py": "import p.room.alone\n",
    "room/within.py": "def f():\n    from p.room.alone import alone\n    return alone\n",
}
ROOM = {
    name.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
    for name in MODULES
    if "room/" in name
}


@pytest.fixture
def package(tmp_path: Path) -> Path:
    for name, text in MODULES.items():
        file = tmp_path / "p" / name
        file.parent.mkdir(exist_ok=True, parents=True)
        file.write_text(text)
    return tmp_path / "p"


def found(package: Path, digests: Path | None = None) -> dict[str, str]:
    names = Sources(package, digests).fingerprints(package / "room")
    return {name.removeprefix("p."): fingerprint for name, fingerprint in names.items()}


def changed(package: Path, file: str, old: str, new: str) -> set[str]:
    """Return the modules with another fingerprint once a text in a file is replaced."""
    before, path = found(package), package / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    after = found(package)
    assert before.keys() == after.keys()
    return {name.removeprefix("room.") for name in before if before[name] != after[name]}


def test_all_modules_of_a_room_have_one(package: Path) -> None:
    names = found(package)
    assert names.keys() == ROOM
    assert all(len(each) == 16 and int(each, 16) >= 0 for each in names.values())


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"""A helper."""', '"""A helper\n\nthat has more to say.\n"""'),
        ('"""A helper."""\n', ""),
        ('    """Return it."""\n', ""),
        ('        "a string"\n', '        "another one"\n'),
        ("# here", "# there"),
        ("\n\n\ndef", "\n# A comment.\n\n\n\n\ndef"),
        ("NUMBER + x", "(\n        NUMBER\n        + x\n    )"),
    ],
)
def test_what_only_readers_see_changes_nothing(package: Path, old: str, new: str) -> None:
    assert changed(package, "room/helper.py", old, new) == set()


@pytest.mark.parametrize(
    ("file", "old", "new", "expected"),
    [
        ("room/helper.py", "NUMBER + x", "NUMBER - x", {"helper", "caller"}),
        ("room/helper.py", "return NUMBER", "return -NUMBER", {"helper", "caller"}),
        ("values.py", "1.0", "1.5", {"helper", "caller", "near"}),
        ("values.py", "1.0", "1", {"helper", "caller", "near"}),
        ("room/caller.py", "helper.helper(x)", "2 * helper.helper(x)", {"caller"}),
        # A kernel reads the fields of what it imports for its annotations alone.
        ("room/fields.py", "a: int\n    b: int", "b: int\n    a: int", {"fields", "late"}),
        ("room/alone.py", "math.sin", "math.cos", {"alone", "near", "whole", "within"}),
        # Whatever is imported from a package may be made in its first module.
        ("room/__init__.py", "", "helper = None", {"room", "caller", "near", "whole"}),
    ],
)
def test_a_change_reaches_the_modules_that_import_it(
    package: Path, file: str, old: str, new: str, expected: set[str]
) -> None:
    assert changed(package, file, old, new) == expected


def test_a_module_that_takes_the_place_of_another_counts(package: Path) -> None:
    before = found(package)
    (package / "room" / "helper").mkdir()
    (package / "room" / "helper" / "__init__.py").write_text("helper = abs")
    after = found(package)
    assert before["room.caller"] != after["room.caller"]


def test_the_same_sources_in_another_place_have_the_same_fingerprints(package: Path) -> None:
    before = found(package)
    elsewhere = package.parent / "elsewhere" / "p"
    elsewhere.parent.mkdir()
    package.rename(elsewhere)
    assert found(elsewhere) == before


def test_what_is_kept_is_what_would_be_found(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All are parsed once; then none, until one changes; and never what another reader saw."""
    parsed: list[str] = []
    parse = sources.parse

    def counted(content: bytes, place: str) -> sources.Source:
        parsed.append(place)
        return parse(content, place)

    monkeypatch.setattr(sources, "parse", counted)
    digests = tmp_path / "digests.json"
    first = found(package, digests)
    assert len(parsed) == len(MODULES)
    assert found(package, digests) == first == found(package)
    parsed.clear()
    assert found(package, digests) == first
    assert parsed == []
    helper = package / "room" / "helper.py"
    helper.write_text(helper.read_text() + "\nMORE = 1\n")
    assert found(package, digests)["room.caller"] != first["room.caller"]
    assert parsed == ["p.room"]
    parsed.clear()
    document = json.loads(digests.read_text())
    digests.write_text(json.dumps(document | {"by": "another version"}))
    found(package, digests)
    assert len(parsed) == len(MODULES)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"by": 1}', b"\xff", b'{"modules": {}}'])
def test_a_damaged_file_is_written_anew(package: Path, tmp_path: Path, content: bytes) -> None:
    digests = tmp_path / "digests.json"
    digests.write_bytes(content)
    assert found(package, digests) == found(package)
    assert len(json.loads(digests.read_text())["modules"]) == len(MODULES)


def test_digests_that_cannot_be_kept_are_found_anew(package: Path, tmp_path: Path) -> None:
    nowhere = tmp_path / "no" / "such" / "folder.json"
    assert found(package, nowhere) == found(package)
    assert not nowhere.parent.exists()


def test_the_file_of_digests_does_not_grow_without_end(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sources, "_MOST_KEPT", len(MODULES) + 1)
    digests = tmp_path / "digests.json"
    for number in range(4):
        (package / "values.py").write_text(f"NUMBER = {number}")
        found(package, digests)
        assert len(json.loads(digests.read_text())["modules"]) <= len(MODULES) + 1


def test_no_import_of_the_kernels_is_overlooked() -> None:
    """As another program finds imports: in all statements, wherever they stand."""
    graph = grimp.build_graph("vibroimpact_solvers", cache_dir=None)
    package = cache.KERNELS.parent
    read = Sources(package)
    names = read.fingerprints(cache.KERNELS)
    assert len(names) > 30
    packages = {"vibroimpact_solvers", "vibroimpact_solvers.kernels"}
    for name in names.keys() - packages:
        assert read.needed(name) - packages == {name, *graph.find_upstream_modules(name)} - packages
