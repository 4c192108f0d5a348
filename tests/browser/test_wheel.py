"""What is installed has all of the pages, and the licence of what is not the project's own."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

from vibroimpact import notebook
from vibroimpact_service import console

ROOT = Path(__file__).parents[2]
PAGES = "vibroimpact_service/console/"


def test_a_wheel_has_the_pages_and_the_licence_of_uplot(tmp_path: Path) -> None:
    # A copy, as the build leaves files behind.
    tracked = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True
    )
    for name in tracked.stdout.split("\0"):
        if name and not name.startswith(("tests/", "benchmarks/")) and (ROOT / name).is_file():
            (tmp_path / "source" / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / "source" / name).write_bytes((ROOT / name).read_bytes())
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(tmp_path)]
    subprocess.run([*command, str(tmp_path / "source")], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        for name, content in console.FILES.items():
            assert PAGES + name in names
            if name != "index.html":  # which is completed when it is loaded
                packed = archive.read(PAGES + name)
                program = name.endswith(".js") and not name.startswith("vendor/")
                assert (console.without_comments(packed) if program else packed) == content
        licence = archive.read(PAGES + "vendor/uPlot.LICENSE").decode()
        assert "MIT License" in licence
        assert "Leon Sorokin" in licence
        archive.extractall(tmp_path / "installed")
    program = "from vibroimpact import notebook; print(notebook.__file__, len(notebook.module()))"
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": str(tmp_path / "installed")},
        cwd=tmp_path,
        capture_output=True,
        check=True,
        text=True,
    )
    place, size = done.stdout.split()
    assert Path(place).is_relative_to(tmp_path / "installed")
    assert int(size) == len(notebook.module())
