"""Settings with wrong names, folders that others can read, machines without room."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from vibroimpact_service.operations.checks import environment
from vibroimpact_service.operations.checks.check import Check
from vibroimpact_service.use_case import warming
from vibroimpact_solvers.kernels import cache


def test_names_of_settings() -> None:
    good = ["VIBROIMPACT_PORT", "VIBROIMPACT_URL", "HOME"]
    assert [c.state for c in environment.settings(good)] == ["ok"]
    bad = ["VIBROIMPACT_PROT", "VIBROIMPACT_DRIVEN_JOBS"]
    unknown, renamed = environment.settings(good + bad)
    assert unknown == Check(
        "settings", "warning", "there is no setting VIBROIMPACT_PROT", "correct or remove it"
    )
    assert (renamed.state, renamed.advice) == (
        "warning",
        "call it VIBROIMPACT_RUNNING_JOBS",
    )


def test_the_data_folder(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    assert environment.data_folder(folder).state == "ok"
    assert not folder.exists()
    folder.mkdir(0o700)
    assert environment.data_folder(folder).state == "ok"
    for mode in (0o750, 0o701):
        folder.chmod(mode)
        check = environment.data_folder(folder)
        assert (check.state, check.advice) == ("warning", f"chmod 700 {folder}")
        assert f"({mode:04o})" in check.seen
    folder.rmdir()
    folder.touch()
    assert environment.data_folder(folder).state == "failed"
    assert environment.data_folder(folder / "in a file").state == "failed"


def test_a_data_folder_of_somebody_else(tmp_path: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("only root can take the part of another user")
    place = Path(tempfile.mkdtemp(dir="/tmp"))
    place.chmod(0o755)
    folder = place / "data"
    folder.mkdir(0o555)
    code = (
        "import os, sys; from pathlib import Path;"
        "from vibroimpact_service.operations.checks import environment as e;"
        "os.setgid(65534); os.setuid(65534);"
        "print(e.data_folder(Path(sys.argv[1])).state)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(folder)], capture_output=True, text=True, check=True
    )
    assert done.stdout == "failed\n"
    folder.rmdir()
    place.rmdir()


def test_room_for_temporary_files(monkeypatch: pytest.MonkeyPatch) -> None:
    assert environment.temporary_room(1).state == "ok"
    check = environment.temporary_room(2**60)
    assert check.state == "warning"
    assert "1152921504.6 GB" in check.advice
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(tempfile, "_candidate_tempdir_list", lambda: ["/proc/no-such-folder"])
    assert environment.temporary_room(1).state == "failed"


def test_kernels(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(cache, "folder", lambda *_: tmp_path)
    for step in warming.STEPS:
        warming.note_done(tmp_path, step)
    assert environment.kernels().state == "ok"
    warming.mark_file(tmp_path, "sweep").write_text("0.0.1\n")
    warming.mark_file(tmp_path, "ensemble").unlink()
    check = environment.kernels()
    assert (check.state, check.seen) == ("warning", "not compiled yet: ensemble, sweep")
    monkeypatch.setattr(cache, "folder", lambda *_: None)
    assert environment.kernels().state == "warning"
