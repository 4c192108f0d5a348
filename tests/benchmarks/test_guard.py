"""The guard fails where a hot kernel does half as much again, and nowhere else."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import guard, hot, instructions, usual

USUAL = usual.load("instructions")


def test_every_hot_kernel_has_its_usual_values() -> None:
    assert set(USUAL) == set(hot.HOT)
    assert set(usual.load("times")) == set(hot.HOT)


@pytest.mark.parametrize("what", ["instructions", "times"])
def test_half_as_much_again_fails(what: str) -> None:
    known = usual.load(what)
    margin = {"instructions": instructions.MARGIN, "times": guard.MARGIN}[what]
    for name, ratio in known.items():
        found = {**known, name: 1.5 * ratio}
        bad = [verdict.name for verdict in usual.compared(found, known, margin) if not verdict.good]
        assert bad == [name]


def test_what_varies_between_runs_does_not_fail(capsys: pytest.CaptureFixture[str]) -> None:
    found = {name: 1.1 * ratio for name, ratio in USUAL.items()}
    assert usual.told(usual.compared(found, USUAL, instructions.MARGIN)) == 0
    assert "too slow" not in capsys.readouterr().out


@pytest.mark.parametrize(("found", "known"), [({}, {"one": 1.0}), ({"one": 1.0}, {})])
def test_a_kernel_that_one_side_does_not_know_fails(
    found: dict[str, float], known: dict[str, float]
) -> None:
    assert usual.told(usual.compared(found, known, 1.25)) == 1


def test_usual_values_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usual, "_FILE", tmp_path / "usual.json")
    usual.save("times", {"one": 0.123456})
    usual.save("instructions", {"one": 2.0})
    assert usual.load("times") == {"one": 0.1235}
    assert usual.load("instructions") == {"one": 2.0}


def test_calls_are_recorded_as_solvers_make_them() -> None:
    one = hot.HOT["members of two constraints"]()
    assert (one.module, one.function) == ("vibroimpact_solvers.kernels.families", "members")
    before = [a.copy() for a in one.arguments if hasattr(a, "copy")]
    one()  # writes into copies alone
    after = [a for a in one.arguments if hasattr(a, "copy")]
    # What is only written to may hold anything.
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(before, after, strict=True))


@pytest.mark.valgrind
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is not installed")
def test_instructions_of_a_kernel_that_does_its_work_one_and_a_half_times(tmp_path: Path) -> None:
    waves = replace(hot.HOT["triangle and square waves"](), calls=2)
    works = {"usual": waves, "again": waves, "slow": replace(waves, calls=3)}
    found = instructions.counts(works, tmp_path)
    # What the interpreter does around the kernel differs by some ten thousand instructions.
    assert found["again"] == pytest.approx(found["usual"], rel=0.02)
    assert found["slow"] == pytest.approx(1.5 * found["usual"], rel=0.02)
    known = {"waves": float(found["usual"])}
    for name, bad in (("again", 0), ("slow", 1)):
        now = {"waves": float(found[name])}
        assert usual.told(usual.compared(now, known, instructions.MARGIN)) == bad
