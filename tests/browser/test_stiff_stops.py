"""What the page shows of stops with a stiffness, of beams, of derivatives, and side by side."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, expect
from scipy import io as matrix_market
from scipy import sparse

from tests.browser.visits import Visit

DONE = re.compile(r"\d")
SOFT = {
    "form": "oscillator",
    "damping": 0.05,
    "stops": [{"dof": 0, "lower": None, "upper": 0.2, "stiffness": 20, "damping": 0.1}],
}

WALLS = """window.walls = [];
const { beginPath, moveTo, lineTo, stroke } = CanvasRenderingContext2D.prototype;
const proto = CanvasRenderingContext2D.prototype;
proto.beginPath = function () { this.points = []; return beginPath.call(this); };
for (const [name, call] of [["moveTo", moveTo], ["lineTo", lineTo]]) {
  proto[name] = function (x, y) {
    if (this.points) this.points.push([x, y]); return call.call(this, x, y); };
}
proto.stroke = function (...path) {
  if (this.canvas.className === "shape" && (this.lineWidth === 3.5 || this.lineWidth === 5)) {
    window.walls.push(this.points[0][0]);
  }
  return stroke.apply(this, path); };"""
"""Note where the bars of stops are drawn: those of a row of masses stand upright."""


def _done(page: Page) -> None:
    expect(page.locator(".readout").first).to_have_text(DONE)


@pytest.mark.parametrize(
    ("view", "fields"), [("modes", {"points": 100}), ("map", {"rows": 5, "points": 20})]
)
def test_views_of_impact_modes_take_stops_with_a_stiffness_as_rigid_and_say_so(
    console: Visit, view: str, fields: dict[str, Any]
) -> None:
    page = console.open(view, SOFT, **fields)
    _done(page)
    expect(page.locator(".cautions")).to_contain_text("The stiffness of stop 0 is neglected")
    expect(page.locator("[aria-invalid]")).to_have_count(0)
    expect(page.locator("#message")).to_be_empty()


def test_a_history_goes_on_from_an_impact_mode_of_stops_with_a_stiffness(console: Visit) -> None:
    page = console.open("modes", SOFT, points=100)
    expect(page.locator(".verdict")).to_contain_text("certified")
    page.get_by_role("button", name="Time history from here").click()
    expect(page.locator(".readout").first).to_contain_text("contacts")
    expect(page.locator("#message")).to_be_empty()


def test_restitution_is_offered_where_there_is_no_stiffness(console: Visit) -> None:
    page = console.open("history", SOFT, v=1, duration=20)
    _done(page)
    group = page.get_by_role("group", name="Stop 0")
    expect(group.get_by_label("Restitution", exact=True)).to_be_hidden()
    expect(group.get_by_label("Stop damping")).to_be_visible()
    group.get_by_label("Stiffness").fill("")
    expect(group.get_by_label("Restitution", exact=True)).to_be_visible()
    expect(group.get_by_label("Stop damping")).to_be_hidden()


@pytest.mark.parametrize(
    ("law", "document", "exponent"),
    [
        ("hertz", {"type": "hertz", "stiffness": 20}, 1.5),
        ("power", {"type": "power", "stiffness": 20, "exponent": 2.2}, 2.2),
    ],
)
def test_forces_of_stops_may_grow_with_a_power(
    console: Visit, law: str, document: dict[str, Any], exponent: float
) -> None:
    page = console.open("history", SOFT, v=1, duration=20)
    _done(page)
    group = page.get_by_role("group", name="Stop 0")
    expect(group.get_by_label("Exponent")).to_be_hidden()
    with page.expect_response("**/compute/time-history") as answer:
        group.get_by_label("Law of its force").select_option(law)
        if law == "power":
            group.get_by_label("Exponent").fill("2.2")
    expect(group.get_by_label("Stop damping")).to_be_hidden()
    expect(group.get_by_label("Exponent")).to_be_visible(visible=law == "power")
    sent = answer.value.request.post_data_json["system"]["constraints"][0]
    assert sent["law"] == document
    contacts = answer.value.json()["contacts"]
    # The law itself, at the deepest point of each contact.
    for force, depth in zip(contacts["peak_force"], contacts["indentation"], strict=True):
        assert force == pytest.approx(20 * depth**exponent, rel=1e-6)
    expect(page.locator(".readout").first).to_contain_text(f"{len(contacts['start'])} contacts")
    # It is kept in the address, and other views say what they do not compute.
    page.reload()
    expect(group.get_by_label("Law of its force")).to_have_value(law)
    page.get_by_role("link", name="Driven response").click()
    expect(group.locator(".fault").filter(has_text=f"has a {law} one")).to_be_visible()


def test_forces_stand_below_the_displacement(console: Visit, tmp_path: Path) -> None:
    with console.page.expect_response("**/compute/time-history") as answer:
        page = console.open("history", SOFT, v=1, duration=20)
    result = answer.value.json()
    peak = max(result["contacts"]["peak_force"])
    expect(page.locator(".readout").first).to_contain_text(f"the largest force {peak:.5g}")
    sides = [page.locator(each).bounding_box() for each in (".figure", ".forces .curve")]
    assert sides[0] is not None
    assert sides[1] is not None
    assert sides[0]["y"] + sides[0]["height"] <= sides[1]["y"]
    with page.expect_download() as waited:
        page.get_by_role("button", name="Save the forces as CSV").click()
    waited.value.save_as(tmp_path / "forces.csv")
    text = (tmp_path / "forces.csv").read_text(encoding="utf-8-sig")
    head, *rows = csv.reader(io.StringIO(text))
    assert head[0] == "time t"
    assert [float(row[1]) for row in rows] == [each[0] for each in result["force"]]


def test_a_stop_that_is_pushed_in_is_drawn_so(console: Visit) -> None:
    console.page.add_init_script(WALLS)
    page = console.open("history", SOFT, v=1, duration=20)
    _done(page)
    page.get_by_role("button", name="Pause").click()

    def wall(time: float) -> float:
        page.evaluate("window.walls.length = 0")
        page.get_by_role("slider", name="Time").fill(str(time / 20))
        page.wait_for_timeout(300)
        place: float = page.evaluate("window.walls.at(-1)")
        return place

    # The first contact lasts from t = 0.203 to 0.864.
    open_, deep = wall(0.1), wall(0.5)
    assert wall(1.0) == pytest.approx(open_)
    assert deep > open_ + 20


def test_few_frequencies_of_contacts_are_asked_for_first(console: Visit) -> None:
    page = console.open("driven", SOFT)
    points = page.get_by_role("spinbutton", name="points", exact=True)
    expect(points).to_have_value("120")


def _steel_beam(elements: int, length: float, EI: float, mass: float) -> tuple[Any, Any]:
    """Return M and K of a cantilever of Hermite elements."""
    h = length / elements
    k = EI / h**3 * np.array(
        [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
         [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]]
    )  # fmt: skip
    m = mass * h / 420 * np.array(
        [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
         [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]]
    )  # fmt: skip
    n = 2 * elements + 2
    M, K = np.zeros((n, n)), np.zeros((n, n))
    for e in range(elements):
        part = slice(2 * e, 2 * e + 4)
        M[part, part] += m
        K[part, part] += k
    return M[2:, 2:], K[2:, 2:]


def test_a_beam_of_steel_has_its_picture_without_a_number_typed(
    console: Visit, tmp_path: Path
) -> None:
    page = console.open("modes", SOFT, points=100)
    _done(page)
    files = []
    for name, matrix in zip("MK", _steel_beam(4, 0.5, 100.0, 0.8), strict=True):
        files.append(tmp_path / f"{name}.mtx")
        matrix_market.mmwrite(
            files[-1], sparse.coo_matrix(matrix), symmetry="symmetric", precision=17
        )
    page.set_input_files("#upload", files)
    group = page.get_by_role("group", name="Stop 0")
    expect(group).to_contain_text("node 4, deflection")
    # A hundredth of its length, which the matrices tell.
    expect(group.get_by_label("Upper gap")).to_have_value("0.005")
    expect(page.locator(".verdict")).to_contain_text("certified")
    expect(page.locator(".motion")).to_contain_text("Coordinate 6 (node 4, deflection)")


def test_beams_are_recognised_by_their_stiffness_alone(console: Visit) -> None:
    page = console.open("jobs")
    # In mm and t; clamped at both ends; a chain whose masses alternate; a beam with a spring.
    _, mm = _steel_beam(5, 500.0, 1e8, 8e-7)
    _, m = _steel_beam(4, 0.5, 100.0, 0.8)
    clamped = m[:-2, :-2]
    chain = 2 * np.eye(8) - np.eye(8, k=1) - np.eye(8, k=-1)
    sprung = m.copy()
    sprung[0, 4] = sprung[4, 0] = -1.0
    beams = page.evaluate(
        """async (matrices) => {
          const main = document.querySelector("script[type=module]").src;
          const { beamOf } = await import(new URL("beams.js", main));
          return matrices.map((K) => beamOf(K));
        }""",
        [each.tolist() for each in (mm, clamped, chain, sprung)],
    )
    assert beams[0]["length"] == pytest.approx(500.0)
    assert beams[0]["fixed"] == [True, False]
    assert beams[1]["length"] == pytest.approx(0.5)
    assert beams[1]["fixed"] == [True, True]
    assert beams[2:] == [None, None]


def test_derivatives_of_a_motion_at_the_time_of_the_cursor(console: Visit) -> None:
    structure = {
        "form": "oscillator",
        "damping": 0.05,
        "stops": [{"dof": 0, "lower": 0.5, "upper": 0.5, "restitution": 0.8}],
    }
    page = console.open("history", structure, v=1, duration=10)
    _done(page)
    page.get_by_role("button", name="Pause").click()
    page.get_by_role("slider", name="Time").fill("0.5")
    with page.expect_response(
        lambda answer: "derivatives" in (answer.request.post_data or "")
    ) as waited:
        page.get_by_text("How it changes with the structure").click()
    asked = waited.value.request.post_data_json
    assert asked["t"] == [5.0]
    assert asked["derivatives"] == [
        "system.constraints.0.gap", "system.constraints.0.restitution", "system.K.scale",
        "system.M.scale", "system.zeta", "initial.v.0",
    ]  # fmt: skip
    rows = page.locator(".rates tbody tr")
    expect(rows).to_have_count(18)
    shares = [float(str(each).split()[0].replace("−", "-")) for each in (
        rows.nth(i).locator("td").nth(1).text_content() for i in range(18))]  # fmt: skip
    x, time, speed = (shares[start::3] for start in range(3))
    # All lengths grow with gap and initial velocity alike; times do not change then.
    assert x[0] + x[5] == pytest.approx(1.0, abs=0.02)
    assert time[0] + time[5] == pytest.approx(0.0, abs=0.02)
    assert speed[0] + speed[5] == pytest.approx(1.0, abs=0.02)
    # They follow the cursor, and stops with a stiffness have none.
    with page.expect_response(lambda answer: "derivatives" in (answer.request.post_data or "")):
        page.get_by_role("slider", name="Time").fill("0.7")
    page.get_by_role("group", name="Stop 0").get_by_label("Stiffness").fill("50")
    expect(page.locator(".rates")).to_be_hidden()


def test_derivatives_of_the_mode_at_the_cursor(console: Visit) -> None:
    """Units tell sums of them: momentum is mass times length over time."""
    page = console.open("modes", {"form": "chain"}, Omega=2.29, points=100)
    expect(page.locator(".verdict")).to_contain_text("certified")
    with page.expect_response(
        lambda answer: "derivatives" in (answer.request.post_data or "")
    ) as waited:
        page.get_by_text("How it changes with the structure").click()
    asked = json.loads(waited.value.request.post_data or "")["derivatives"]
    assert asked == ["system.constraints.0.gap", "system.K.scale", "system.M.scale", "frequency"]
    rows = page.locator(".rates tbody tr")
    expect(rows).to_have_count(8)
    shares = [float(str(each).split()[0].replace("−", "-")) for each in (
        rows.nth(i).locator("td").nth(1).text_content() for i in range(8))]  # fmt: skip
    gap, K, M, Omega = shares[::2]
    assert gap == 1
    assert abs(K + M - 1) < 0.02
    assert abs(2 * K + Omega - 1) < 0.02
    assert shares[1] == 2  # the energy goes with the square of the gap
    # They follow the cursor.
    before = rows.nth(6).text_content()
    page.get_by_label("Ω of the cursor", exact=True).fill("2.2")
    expect(rows.nth(6)).not_to_have_text(str(before))


def test_kept_histories_stand_beside_the_present_one_and_say_where_they_begin(
    console: Visit,
) -> None:
    page = console.open("history", {"form": "chain"}, mode=2.3)
    expect(page.locator(".readout")).to_contain_text("impacts")
    page.get_by_text("Zoom, save, compare, report").click()
    page.get_by_role("button", name="Keep this beside the next one").click()
    page.get_by_label("Ω of the mode").fill("2.2")
    expect(page.locator("figure.kept")).to_contain_text("from the impact mode at Ω = 2.3")
    sides = [page.locator(each).bounding_box() for each in ("figure.kept", ".figure")]
    assert sides[0] is not None
    assert sides[1] is not None
    assert sides[0]["x"] + sides[0]["width"] <= sides[1]["x"]
    assert abs(sides[0]["y"] - sides[1]["y"]) < 30


def test_a_report_is_one_column(console: Visit) -> None:
    page = console.open("history", SOFT, v=1, duration=20)
    _done(page)
    page.get_by_text("Zoom, save, compare, report").click()
    page.get_by_role("button", name="Report to print").click()
    places = page.locator("#report > *").evaluate_all(
        "all => all.map((each) => each.getBoundingClientRect().x)"
    )
    assert max(places) - min(places) < 1
    # Displacement and forces.
    expect(page.locator("#report > svg")).to_have_count(2)
