"""The client needs neither the solvers' libraries nor the server's."""

from __future__ import annotations

import subprocess
import sys

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


def test_help_loads_no_drawing_library() -> None:
    code = (
        "import vibroimpact.cli; print([m for m in ('matplotlib', 'xarray') if m in sys.modules])"
    )
    assert _run(code).stdout.strip() == "[]"
