"""Certificates that are missing, mixed up, expired or about to expire."""

from __future__ import annotations

import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from vibroimpact_service.jobs import certificates as files
from vibroimpact_service.operations.checks.certificates import certificates
from vibroimpact_service.settings import Settings


def settings(folder: Path) -> Settings:
    names = {f"tls_{role.lower()}": folder / file for role, file in files.FILES.items()}
    return Settings(scheduler="tls://127.0.0.1:1", **names)  # type: ignore[arg-type]


def written(folder: Path, days: int = 400) -> Path:
    files.write(folder, days)
    return folder


def state(chosen: Settings) -> tuple[str, str]:
    (check,) = certificates(chosen)
    assert (check.advice == "") is (check.state == "ok")
    return check.state, check.seen


def test_sound_ones(tmp_path: Path) -> None:
    end = datetime.now(UTC) + timedelta(days=400)
    assert state(settings(written(tmp_path))) == ("ok", f"valid until {end:%Y-%m-%d}")
    assert certificates(Settings()) == []


@pytest.mark.parametrize(("days", "expected"), [(29, "warning"), (32, "ok")])
def test_they_end_soon(tmp_path: Path, days: int, expected: str) -> None:
    assert state(settings(written(tmp_path, days)))[0] == expected


@pytest.mark.parametrize(("shift", "said"), [(-500, "expired on"), (2, "not valid before")])
def test_they_are_not_valid_now(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shift: int, said: str
) -> None:
    class Shifted(datetime):
        @classmethod
        def now(cls, tz: Any = None) -> Any:
            return datetime.now(tz) + timedelta(days=shift)

    with monkeypatch.context() as patch:  # while they are made
        patch.setattr(files, "datetime", Shifted)
        written(tmp_path)
    outcome = state(settings(tmp_path))
    assert outcome[0] == "failed"
    assert said in outcome[1]


@pytest.mark.parametrize(
    ("mixed", "said"),
    [("key.pem", "is not the key of"), ("ca.pem", "did not sign"), ("cert.pem", "not the key")],
)
def test_files_of_two_sets(tmp_path: Path, mixed: str, said: str) -> None:
    ours, theirs = written(tmp_path / "ours"), written(tmp_path / "theirs")
    shutil.copy(theirs / mixed, ours / mixed)
    outcome = state(settings(ours))
    assert outcome[0] == "failed"
    assert said in outcome[1]


@pytest.mark.parametrize("file", files.FILES.values())
def test_files_that_are_missing_or_damaged(tmp_path: Path, file: str) -> None:
    chosen = settings(written(tmp_path))
    (tmp_path / file).write_text("-----BEGIN")
    assert state(chosen)[0] == "failed"
    assert "damaged" in state(chosen)[1]
    (tmp_path / file).unlink()
    assert state(chosen) == ("failed", f"{tmp_path / file}: No such file or directory")


def test_not_all_are_named(tmp_path: Path) -> None:
    outcome = state(Settings(tls_ca=written(tmp_path) / "ca.pem"))
    assert outcome == ("failed", "VIBROIMPACT_TLS_CA, _TLS_CERT and _TLS_KEY are not all set")
    assert state(Settings(scheduler="tls://127.0.0.1:1"))[0] == "failed"


def test_a_key_that_others_can_read(tmp_path: Path) -> None:
    chosen = settings(written(tmp_path))
    (tmp_path / "key.pem").chmod(0o644)
    dates, permissions = certificates(chosen)
    assert (dates.state, permissions.state) == ("ok", "warning")
    assert permissions.advice == f"chmod 600 {tmp_path / 'key.pem'}"
