"""Tables of benchmarks say whether goals were reached, survive their file and can be read."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from benchmarks import results
from benchmarks.results import Measurement
from benchmarks.tables import Figure, Goal, Plot, Table, Trend, exponent, figures, written
from benchmarks.writing import markdown, text

TABLE = Table(
    "Times",
    ("N", "time [µs]", "goal [µs]"),
    [(13, 0.25, 0.2), (100, 0.3, 0.4), (1000, 2.0, None)],
    "A note.",
    Goal("time [µs]", "goal [µs]"),
    (Plot("N", "time [µs]"),),
    reasons={"N 13": "it is cold"},
)
GROWING = Table(
    "Growth",
    ("method", "N", "time"),
    [(name, n, 3.0 * n**a) for name, a in (("slow", 2.0), ("quick", 1.0)) for n in (1, 10, 100)],
    trends=(
        Trend("N", "time", 1.5, by="method", only=("slow",)),
        Trend("N", "time", 1.5, "method"),
    ),
    reasons={"slow: time": "all pairs"},
)


def outcomes(table: Table) -> list[bool | None]:
    return [None if verdict is None else verdict.reached for verdict in table.judged()]


def test_goals() -> None:
    assert outcomes(TABLE) == [False, True, None]
    faster = Table("Ratio", ("x", "goal"), [(6.0, 5.0), (4.0, 5.0)], "", Goal("x", "goal", True))
    assert outcomes(faster) == [True, False]


def test_a_goal_without_a_number_is_missed() -> None:
    rows = [("a", None, 5.0), ("b", math.nan, 5.0)]
    for at_least in (True, False):
        table = Table("Ratio", ("of", "x", "goal"), rows, "", Goal("x", "goal", at_least))
        assert outcomes(table) == [False, False]


def test_a_missed_goal_has_its_reason_and_a_reached_one_has_none() -> None:
    missed, reached, none = TABLE.judged()
    assert missed is not None
    assert reached is not None
    assert none is None
    assert (missed.label, missed.value, missed.limit) == ("N 13", 0.25, 0.2)
    assert missed.reason == "it is cold"
    assert reached.reason == ""


def test_figures_are_judged_each_by_its_own_sign() -> None:
    table = figures(
        "Some", [Figure("rate", 9.0, 10.0, True), Figure("lag", 9.0, 10.0), Figure("size", 9.0)]
    )
    assert outcomes(table) == [False, True, None]


@pytest.mark.parametrize("power", [-1.0, 0.0, 0.5, 3.0])
def test_exponents_of_power_laws(power: float) -> None:
    assert exponent([(x, 7.0 * x**power) for x in (2.0, 3.0, 50.0)]) == pytest.approx(power)


def test_an_exponent_needs_two_places() -> None:
    assert math.isnan(exponent([(2.0, 1.0), (2.0, 3.0), (5.0, 0.0), (6.0, math.nan)]))


def test_trends() -> None:
    only_slow, slow, quick = GROWING.grown()
    assert only_slow.value == slow.value == pytest.approx(2.0)
    assert not slow.reached
    assert slow.reason == "all pairs"
    assert quick.value == pytest.approx(1.0)
    assert quick.reached


def test_trends_count_what_lies_in_their_range() -> None:
    rows = [(1, 50.0), (10, 10.0), (100, 100.0)]
    trend = Trend("N", "time", 1.1, since=10.0)
    (verdict,) = Table("Growth", ("N", "time"), rows, trends=(trend,)).grown()
    assert verdict.value == pytest.approx(1.0)


def test_labels_tell_rows_apart() -> None:
    assert TABLE.labels() == ["N 13", "N 100", "N 1000"]
    rows = [("a", "x", 1), ("a", "y", 1), ("b", "x", 1)]
    assert Table("Some", ("of", "by", "n"), rows).labels() == ["a, x", "a, y", "b, x"]


def test_rows_must_fit() -> None:
    with pytest.raises(ValueError, match="2 cells in 3 columns"):
        Table("Times", TABLE.columns, [(1, 2.0)])


def test_text_and_markdown_hold_every_number() -> None:
    for shown in (text(TABLE), markdown(TABLE)):
        for number in ("13", "0.25", "0.2", "1000", "missed", "reached"):
            assert number in shown
    assert "it is cold" in text(TABLE)
    assert "2.00" in text(GROWING)


@pytest.mark.parametrize(
    ("cell", "shown"),
    [
        (0.0012345, "0.00123"),
        (1.2345e-4, "1.23e-04"),
        (999.7, "1000"),
        (1234.5, "1230"),
        (123456.0, "123\u202f000"),
        (999_999.0, "1.00e+06"),
        (12345, "12\u202f345"),
        (1234, "1234"),
        (None, "–"),
        (math.nan, "–"),
        (math.inf, "inf"),
        (0.0, "0"),
    ],
)
def test_numbers_have_three_digits(cell: float | None, shown: str) -> None:
    assert written(cell) == shown


def test_markdown_writes_powers_of_ten_and_repeats_no_words() -> None:
    table = Table("Errors", ("of", "by", "error"), [("a|b", "x", 1.5e-12), ("a|b", "y", 2e9)])
    assert markdown(table).splitlines() == [
        "| of | by | error |",
        "|:---|:---|---:|",
        "| a\\|b | x | 1.50·10⁻¹² |",
        "|  | y | 2.00·10⁹ |",
    ]


def test_a_table_has_one_file_with_its_newest_measurement(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(results, "FOLDER", tmp_path)
    Measurement.now("scaling", "size", TABLE).save()
    path = Measurement.now("scaling", "size", GROWING).save()
    assert path == tmp_path / "scaling" / "size.json"
    assert json.loads(path.read_text())["machine"]["packages"]["numpy"]
    stored = results.load("scaling", "size")
    assert stored is not None
    assert (stored.table, stored.failure) == (GROWING, "")


def test_a_failure_is_stored_in_place_of_a_table(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(results, "FOLDER", tmp_path)
    assert results.load("scaling", "size") is None
    Measurement.now("scaling", "size", "RuntimeError: gone").save()
    stored = results.load("scaling", "size")
    assert stored is not None
    assert (stored.table, stored.failure) == (None, "RuntimeError: gone")
