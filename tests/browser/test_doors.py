"""The first minute: zoom, sliders, examples, words, files, comparison, report, hostile input."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Download, Page, expect

from tests.browser.visits import LONG, Visit

OSCILLATOR = {"form": "oscillator", "stops": [{"dof": 0, "lower": 0.5, "upper": 1}]}
DONE = re.compile(r"\d")


def _modes(console: Visit, **fields: Any) -> Page:
    page = console.open("modes", OSCILLATOR, points=200, **fields)
    expect(page.locator(".readout").first).to_contain_text("200 frequencies")
    expect(page.locator(".verdict")).to_contain_text("certified")
    return page


def _check(page: Page) -> None:
    result = Axe().run(page)
    assert result.violations_count == 0, result.generate_report()


def _tools(page: Page) -> None:
    page.get_by_text("Zoom, save, compare, report").click()


def _picture(page: Page) -> str:
    drawn: str = page.locator(".figure canvas").first.evaluate("canvas => canvas.toDataURL()")
    return drawn


def _settled(page: Page) -> str:
    """Return the picture once it stays the same."""
    before = ""
    while (now := _picture(page)) != before:
        before = now
        page.wait_for_timeout(300)
    return before


def _wheel(page: Page, share: float, turns: int, *, shift: bool = False) -> None:
    box = page.locator(".figure .u-over").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
    page.wait_for_timeout(500)  # a page that is being scrolled goes on
    if shift:
        page.keyboard.down("Shift")
    for _ in range(abs(turns)):
        page.mouse.wheel(0, -200 if turns > 0 else 200)
    if shift:
        page.keyboard.up("Shift")


def _range(page: Page) -> tuple[float, float]:
    fields = (page.get_by_label("Ω from"), page.get_by_label("to", exact=True))
    first, last = (float(field.input_value()) for field in fields)
    return first, last


def test_the_wheel_zooms_around_the_pointer_and_the_range_is_computed_anew(console: Visit) -> None:
    page = _modes(console)
    _tools(page)
    again = page.get_by_role("button", name="Compute this range anew")
    expect(again).to_be_hidden()
    low, high = _range(page)
    _wheel(page, 0.75, 3)
    expect(again).to_be_visible()
    again.click()
    expect(page.locator(".readout").first).to_contain_text("200 frequencies")
    now = _range(page)
    # What is under the pointer stays there.
    at = low + 0.75 * (high - low)
    assert low < now[0] < at < now[1] < high
    assert (at - now[0]) / (now[1] - now[0]) == pytest.approx(0.75, abs=0.01)


def test_values_are_zoomed_by_shift_and_by_numbers_and_all_comes_back(console: Visit) -> None:
    page = _modes(console)
    _tools(page)
    whole = _settled(page)
    _wheel(page, 0.5, 2, shift=True)
    zoomed = _settled(page)
    assert zoomed != whole
    page.get_by_role("button", name="Show all of it").click()
    page.mouse.move(0, 0)
    assert _settled(page) == whole
    page.get_by_label("values to").fill("0.5")
    assert _settled(page) != whole
    page.locator(".figure .u-over").dblclick()
    page.get_by_label("values to").fill("")
    page.mouse.move(0, 0)
    # The cursor is an element of its own: a double click moves it, and no picture.
    assert _settled(page) == whole


def test_a_zoomed_curve_is_moved_by_its_axis_and_by_buttons(console: Visit) -> None:
    page = _modes(console)
    _tools(page)
    _wheel(page, 0.5, 4)
    before = _settled(page)
    box = page.locator(".figure .u-over").bounding_box()
    assert box is not None
    middle, axis = box["x"] + box["width"] / 2, box["y"] + box["height"] + 24
    page.mouse.move(middle, axis)
    page.mouse.down()
    page.mouse.move(middle - 120, axis, steps=5)
    page.mouse.up()
    moved = _settled(page)
    assert moved != before
    page.get_by_role("button", name="Move to the left").click()
    assert _settled(page) != moved


def test_logarithmic_axes_have_round_numbers(console: Visit) -> None:
    page = console.open("jobs")
    ticks = page.evaluate(
        """async () => {
          const main = document.querySelector("script[type=module]").src;
          const { linearTicks, logTicks } = await import(new URL("ticks.js", main));
          return [logTicks(0.45, 1.2, 6), logTicks(0.04, 300, 6), logTicks(1e-9, 1e9, 5),
            linearTicks(-0.13, 0.38, 5), logTicks(0.5, 0.52, 5)];
        }"""
    )
    assert ticks[0] == [0.5, 0.6, 0.7, 0.8, 0.9, 1]
    assert ticks[1] == [0.1, 1, 10, 100]
    assert ticks[2] == [1e-8, 1e-4, 1, 1e4, 1e8]
    assert ticks[3] == [0, 0.2]
    assert len(ticks[4]) >= 2


def test_small_motions_have_short_numbers_at_their_axes(console: Visit, tmp_path: Path) -> None:
    structure = {"form": "oscillator", "stops": [{"dof": 0, "lower": 2e-5, "upper": 2e-5}]}
    page = console.open("history", structure, duration=20)
    expect(page.locator(".readout").first).to_contain_text("impacts")
    _tools(page)
    _saved(page, "Save as SVG").save_as(tmp_path / "small.svg")
    root = ET.parse(tmp_path / "small.svg").getroot()
    words = [str(each.text) for each in root.iter("{http://www.w3.org/2000/svg}text")]
    assert "x of coordinate 0, in 10⁻⁶" in words
    assert {"−20", "20"} <= set(words)
    assert not [word for word in words if "e−" in word and not word.startswith("Time history: ")]


def test_curves_are_not_stepped(console: Visit) -> None:
    console.page.add_init_script(
        """window.places = [];
        const { lineTo } = Path2D.prototype;
        Path2D.prototype.lineTo = function (x, y) {
          window.places.push(y); return lineTo.call(this, x, y); };"""
    )
    page = _modes(console)
    whole = page.evaluate("window.places.filter(Number.isInteger).length / window.places.length")
    assert whole < 0.2


def test_springs_do_not_cross_stops(console: Visit) -> None:
    """The lines of a spring have many points; walls are short lines of the colour of stops."""
    console.page.add_init_script(
        """window.strokes = [];
        const { beginPath, moveTo, lineTo, stroke } = CanvasRenderingContext2D.prototype;
        const proto = CanvasRenderingContext2D.prototype;
        proto.beginPath = function () { this.points = []; return beginPath.call(this); };
        for (const [name, call] of [["moveTo", moveTo], ["lineTo", lineTo]]) {
          proto[name] = function (x, y) {
            if (this.points) this.points.push([x, y]); return call.call(this, x, y); };
        }
        proto.stroke = function (...path) {
          if (this.canvas.className === "shape") {
            window.strokes.push({ width: this.lineWidth, points: this.points });
          }
          return stroke.apply(this, path); };"""
    )
    page = _modes(console)
    strokes = page.evaluate("window.strokes")
    springs = [each["points"] for each in strokes if len(each["points"]) > 10]
    walls = [
        each["points"] for each in strokes if each["width"] in (3.5, 5) and len(each["points"]) == 2
    ]
    assert springs
    assert walls
    lowest = max(y for points in springs for _, y in points)
    assert lowest < min(y for points in walls for _, y in points)


def test_sliders_move_the_picture_while_they_are_dragged_and_make_no_job(console: Visit) -> None:
    structure = {"form": "oscillator", "damping": 0.01}
    page = console.open("history", structure, v=3, duration=20)
    expect(page.locator(".readout")).to_contain_text("impacts")
    page.get_by_role("button", name="Pause").click()
    jobs = page.request.get(f"{console.url}/v1/jobs?limit=500").json()["jobs"]
    before = _settled(page)
    said = page.locator(".readout").text_content()
    slider = page.get_by_role("slider", name="Restitution of stop 0")
    box = slider.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] - 8, box["y"] + box["height"] / 2)
    page.mouse.down()
    asked = len(console.asked)
    for step in range(20):
        page.mouse.move(
            box["x"] + box["width"] * (0.95 - 0.025 * step), box["y"] + box["height"] / 2
        )
    # Still dragged.
    expect(page.locator(".readout")).not_to_have_text(str(said))
    assert _settled(page) != before
    sent = [each for each in console.asked[asked:] if "/v1/compute/time-history" in each]
    assert 1 <= len(sent) <= 20
    page.mouse.up()
    field = page.get_by_role("group", name="Stop 0").get_by_label("Restitution", exact=True)
    assert float(field.input_value()) < 0.6
    after = page.request.get(f"{console.url}/v1/jobs?limit=500").json()["jobs"]
    assert len(after) == len(jobs)


def test_gaps_and_damping_have_sliders_too(console: Visit) -> None:
    page = _modes(console)
    page.get_by_role("slider", name="Gaps of stop 0").fill("0.301029995663981")
    group = page.get_by_role("group", name="Stop 0")
    assert float(group.get_by_label("Lower gap").input_value()) == 1.0
    assert float(group.get_by_label("Upper gap").input_value()) == 2.0
    page.get_by_role("slider", name="Damping ratio").fill("0.1")
    expect(page.locator(".cautions")).to_contain_text("damping C is neglected")


@pytest.mark.parametrize("number", range(6))
def test_every_example_shows_an_answer(console: Visit, number: int) -> None:
    page = console.open("modes", OSCILLATOR, points=100)
    expect(page.locator(".readout").first).to_have_text(DONE)
    page.get_by_label("Open an example").select_option(str(number))
    expect(page.locator(".readout").first).not_to_contain_text("100 frequencies")
    expect(page.locator(".readout").first).to_have_text(DONE)
    expect(page.locator("#message")).to_be_empty()
    expect(page.locator("[aria-invalid]")).to_have_count(0)


def test_words_are_explained_where_they_stand(console: Visit) -> None:
    page = _modes(console)
    expect(page.get_by_text("Impact mode: a periodic motion")).to_contain_text(
        "Phantom: a solution"
    )
    page.get_by_role("button", name="What is: Phantom").click()
    note = page.locator(".explained:popover-open")
    expect(note).to_contain_text("a stop would have to pull")
    expect(note.get_by_role("link")).to_have_attribute("href", "/docs#compute_impact_modes")
    _check(page)
    page.keyboard.press("Escape")
    expect(note).to_have_count(0)


@pytest.mark.parametrize(
    ("view", "fields", "said"),
    [
        (
            "modes",
            {"structure": {"form": "chain", "parameters": {"n": 1e9}}},
            "Masses = 1000000000",
        ),
        ("modes", {"structure": {"form": "beam", "parameters": {"elements": -3}}}, "Elements = -3"),
        ("modes", {"structure": {"form": "chain", "parameters": {"n": "x"}}}, "Masses = x"),
        ("modes", {"points": 1e7}, None),
        ("driven", {"points": 1e9}, None),
        ("basins", {"cells": 1e6}, None),
        ("map", {"rows": 1e8}, None),
        ("attractors", {"cells": 1e6}, None),
    ],
)
def test_no_address_hangs_the_page(
    console: Visit, view: str, fields: dict[str, Any], said: str | None
) -> None:
    page = console.open(view, **fields)
    if said is None:
        expect(page.locator("#view [aria-invalid]")).to_have_count(1)
        assert not [each for each in console.asked if f"/v1/compute/{view}" in each]
    else:
        expect(page.locator("#message")).to_contain_text(said)
    assert page.evaluate("1 + 1") == 2
    page.get_by_role("link", name="Jobs").click()
    expect(page.locator("#jobs-title")).to_be_visible()


def test_what_is_typed_hangs_nothing_either(console: Visit) -> None:
    page = console.open("modes", points=100)
    expect(page.locator(".readout").first).to_contain_text("100 frequencies")
    field = page.get_by_label("Masses", exact=True)
    field.fill("1000000000")
    expect(field).to_have_attribute("aria-invalid", "true")
    expect(page.get_by_text("the answer to the former input")).to_be_visible()
    assert page.evaluate("1 + 1") == 2


def _saved(page: Page, name: str) -> Download:
    with page.expect_download() as waited:
        page.get_by_role("button", name=name).click()
    return waited.value


def test_a_curve_is_taken_away_as_picture_and_as_numbers(console: Visit, tmp_path: Path) -> None:
    with console.page.expect_response("**/compute/impact-modes") as answer:
        page = _modes(console)
    grid = answer.value.json()
    _tools(page)
    paths = {}
    for kind, name in (("png", "PNG"), ("svg", "SVG"), ("csv", "numbers as CSV")):
        paths[kind] = tmp_path / f"curve.{kind}"
        _saved(page, f"Save{' as' if kind != 'csv' else ' the'} {name}").save_as(paths[kind])
    assert paths["png"].read_bytes().startswith(b"\x89PNG")
    root = ET.parse(paths["svg"]).getroot()
    words = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
    assert "fundamental frequency Ω" in words
    assert any("Oscillator" in str(word) for word in words)
    caption, head, *rows = paths["csv"].read_text(encoding="utf-8-sig").splitlines()
    assert caption.startswith("# Impact modes: Oscillator")
    assert head.split(",")[0] == "fundamental frequency Ω"
    table = [row.split(",") for row in rows]
    # Every digit of what was computed.
    assert [float(row[0]) for row in table] == grid["frequency"]["Omega"]
    momentum = [
        2 * p[0] / w for p, w in zip(grid["impulse"], grid["frequency"]["omega"], strict=True)
    ]
    for row, value, exists in zip(table, momentum, grid["exists"], strict=True):
        if exists and row[2]:
            assert float(row[2]) == pytest.approx(value, rel=1e-15)


def test_a_map_is_taken_away_as_rows_of_its_plane(console: Visit, tmp_path: Path) -> None:
    page = console.open("map", OSCILLATOR, rows=5, points=20)
    expect(page.locator(".readout")).to_contain_text("points")
    _tools(page)
    path = tmp_path / "map.csv"
    _saved(page, "Save the numbers as CSV").save_as(path)
    _, head, *rows = path.read_text().splitlines()
    assert len(head.split(",")) == 3
    assert len(rows) == 100
    assert np.isfinite([float(row.split(",")[0]) for row in rows]).all()
    _saved(page, "Save as SVG").save_as(tmp_path / "map.svg")
    assert "<image" in (tmp_path / "map.svg").read_text()


def test_a_curve_is_kept_beside_the_next_one(console: Visit) -> None:
    page = _modes(console)
    _tools(page)
    page.get_by_role("button", name="Keep this beside the next one").click()
    kept = page.locator("figure.kept")
    expect(kept).to_contain_text("Oscillator, frequency Ω₀ 1")
    page.get_by_label("Frequency Ω₀", exact=True).fill("2")
    expect(page.locator(".readout").first).to_have_text(DONE)
    sides = [page.locator(each).bounding_box() for each in ("figure.kept", ".figure")]
    assert sides[0] is not None
    assert sides[1] is not None
    assert sides[0]["x"] + sides[0]["width"] <= sides[1]["x"]
    expect(kept).to_contain_text("frequency Ω₀ 1")
    _check(page)
    page.get_by_role("button", name="Remove the kept curve 1").click()
    expect(kept).to_have_count(0)


@pytest.mark.parametrize(
    ("view", "fields"),
    [
        ("modes", {"points": 100}), ("driven", {"points": 60}), ("history", {"duration": 10}),
        ("basins", {"cells": 5, "t_end": 5}), ("map", {"rows": 5, "points": 20}),
        ("attractors", {"cells": 3}),
    ],
)  # fmt: skip
def test_a_report_has_structure_request_results_errors_and_digest(
    console: Visit, view: str, fields: dict[str, Any]
) -> None:
    # Without losses nothing settles.
    losses = {"damping": 0.02} if view == "attractors" else {}
    page = console.open(view, OSCILLATOR | losses, **fields)
    expect(page.locator(".readout").first).to_have_text(DONE)
    _tools(page)
    page.get_by_role("button", name="Report to print").click()
    report = page.locator("#report")
    expect(report).to_contain_text("coordinate 0")
    expect(report).to_contain_text("POST /v1/compute/")
    expect(report).to_contain_text(re.compile("Digest of the result: [0-9a-f]{64}"))
    shown = "canvas.picture" if view in {"basins", "map"} else "svg"
    expect(report.locator(shown).first).to_be_visible()
    sent = json.loads(report.locator("pre").first.text_content() or "")
    assert "system" in sent or "system" in sent["base"]
    _check(page)
    # What the browser makes a PDF of.
    page.emulate_media(media="print")
    expect(page.get_by_role("button", name="Back to the page")).to_be_hidden()
    expect(report).to_be_visible()
    assert len(page.pdf()) > 10_000
    page.emulate_media(media="screen")
    page.get_by_role("button", name="Back to the page").click()
    expect(page.locator(".readout").first).to_be_visible()


def test_coordinates_have_names(console: Visit) -> None:
    page = console.open("modes", {"form": "beam"}, points=100)
    expect(page.get_by_role("group", name="Stop 0")).to_contain_text("node 4, deflection")
    page = console.open("modes", {"form": "chain"}, points=101)
    expect(page.get_by_role("group", name="Stop 0")).to_contain_text("mass 6")
    expect(page.locator(".motion")).to_contain_text("Coordinate 5 (mass 6)")


def test_both_stops_have_their_lines_in_the_legend(console: Visit) -> None:
    stops = [{"dof": 0, "lower": 1, "upper": 1}, {"dof": 1, "lower": 0.5, "upper": 0.5}]
    page = console.open("modes", {"form": "two_mass", "stops": stops}, points=100)
    legend = page.locator(".legend").first
    expect(legend).to_contain_text("stop 0 at coordinate 0")
    expect(legend).to_contain_text("stop 1 at coordinate 1")


def test_a_damping_matrix_is_entered(console: Visit) -> None:
    page = console.open("driven", {"form": "matrices"}, points=50)
    expect(page.locator(".readout").first).to_have_text(DONE)
    page.get_by_label("Damping matrix C").check()
    page.get_by_label("C 0, 0").fill("0.1")
    with page.expect_request(
        lambda request: (
            "compute/periodic-motions" in request.url
            and (request.post_data_json or {}).get("system", {}).get("C", [[0]])[0][0] == 0.1
        ),
        timeout=LONG,
    ) as sent:
        page.get_by_label("C 0, 1").fill("-0.05")
    C = sent.value.post_data_json["system"]["C"]
    assert C[0][1] == C[1][0]
