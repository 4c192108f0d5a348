"""The client needs neither the solvers' libraries nor the server's."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]

_BLOCKED = """
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        first = name.partition('.')[0]
        if first in {'numba', 'scipy', 'fastapi', 'distributed', 'dask', 'sqlalchemy',
                     'vibroimpact_service', 'vibroimpact_solvers'}:
            raise ImportError(name)

sys.meta_path.insert(0, Blocker())
"""


def _run(code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", _BLOCKED + code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_the_client_imports_alone() -> None:
    done = _run("import vibroimpact, vibroimpact.cli, vibroimpact.demo, vibroimpact.progress")
    assert done.returncode == 0, done.stderr


def test_the_server_command_says_what_it_needs() -> None:
    done = _run("import vibroimpact.cli; vibroimpact.cli.main()", "serve")
    assert done.returncode != 0
    assert "pip install" in done.stderr


def test_without_its_library_the_command_line_says_what_to_install() -> None:
    code = "import sys; sys.modules['typer'] = None; import vibroimpact.cli; vibroimpact.cli.main()"
    done = _run(code, "--help")
    assert done.returncode == 1
    assert done.stderr == "The command line needs:  pip install 'vibroimpact[cli]'\n"


def test_without_their_libraries_plots_and_datasets_say_what_to_install() -> None:
    code = """
sys.modules.update(dict.fromkeys(("matplotlib", "xarray", "pandas")))
from vibroimpact import MissingExtra, style
from vibroimpact.result_file import ResultFile
for call in (style.new_axes, lambda: ResultFile.to_xarray(None)):
    try:
        call()
    except MissingExtra as error:
        print(error)
"""
    said = _run(code).stdout.splitlines()
    assert ["pip install 'vibroimpact[plots]'" in said[0], "vibroimpact[data]'" in said[1]] == [
        True,
        True,
    ]


def test_the_plain_installation_is_the_client_and_small() -> None:
    """At most 12 packages beside numpy and h5py come with it; the import takes 0.4 s."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needed = {Requirement(text).name for text in project["dependencies"]}
    assert project["optional-dependencies"]["client"] == []
    todo, seen = sorted(needed), set(needed)
    while todo:
        for text in metadata.requires(todo.pop()) or ():
            requirement = Requirement(text)
            wanted = requirement.marker is None or requirement.marker.evaluate({"extra": ""})
            name = requirement.name.lower().replace("_", "-")
            if wanted and name not in seen:
                seen.add(name)
                todo.append(name)
    assert len(seen - {"numpy", "h5py"}) <= 12, sorted(seen)


def test_the_import_is_quick() -> None:
    code = """
import time
sys.path.insert(0, sys.argv[1])
from tests.effort import usual

def loading():
    began = time.process_time()
    import vibroimpact
    return time.process_time() - began

print(usual(loading))
"""
    assert any(float(_run(code, str(ROOT)).stdout) <= 0.4 for _ in range(5))


def test_help_loads_no_drawing_library() -> None:
    code = (
        "import vibroimpact.cli; print([m for m in ('matplotlib', 'xarray') if m in sys.modules])"
    )
    assert _run(code).stdout.strip() == "[]"
