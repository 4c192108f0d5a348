"""Benchmarks run unattended: progress is said, failures hinder nothing and are kept."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks import command, history, limits, registry
from benchmarks.tables import Table


def sound() -> Table:
    """Succeed."""
    return Table("Numbers", ("one",), [(1,)])


def broken() -> Table:
    """Fail."""
    raise RuntimeError("a peer is gone")


def slow() -> Table:
    """Take for ever."""
    time.sleep(60.0)
    return sound()


def _only(monkeypatch: pytest.MonkeyPatch, *functions: Callable[[], Table]) -> None:
    monkeypatch.setattr(registry.Benchmark, "functions", lambda self: functions)


def run(save: bool = False, longest: float = 30.0) -> tuple[int, str]:
    said: list[str] = []
    failed = command.run(registry.BENCHMARKS[:1], said.append, save=save, longest=longest)
    return failed, "\n".join(said)


def test_one_that_fails_hinders_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    _only(monkeypatch, broken, sound)
    failed, said = run()
    assert failed == 1
    assert "a peer is gone" in said
    assert "Numbers" in said
    assert "1 of 2 tables" in said


def test_progress_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    _only(monkeypatch, broken, sound)
    _, said = run()
    name = registry.BENCHMARKS[0].name
    assert "[1/2, 0 s]" in said
    assert f"{name}.sound ..." in said


def test_one_that_takes_too_long_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    _only(monkeypatch, slow, sound)
    started = time.monotonic()
    failed, said = run(longest=0.2)
    assert time.monotonic() - started < 20.0
    assert failed == 1
    assert "not done after 0.2 s" in said
    assert "Numbers" in said


def test_failures_are_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(history, "FOLDER", tmp_path)
    drawn: list[bool] = []
    monkeypatch.setattr(command, "draw", lambda: drawn.append(True))
    _only(monkeypatch, broken, sound)
    run(save=True)
    (kept,) = history.runs(registry.BENCHMARKS[0].name)
    assert [failure.part for failure in kept.failures] == ["broken"]
    assert "a peer is gone" in kept.failures[0].error
    (table,) = kept.tables
    assert (table.title, table.about, table.part) == ("Numbers", "Succeed.", "sound")
    assert drawn == [True]


def test_one_that_cannot_be_loaded_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(self: registry.Benchmark) -> tuple[Callable[[], Table], ...]:
        raise ImportError("no module named peer")

    monkeypatch.setattr(registry.Benchmark, "functions", missing)
    failed, said = run()
    assert failed == 1
    assert "no module named peer" in said


def test_what_runs_cleans_up_when_the_process_should_end() -> None:
    cleaned: list[bool] = []

    def asked_to_end() -> None:
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(10.0)
        finally:
            cleaned.append(True)

    with pytest.raises(SystemExit), limits.at_most(30.0):
        asked_to_end()
    assert cleaned == [True]
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_one_table_alone() -> None:
    (found,) = command.chosen(["guard.kernels"])
    assert [function.__name__ for function in found.functions()] == ["kernels"]


@pytest.mark.parametrize(
    ("name", "near"),
    [("scalling", "scaling"), ("guard.kernel", "guard.kernels"), ("zzz", "impact-modes")],
)
def test_unknown_names_are_told_what_comes_near(name: str, near: str) -> None:
    with pytest.raises(registry.UnknownNameError, match=f"called {name}.*{near}"):
        command.chosen([name])


def test_a_table_alone_is_not_kept() -> None:
    with pytest.raises(ValueError, match="kept whole"):
        command.chosen(["guard.kernels"], save=True)
