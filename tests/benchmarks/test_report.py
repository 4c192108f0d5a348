"""The pages are drawn from the stored results: goals, failures, commands and plots."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import plots, registry, report, results
from benchmarks.results import Measurement
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
)


AHEAD = Table(
    "Ahead",
    (
        "case",
        "error at most",
        "fastest peer",
        "its time [ms]",
        "prepared [ms]",
        "both prepared, times faster",
        "both from nothing, times faster",
        "whole call over prepared peer, times faster",
    ),
    [
        ("A", "1e-09", "heyoka", 3.0, 1.0, 3.0, 50.0, 1.5),
        ("B", "1e-09", "CVODE", 5.0, 1.0, 5.0, 70.0, 0.5),
        ("B", "1e-12", "CVODE", 0.5, 1.0, 0.5, 7.0, 0.1),
        ("C", "1e-09", "none", None, 1.0, None, None, None),
    ],
)


def stored(part: str, table: Table | None, benchmark: str = "scaling", failure: str = "") -> None:
    when = "2026-01-02T00:00:00Z"
    Measurement(benchmark, part, when, "abc+", MACHINE, table, failure).save()


@pytest.fixture
def docs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Return the folder of the documentation; results are stored beside it."""
    monkeypatch.setattr(results, "FOLDER", tmp_path / "results")
    monkeypatch.setattr(report, "DOCS", tmp_path / "docs")
    folder = tmp_path / "docs"
    (folder / "images" / "benchmarks").mkdir(parents=True)
    return folder


@pytest.fixture
def pages(docs: Path) -> tuple[str, str]:
    """Return the first page, and that of a benchmark with two tables and a failure."""
    (docs / "images" / "benchmarks" / "gone.png").write_bytes(b"")
    stored("size", PRECISION)
    stored("modes", GROWTH)
    stored("memory", None, failure="RuntimeError: gone")
    first = report.draw().read_text(encoding="utf-8")
    return first, (docs / "benchmarks" / "scaling.md").read_text(encoding="utf-8")


def test_the_first_page_counts_goals_and_the_others_list_those_missed(
    pages: tuple[str, str],
) -> None:
    first, page = pages
    assert "**1 of 3 goals are reached.** The other 2" in first
    head = page.split("Measured on")[0]
    assert "**1 of 3 goals are reached.**" in head
    assert "the cache is full" in head
    assert "](#modes): exponent of N<br>not known yet" in head  # fitted to 1, 10 and 100 seconds


def test_the_first_page_says_how_fast_against_what_at_which_error(docs: Path) -> None:
    stored("ahead", AHEAD, "peers")
    first = report.draw().read_text(encoding="utf-8")
    head = " ".join(first.split("## Details")[0].split())
    assert "error of at most 1e-9" in head
    assert "3 to 5 times as fast (median 4)" in head
    assert "50 to 70 times as fast (median 60)" in head
    assert "faster in 1 of 3 comparisons of prepared programs" in head
    assert "| A | heyoka | 3 | 1 | 3 | 50 | 1.5 |" in head
    assert "none" not in head


def test_goals_missed_for_one_reason_share_a_row(docs: Path) -> None:
    rows = [(10, 3.0, 2.0), (100, 10.0, 5.0), (1000, 1.0, 2.0)]
    stored("modes", replace(GROWTH, rows=rows, trends=(), reasons={"": "no vectors"}))
    report.draw()
    page = (docs / "benchmarks" / "scaling.md").read_text(encoding="utf-8")
    (row,) = [line for line in page.replace("\u00a0", " ").split("\n") if "no vectors" in line]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[1:] == ["N 10<br>N 100", "3<br>10", "≤ 2<br>≤ 5"]


def test_every_benchmark_is_named_and_what_never_ran_is_said(pages: tuple[str, str]) -> None:
    first, _ = pages
    for one in registry.BENCHMARKS:
        assert one.title in first
    assert first.count("not run yet") == len(registry.BENCHMARKS) - 1


def test_failures_are_said(pages: tuple[str, str]) -> None:
    first, page = pages
    assert "failed: memory" in first
    assert "`scaling.memory` failed" in page
    assert "RuntimeError: gone" in page


def test_tables_name_their_command_and_surroundings(pages: tuple[str, str]) -> None:
    _, page = pages
    assert "`vibroimpact bench scaling.size`" in page
    assert "abc with changes" in page
    assert "numpy 2.4" in page


def test_links_lead_to_places_on_the_page(pages: tuple[str, str]) -> None:
    first, page = pages
    anchors = set(re.findall(r"\{ #(\S+) \}", page))
    links = set(re.findall(r"\]\(#([^)]+)\)", page))
    assert links
    assert links <= anchors
    assert set(re.findall(r"\]\((benchmarks/[^)]+)\)", first)) == {"benchmarks/scaling.md"}


def test_pictures_are_there_and_old_ones_are_gone(pages: tuple[str, str], docs: Path) -> None:
    shown = set(re.findall(r"\(\.\./(images/benchmarks/[^)]+)\)", pages[1]))
    drawn = {str(path.relative_to(docs)) for path in docs.glob("images/benchmarks/*")}
    assert shown == drawn
    assert len(drawn) == 2


def test_the_committed_pages_are_those_of_the_stored_results(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    committed = report.DOCS
    monkeypatch.setattr(report, "DOCS", tmp_path)
    report.draw()
    stored = [
        one.name
        for one in registry.BENCHMARKS
        if any(results.load(one.name, part.name) for part in one.parts)
    ]
    assert stored
    names = ["benchmarks.md", *(f"benchmarks/{name}.md" for name in stored)]
    pages = {path.name for path in (committed / "benchmarks").iterdir()}
    assert pages == {f"{name}.md" for name in stored}
    for name in names:
        drawn = (tmp_path / name).read_text(encoding="utf-8")
        assert (committed / name).read_text(encoding="utf-8") == drawn, name
    plots = {path.name for path in (tmp_path / "images" / "benchmarks").iterdir()}
    assert plots == {path.name for path in (committed / "images" / "benchmarks").iterdir()}


def test_pictures_follow_light_and_dark_mode(pages: tuple[str, str], docs: Path) -> None:
    for path in (docs / "images" / "benchmarks").iterdir():
        text = path.read_text(encoding="utf-8")
        ET.fromstring(text)
        assert "prefers-color-scheme: dark" in text
        assert "var(--ink)" in text
        # Nothing but the definition of the light mode has ink of its own.
        assert text.count(plots._INK) == 1


def test_pictures_name_curves_and_exponents(pages: tuple[str, str], docs: Path) -> None:
    folder = docs / "images" / "benchmarks"
    precision = (folder / "scaling-size-0.svg").read_text(encoding="utf-8")
    for word in ("Vibroimpact", "scipy DOP853", "heyoka", "no number", "less is better"):
        assert word in precision
    growth = (folder / "scaling-modes-0.svg").read_text(encoding="utf-8")
    assert "exponent 1.00" in growth


def test_the_same_results_give_the_same_pages_and_pictures(
    pages: tuple[str, str], docs: Path
) -> None:
    before = {path: path.read_bytes() for path in docs.rglob("*") if path.is_file()}
    report.draw()
    assert {path: path.read_bytes() for path in docs.rglob("*") if path.is_file()} == before


def test_peers_keep_their_colour_and_ours_stands_out() -> None:
    two = Table("Two", ("by", "x", "y"), [("scipy DOP853", 1, 1), ("Vibroimpact", 1, 1)])
    more = Table("More", ("by", "x", "y"), [("heyoka", 1, 1), *two.rows, ("other", 1, 1)])
    plot = Plot("x", "y", by="by")
    small, large = plots._styles(two, plot), plots._styles(more, plot)
    assert small["scipy DOP853"]["color"] == large["scipy DOP853"]["color"]
    assert len({style["color"] for style in large.values()}) == 4
    assert large["Vibroimpact"]["linewidth"] > large["heyoka"]["linewidth"]
