"""What `vibroimpact doctor` prints, and its exit code."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from vibroimpact_service.cli import app
from vibroimpact_service.operations import doctor
from vibroimpact_service.operations.checks import environment
from vibroimpact_service.operations.checks.check import failed, ok, warning

NAMES = ["settings", "data folder", "database", "keys", "store", "temporary files", "kernels"]


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["doctor", *arguments])


def test_a_new_installation_is_sound_and_stays_new(tmp_path: Path) -> None:
    data = tmp_path / "data"
    done = run("--data", str(data))
    assert done.exit_code == 0
    heads = [line for line in done.output.splitlines() if not line.startswith(" ")]
    assert [line[9:26].strip() for line in heads] == NAMES
    assert not data.exists()


def test_failures_and_warnings_are_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VIBROIMPACT_PROT", "1")
    warned = run("--data", str(tmp_path), "--json")
    assert warned.exit_code == 0
    monkeypatch.setenv("VIBROIMPACT_HOST", "0.0.0.0")
    done = run("--data", str(tmp_path), "--json")
    assert done.exit_code == 1
    for outcome, fine in ((warned, True), (done, False)):
        content = json.loads(outcome.stdout)
        assert content["ok"] is fine
        states = {check["check"]: check["state"] for check in content["checks"]}
        assert states["settings"] == "warning"
        assert states["keys"] == ("ok" if fine else "failed")
        assert all(set(c) == {"check", "state", "seen", "advice"} for c in content["checks"])


def test_lines_are_aligned() -> None:
    outcomes = [ok("store", "seen"), failed("PostgreSQL", "seen", "do this")]
    first, second, advice = "\n".join(map(doctor.lines, outcomes)).splitlines()
    assert first.index("seen") == second.index("seen") == advice.index("→")
    assert not doctor.any_failed([warning("x", "y", "z"), outcomes[0]])
    assert doctor.any_failed(outcomes)


def test_a_check_that_breaks_does_not_hide_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(environment, "data_folder", lambda _: 1 / 0)
    done = run("--data", str(tmp_path))
    assert done.exit_code == 1
    assert "a check failed: ZeroDivisionError: division by zero" in done.output
    assert "kernels" in done.output


def test_an_invalid_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VIBROIMPACT_PORT", "eight")
    done = run()
    assert done.exit_code == 2
    assert "Invalid setting VIBROIMPACT_PORT" in done.output
