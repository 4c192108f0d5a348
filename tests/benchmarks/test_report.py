"""The page is drawn from what was kept: goals, failures, commands and pictures."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import history, plots, registry, report
from benchmarks.history import Failure, Run
from benchmarks.tables import Goal, Plot, Table, Trend

MACHINE = {
    "processor": "Some",
    "cores": 2,
    "vectors": "avx2",
    "system": "Linux 6",
    "python": "3.11.7",
    "packages": {"numpy": "2.4"},
    "load": None,
}
PRECISION = Table(
    "Run time against error",
    ("case", "method", "time [s]", "error"),
    [
        (case, name, t, e)
        for case in ("A", "B")
        for name, t, e in (
            ("Vibroimpact", 1e-3, 1e-15),
            ("scipy DOP853", 1e-2, 1e-6),
            ("scipy DOP853", 1e-1, 1e-9),
            ("heyoka", 1e-3, math.nan),
        )
    ]
    * 2,
    plots=(Plot("time [s]", "error", by="method", panel="case"),),
    about="Compare.",
    part="precision",
    seconds=3.0,
)
GROWTH = Table(
    "Growth",
    ("N", "time [s]", "goal [s]"),
    [(10, 1.0, 2.0), (100, 10.0, 5.0), (1000, 100.0, None)],
    goal=Goal("time [s]", "goal [s]"),
    plots=(Plot("N", "time [s]"),),
    trends=(Trend("N", "time [s]", 0.5),),
    reasons={"N 100": "the cache is full"},
    part="growth",
)


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> str:
    monkeypatch.setattr(history, "FOLDER", tmp_path / "results")
    monkeypatch.setattr(report, "DOCS", tmp_path / "docs")
    first = Run("scaling", "2026-01-01T00:00:00Z", "abc+", MACHINE, (PRECISION, GROWTH))
    broken = (Failure("memory", "RuntimeError: gone"),)
    for run in (first, replace(first, when="2026-01-02T00:00:00Z", failures=broken)):
        history.save(run)
    (tmp_path / "docs" / "images" / "benchmarks").mkdir(parents=True)
    (tmp_path / "docs" / "images" / "benchmarks" / "gone.png").write_bytes(b"")
    return report.draw().read_text(encoding="utf-8")


def test_the_first_lines_say_what_is_reached_and_what_is_not(page: str) -> None:
    assert "**1 of 3 goals are reached.**" in page
    head = page.split("## How to read it")[0]
    assert "the cache is full" in head
    assert (
        "](#scaling-growth): exponent of N<br>not known yet" in head
    )  # fitted to 1, 10 and 100 seconds


def test_goals_missed_for_one_reason_share_a_row(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    rows = [(10, 3.0, 2.0), (100, 10.0, 5.0), (1000, 1.0, 2.0)]
    slow = replace(GROWTH, rows=rows, trends=(), reasons={"": "no vectors"})
    monkeypatch.setattr(history, "FOLDER", tmp_path / "results")
    monkeypatch.setattr(report, "DOCS", tmp_path / "docs")
    history.save(Run("scaling", "2026-01-01T00:00:00Z", "abc", MACHINE, (slow,)))
    (row,) = [
        line
        for line in report.draw().read_text(encoding="utf-8").replace("\u00a0", " ").split("\n")
        if "no vectors" in line
    ]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[1:] == ["N 10<br>N 100", "3<br>10", "≤ 2<br>≤ 5"]


def test_every_benchmark_is_named_and_what_never_ran_is_said(page: str) -> None:
    head = page.split("## How to read it")[0]
    for one in registry.BENCHMARKS:
        assert report.title(one.name) in head
    assert head.count("not run yet") == len(registry.BENCHMARKS) - 1


def test_failures_are_said(page: str) -> None:
    assert "1 table failed" in page
    assert "`scaling.memory` failed in this run" in page
    assert "RuntimeError: gone" in page


def test_tables_name_their_command_and_surroundings(page: str) -> None:
    assert "`vibroimpact bench scaling.precision`" in page
    assert "abc with changes" in page
    assert "numpy 2.4" in page


def test_links_lead_to_places_on_the_page(page: str) -> None:
    anchors = set(re.findall(r"\{ #(\S+) \}", page))
    anchors |= {
        line[3:].lower().replace(" ", "-") for line in page.split("\n") if line[:3] == "## "
    }
    links = set(re.findall(r"\]\(#([^)]+)\)", page))
    assert links
    assert links <= anchors


def test_pictures_are_there_and_old_ones_are_gone(page: str, tmp_path: Path) -> None:
    folder = tmp_path / "docs"
    shown = set(re.findall(r"\((images/benchmarks/[^)]+)\)", page))
    drawn = {str(path.relative_to(folder)) for path in folder.glob("images/benchmarks/*")}
    assert shown == drawn
    assert len(drawn) == 3  # two plots and the runs over time


def test_pictures_follow_light_and_dark_mode(page: str, tmp_path: Path) -> None:
    for path in (tmp_path / "docs" / "images" / "benchmarks").iterdir():
        text = path.read_text(encoding="utf-8")
        ET.fromstring(text)
        assert "prefers-color-scheme: dark" in text
        assert "var(--ink)" in text
        # Nothing but the definition of the light mode has ink of its own.
        assert text.count(plots._INK) == 1


def test_pictures_name_curves_and_exponents(page: str, tmp_path: Path) -> None:
    folder = tmp_path / "docs" / "images" / "benchmarks"
    precision = (folder / "scaling-precision-0.svg").read_text(encoding="utf-8")
    for word in ("Vibroimpact", "scipy DOP853", "heyoka", "no number", "less is better"):
        assert word in precision
    growth = (folder / "scaling-growth-0.svg").read_text(encoding="utf-8")
    assert "exponent 1.00" in growth


def test_the_same_results_give_the_same_page_and_pictures(page: str, tmp_path: Path) -> None:
    folder = tmp_path / "docs" / "images" / "benchmarks"
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert report.draw().read_text(encoding="utf-8") == page
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_peers_keep_their_colour_and_ours_stands_out() -> None:
    two = Table("Two", ("by", "x", "y"), [("scipy DOP853", 1, 1), ("Vibroimpact", 1, 1)])
    more = Table("More", ("by", "x", "y"), [("heyoka", 1, 1), *two.rows, ("other", 1, 1)])
    plot = Plot("x", "y", by="by")
    small, large = plots._styles(two, plot), plots._styles(more, plot)
    assert small["scipy DOP853"]["color"] == large["scipy DOP853"]["color"]
    assert len({style["color"] for style in large.values()}) == 4
    assert large["Vibroimpact"]["linewidth"] > large["heyoka"]["linewidth"]
