"""What the page shows of attractors: their sections, their basins, and where these lead."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from playwright.sync_api import Page, expect

from tests.browser.visits import Visit

# Between its two jumps: motions with one impact a period, and motions without any.
SWEPT = {
    "form": "oscillator",
    "damping": 0.05,
    "stops": [{"dof": 0, "lower": None, "upper": 0.5, "restitution": 0.8}],
}
FIELDS: dict[str, Any] = {"Omega": 1.4, "load": [{"dof": 0, "amplitude": 0.25}], "cells": 5}


def _opened(console: Visit, **fields: Any) -> tuple[Page, dict[str, Any]]:
    with console.page.expect_response("**/compute/attractors") as answer:
        page = console.open("attractors", SWEPT, **{**FIELDS, **fields})
    result: dict[str, Any] = answer.value.json()
    expect(page.locator(".readout").first).to_contain_text("25 of 25 motions settle on")
    return page, result


def test_each_attractor_has_a_row_and_a_colour_of_its_own(console: Visit) -> None:
    page, result = _opened(console)
    attractors = result["attractor"]
    assert sorted(attractors["impact_rate"]) == [0.0, 1.0]
    expect(page.locator(".readout").first).to_contain_text("2 attractors")
    rows = page.get_by_role("group", name="Table of attractors").locator("tbody tr")
    expect(rows).to_have_count(2)
    for k in range(2):
        expect(rows.nth(k)).to_contain_text(f"{k}: periodic, as the drive")
        cells = rows.nth(k).locator("td").all_text_contents()
        assert cells[0] == str(attractors["motions"][k])
        assert float(cells[2]) == attractors["impact_rate"][k]
        assert abs(float(cells[4]) / attractors["stability"][k] - 1.0) < 1e-3
    colours = page.locator(".dot-key").evaluate_all(
        "all => all.map(e => getComputedStyle(e).color)"
    )
    assert len(set(colours)) == 2


def test_sections_and_basins_are_those_of_the_answer(console: Visit, tmp_path: Path) -> None:
    page, result = _opened(console)

    def saved(act: str) -> list[list[str]]:
        with page.expect_download() as waited:
            page.get_by_role("button", name=act).click()
        waited.value.save_as(tmp_path / "numbers.csv")
        text = (tmp_path / "numbers.csv").read_text("utf-8-sig")
        rows = [row for row in csv.reader(io.StringIO(text)) if not row[0].startswith("#")]
        return rows[1:]

    basins = saved("Save the basins as CSV")
    assert len(basins) == 25
    counts = [sum(row[1 + k] != "" for row in basins) for k in range(2)]
    assert counts == result["attractor"]["motions"]
    page.get_by_text("Zoom, save, compare, report").click()
    section = saved("Save the numbers as CSV")
    points = {
        (float(row[0]), k, float(row[1 + k])) for row in section for k in range(2) if row[1 + k]
    }
    of = result["section"]
    assert points == {
        (x[0], k, v[0]) for k, x, v in zip(of["attractor"], of["x"], of["v"], strict=True)
    }


def test_a_dot_and_an_attractor_lead_to_their_time_history(console: Visit) -> None:
    page, result = _opened(console)
    with page.expect_request("**/compute/time-history") as asked:
        page.get_by_role("button", name="Time history on attractor 1").click()
    request = asked.value.post_data_json
    assert request["initial"] == {
        "x": result["attractor"]["x"][1],
        "v": result["attractor"]["v"][1],
    }
    assert [(each["frequency"], each["amplitude"]) for each in request["load"]] == [(1.4, 0.25)]
    page, _ = _opened(console, cells=5)
    with page.expect_request("**/compute/time-history") as asked:
        page.locator(".figure .u-over").last.click(position={"x": 5, "y": 5})
    # The upper left corner: the least displacement, and the largest velocity.
    start = asked.value.post_data_json["initial"]
    assert abs(start["x"][0] + 0.5) < 1e-6
    assert start["v"][0] > 0


def test_impacts_are_a_section_too(console: Visit) -> None:
    page, _ = _opened(console)
    with page.expect_response("**/compute/attractors") as answer:
        page.get_by_label("Section", exact=True).select_option("impacts")
    assert "phase" in answer.value.json()["section"]
    expect(page.locator(".figure .curve").first).to_have_attribute(
        "aria-label", re.compile("Section of 2 attractors")
    )


def test_the_driven_response_leads_to_what_its_motions_settle_on(console: Visit) -> None:
    page = console.open("driven", SWEPT, points=60, load=FIELDS["load"], Omega=1.4)
    expect(page.locator(".verdict")).to_contain_text("Admissible")
    page.get_by_role("button", name="What motions settle on here").click()
    expect(page.locator(".readout").first).to_contain_text("motions settle on")
    view, query = urlsplit(page.url).fragment.split("?")
    assert view == "attractors"
    assert re.search(r"\bOmega=1\.[34]", query)  # the computed frequency nearest to it
    assert "amplitude" in query


def test_without_losses_nothing_settles_and_the_page_offers_some(console: Visit) -> None:
    page = console.open("attractors", {"form": "oscillator"}, cells=3)
    expect(page.locator("#message")).to_contain_text("without damping or losses")
    page.get_by_role("button", name="Give it 2 % damping and restitution 0.8").click()
    expect(page.locator(".readout").first).to_contain_text("of 9 motions settle on")
    expect(page.locator("#message")).to_be_empty()


def test_what_would_take_long_is_asked_for(console: Visit) -> None:
    page, _ = _opened(console)
    field = page.get_by_label("periods left out")
    field.fill("900000")
    expect(page.get_by_role("button", name="Compute them")).to_be_visible()
    # Nothing former is shown beside the question.
    expect(page.locator(".dot-key")).to_have_count(0)
    field.fill("100")
    expect(page.locator(".dot-key")).to_have_count(2)
    expect(page.get_by_role("button", name="Compute them")).to_have_count(0)
