"""Benchmarks run unattended: progress is said, failures hinder nothing and are kept."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from benchmarks import command, harness, registry, results
from benchmarks.registry import Part
from benchmarks.tables import Table


def sound() -> Table:
    """Succeed."""
    return Table("Numbers", ("one",), [(1,)])


def broken() -> Table:
    """Fail."""
    raise RuntimeError("a peer is gone")


def slow() -> Table:
    """Take for ever."""
    time.sleep(3600.0)
    return sound()


def run(*names: str, save: bool = False, longest: float = 30.0) -> tuple[int, str]:
    """Run functions of this module as tables of a benchmark."""
    said: list[str] = []
    parts = [Part("scaling", f"{__name__}.{name}") for name in names]
    failed = command.run(parts, said.append, save=save, longest=longest)
    return failed, "\n".join(said)


def test_one_that_fails_hinders_no_other() -> None:
    failed, said = run("broken", "sound")
    assert failed == 1
    assert "a peer is gone" in said
    assert "Numbers" in said
    assert "1 of 2 tables" in said


def test_progress_is_said() -> None:
    _, said = run("broken", "sound")
    assert "[1/2, 0 s]" in said
    assert "scaling.sound ..." in said


def test_one_that_takes_too_long_is_given_up() -> None:
    failed, said = run("slow", "sound", longest=0.2)
    assert failed == 1
    assert "not done after 0.2 s" in said
    assert "Numbers" in said


def test_tables_and_failures_are_stored(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(results, "FOLDER", tmp_path)
    drawn: list[bool] = []
    monkeypatch.setattr(command, "draw", lambda: drawn.append(True))
    run("broken", "sound", save=True)
    gone, there = (results.load("scaling", name) for name in ("broken", "sound"))
    assert gone is not None
    assert gone.table is None
    assert "a peer is gone" in gone.failure
    assert there is not None
    assert there.table is not None
    assert (there.table.title, there.table.about) == ("Numbers", "Succeed.")
    assert drawn == [True]


def test_one_that_cannot_be_loaded_is_a_failure() -> None:
    part = Part("scaling", "benchmarks.no_such_module.table")
    said: list[str] = []
    assert command.run([part], said.append, save=False) == 1
    assert "no_such_module" in "\n".join(said)


def test_what_runs_cleans_up_when_the_process_should_end() -> None:
    cleaned: list[bool] = []

    def asked_to_end() -> None:
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(10.0)
        finally:
            cleaned.append(True)

    with pytest.raises(SystemExit), harness.at_most(30.0):
        asked_to_end()
    assert cleaned == [True]
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_one_table_alone() -> None:
    (part,) = registry.named(["scaling.memory"])
    assert (part.benchmark, part.name) == ("scaling", "memory")


def test_all_tables_without_names() -> None:
    parts = registry.named([])
    assert {part.benchmark for part in parts} == {one.name for one in registry.BENCHMARKS}
    assert len(set(parts)) == len(parts) == sum(len(one.paths) for one in registry.BENCHMARKS)


@pytest.mark.parametrize(
    ("name", "near"),
    [("scalling", "scaling"), ("bounds.bound", "bounds.bounds"), ("zzz", "peers")],
)
def test_unknown_names_are_told_what_comes_near(name: str, near: str) -> None:
    with pytest.raises(ValueError, match=f"called {name}.*{near}"):
        registry.named([name])
