"""Tables of benchmarks survive their file, and say whether goals were reached."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import harness, history
from benchmarks.tables import Goal, Plot, Table, markdown, text

TABLE = Table(
    "Times",
    ("N", "time [µs]", "goal [µs]"),
    [(13, 0.25, 0.2), (100, 0.3, 0.4), (1000, 2.0, None)],
    "A note.",
    Goal("time [µs]", "goal [µs]"),
    (Plot("N", "time [µs]"),),
)


def test_goals() -> None:
    assert TABLE.verdicts() == ["no", "yes", ""]
    faster = Table("Ratio", ("x", "goal"), [(6.0, 5.0), (4.0, 5.0)], "", Goal("x", "goal", True))
    assert faster.verdicts() == ["yes", "no"]


def test_rows_must_fit() -> None:
    with pytest.raises(ValueError, match="2 cells in 3 columns"):
        Table("Times", TABLE.columns, [(1, 2.0)])


def test_text_and_markdown_hold_every_number() -> None:
    for shown in (text(TABLE), markdown(TABLE)):
        for number in ("13", "0.25", "0.2", "1000", "no", "yes"):
            assert number in shown


def test_runs_are_kept_in_order(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(history, "FOLDER", tmp_path)
    for when in ("2026-01-02T00:00:00Z", "2026-01-01T00:00:00Z"):
        path = history.save(history.Run("times", when, "abc", harness.machine(), (TABLE,)))
        assert json.loads(path.read_text())["machine"]["packages"]["numpy"]
    found = history.runs("times")
    assert [run.when for run in found] == ["2026-01-01T00:00:00Z", "2026-01-02T00:00:00Z"]
    assert found[0].tables == (TABLE,)


def test_functions_take_turns() -> None:
    calls: list[str] = []
    found = harness.measure(
        rounds=3,
        sample=0.0,
        a=lambda: calls.append("a"),
        b=lambda: calls.append("b"),
    )
    assert "".join(calls) == "aabb" + "ab" * 3
    assert len(found["a"].rounds) == 3


def test_ratio_is_taken_round_by_round() -> None:
    slow = harness.Timing(0.0, 0.0, 0.0, (2.0, 20.0, 4.0))
    fast = harness.Timing(0.0, 0.0, 0.0, (1.0, 10.0, 1.0))
    assert harness.ratio(slow, fast) == 2.0
