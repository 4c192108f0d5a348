"""The guard fails where a hot kernel does half as much again, and nowhere else."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import guard, hot
from benchmarks.guard import OTHER_VERSIONS, TOLERANCE, Checkout, compared

USUAL, _ = guard.usual()


def test_every_watched_kernel_has_its_usual_count() -> None:
    assert set(USUAL) == set(hot.HOT)


@pytest.mark.parametrize("tolerance", [TOLERANCE, OTHER_VERSIONS])
def test_more_than_the_tolerance_fails(tolerance: float) -> None:
    for name, count in USUAL.items():
        counted = {**USUAL, name: round(1.01 * tolerance * count)}
        comparisons = compared(counted, USUAL, tolerance)
        assert [one.name for one in comparisons if not one.good] == [name]


def test_three_percent_are_reported_by_name() -> None:
    assert TOLERANCE <= 1.03
    (bad,) = compared({"one": 1040}, {"one": 1000})
    assert str(bad) == "one: 1,040 instructions, 1.0400 times the usual, too many: at most 1.03"


def test_what_varies_between_runs_does_not_fail() -> None:
    counted = {name: round(1.005 * count) for name, count in USUAL.items()}
    assert all(one.good for one in compared(counted, USUAL))


@pytest.mark.parametrize(("counted", "known"), [({}, {"one": 1}), ({"one": 1}, {})])
def test_a_kernel_that_one_side_does_not_know_fails(
    counted: dict[str, int], known: dict[str, int]
) -> None:
    assert not any(one.good for one in compared(counted, known))


def test_usual_counts_are_stored_with_their_versions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard, "USUAL", tmp_path / "usual.json")
    guard.store({"one": 123})
    assert guard.usual() == ({"one": 123}, TOLERANCE)
    monkeypatch.setattr(guard, "versions", lambda: {"numba": "other"})
    assert guard.usual() == ({"one": 123}, OTHER_VERSIONS)


def test_without_valgrind_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr("sys.argv", ["guard"])
    assert guard.main() == 2
    assert "apt install valgrind" in capsys.readouterr().err


def test_calls_are_recorded_as_solvers_make_them() -> None:
    one = hot.HOT["motion of two constraints"]()
    assert (one.module, one.function) == ("vibroimpact_solvers.kernels.families", "solutions")
    before = [a.copy() for a in one.arguments if hasattr(a, "copy")]
    one()  # writes into copies alone
    after = [a for a in one.arguments if hasattr(a, "copy")]
    # What is only written to may hold anything.
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(before, after, strict=True))


def test_the_same_calls_are_recorded_each_time() -> None:
    """Two threads would make their calls in any order."""
    for name in ("existence bands", "certified path check"):
        calls = [hot.HOT[name]() for _ in range(5)]
        for one in calls[1:]:
            pairs = zip(one.arguments, calls[0].arguments, strict=True)
            assert all(np.array_equal(a, b) for a, b in pairs if isinstance(a, np.ndarray | float))


@pytest.mark.valgrind
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is not installed")
def test_instructions_of_a_kernel_that_does_its_work_one_and_a_half_times(tmp_path: Path) -> None:
    waves = replace(hot.HOT["responses to triangle waves"](), calls=2)
    works = {"usual": waves, "again": waves, "slow": replace(waves, calls=3)}
    counted = Checkout().works(works, tmp_path)
    # What the interpreter does around the kernel differs by some ten thousand instructions.
    assert counted["again"] == pytest.approx(counted["usual"], rel=0.02)
    assert counted["slow"] == pytest.approx(1.5 * counted["usual"], rel=0.02)
    known = {"waves": counted["usual"]}
    for name, good in (("again", True), ("slow", False)):
        (one,) = compared({"waves": counted[name]}, known)
        assert one.good is good
