"""Driven structures: branches and their special points, several forces, constant loads."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from playwright.sync_api import Page, Route, expect

from tests.browser.visits import Visit

# One mass below a wall at rest: the example of the package `branches`, whose first flip is known.
BELOW_A_WALL = {
    "form": "oscillator",
    "damping": 0.05,
    "stops": [{"dof": 0, "lower": None, "upper": 0.0, "restitution": 0.8}],
}
FLIP = 2.65888
DRIVEN = {"load": [{"dof": 0, "amplitude": 1.0}], "from": 2.6, "to": 2.8, "points": 200}


def _open(console: Visit, **fields: Any) -> tuple[Page, dict[str, Any]]:
    """Return the page and the branches that it shows."""
    with console.page.expect_request("**/plan/branches") as planned:
        page = console.open("driven", BELOW_A_WALL, **DRIVEN, **fields)
    expect(page.locator(".special")).to_be_visible()
    request = json.loads(planned.value.post_data or "")
    return page, page.request.post(f"{console.url}/v1/compute/branches", data=request).json()


def test_a_flip_is_marked_listed_and_leads_there(console: Visit) -> None:
    page, _ = _open(console)
    listed = page.get_by_role("button", name=f"flip (period doubling) Ω = {FLIP}")
    expect(listed).to_be_visible()
    told = re.compile("special points of [2-9] branches")
    expect(page.get_by_role("img", name=told)).to_be_visible()
    listed.click()
    slider = page.get_by_role("slider", name="Frequency Ω of the drive at the cursor")
    assert float(slider.input_value()) == pytest.approx(FLIP, abs=2e-3)
    # There a multiplier is -1.
    expect(page.locator(".values")).to_contain_text(re.compile(r"multiplier(0\.99|1\.00)"))


def test_a_motion_of_two_periods_moves_with_both_impacts(console: Visit) -> None:
    page, branches = _open(console)
    solution = branches["solution"]
    rows = [
        row
        for row, periods in enumerate(solution["periods"])
        if periods == 2 and solution["exists"][row] and solution["stability"][row] < 0.9
    ]
    row = rows[len(rows) // 2]
    impact = branches["impact"]
    momentum = [impact["momentum"][i] for i, of in enumerate(impact["solution"]) if of == row]
    height = 0.5 * (solution["x_max"][row][0] - solution["x_min"][row][0])
    page, _ = _open(console, Omega=solution["Omega"][row], height=height)
    expect(page.locator(".values")).to_contain_text("2 of the drive")
    expect(page.locator(".verdict")).to_contain_text("Stable")
    told = page.locator(".values dt:text-is('momentum of each') + dd").inner_text()
    shown = [float(each.replace("\u2212", "-")) for each in told.split(",")]
    # The motion is the same begun a period of the drive later.
    assert sorted(shown) == pytest.approx(sorted(momentum), rel=1e-4)


def test_lines_tell_stable_unstable_and_phantom_motions(console: Visit) -> None:
    # What the canvas is told: the lines of the three states differ by more than their colours.
    console.page.add_init_script(
        """const dash = CanvasRenderingContext2D.prototype.setLineDash;
        const stroke = CanvasRenderingContext2D.prototype.stroke;
        window.strokes = new Set();
        CanvasRenderingContext2D.prototype.setLineDash = function (parts) {
          this.parts = parts.join(); return dash.call(this, parts);
        };
        CanvasRenderingContext2D.prototype.stroke = function (...path) {
          window.strokes.add(`${this.strokeStyle} ${this.parts || ""}`);
          return stroke.apply(this, path);
        };"""
    )
    page, _ = _open(console)
    of = "name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim()"
    colours = {name: page.evaluate(of, name) for name in ("stable", "unstable", "phantom")}
    strokes = page.evaluate("[...window.strokes]")
    assert f"{colours['stable']} " in strokes
    assert f"{colours['unstable']} 6,4" in strokes
    assert f"{colours['phantom']} 2,3" in strokes


def test_several_forces_drive_a_structure(console: Visit) -> None:
    page, _ = _open(console)
    page.get_by_role("button", name="Add a force", exact=True).click()
    second = page.get_by_role("group", name="Force 1")
    expect(second.get_by_label("times Ω")).to_have_value("2")
    with page.expect_request(lambda asked: '"phase":0.5' in (asked.post_data or "")) as asked:
        second.get_by_label("phase").fill("0.5")
    terms = json.loads(asked.value.post_data or "")["load"]
    assert [term.get("harmonic", 1) for term in terms] == [1, 2]
    # Its time history has the same forces, at their own frequencies.
    expect(page.locator(".verdict")).to_contain_text("certified")
    page.get_by_role("button", name="Time history from here").click()
    expect(page.locator(".readout")).to_contain_text("20 impacts")
    slow, fast = (
        float(page.get_by_role("group", name=force).get_by_label("its frequency").input_value())
        for force in ("Force 0", "Force 1")
    )
    assert fast == pytest.approx(2 * slow)


def test_a_constant_load_bends_the_structure(console: Visit) -> None:
    page = console.open("history", {"form": "oscillator"}, v=0, duration=20)
    expect(page.locator(".readout")).to_contain_text("0 impacts")
    page.get_by_role("button", name="Add a constant force").click()
    loaded = '"force":[0.3]'
    with page.expect_response(
        lambda answer: "time-history" in answer.url and loaded in (answer.request.post_data or "")
    ) as answer:
        force = page.get_by_role("group", name="Constant force 0")
        force.get_by_label("Force", exact=True).fill("0.3")
    # x = 0.3 (1 - cos t) of a unit mass and stiffness that begins at rest
    x = [row[0] for row in answer.value.json()["x"]]
    assert max(x) == pytest.approx(0.6, abs=1e-4)
    assert min(x) == pytest.approx(0.0, abs=1e-4)
    # It goes to a colleague with the address; a coordinate that is not there is a fault there.
    expect(page).to_have_url(re.compile("loads"))
    page.reload()
    expect(force.get_by_label("Force", exact=True)).to_have_value("0.3")
    force.get_by_label("On coordinate").fill("7")
    expect(page.locator("#fault-loads")).not_to_be_empty()


def test_contacts_with_a_stiff_stop_are_motions_that_meet_it(console: Visit) -> None:
    """They have no impacts, and no branches are followed."""
    yielding = {
        "form": "oscillator",
        "damping": 0.05,
        "stops": [{"dof": 0, "lower": None, "upper": 0.0, "restitution": 0.8, "stiffness": 5.0}],
    }
    begun = {**DRIVEN, "from": 1.2, "to": 1.8, "points": 20}
    page = console.open("driven", yielding, **begun)
    expect(page.locator(".verdict")).to_contain_text("Admissible (certified)")
    expect(page.locator(".values")).to_contain_text("contacts per period1")
    expect(page.locator(".values")).to_contain_text("contact time of each")
    expect(page.locator(".readout").first).to_contain_text("admissible with contacts. Click")
    expect(page.locator(".curve").first).to_be_visible()


def test_branches_that_take_long_come_with_advice(console: Visit) -> None:
    def slow(route: Route) -> None:
        answer = route.fetch()
        route.fulfill(response=answer, json=answer.json() | {"seconds": 2400, "cached": False})

    console.page.route("**/v1/plan/branches", slow)
    page = console.open("driven", BELOW_A_WALL, points=20)
    note = page.get_by_text("To follow the branches")
    expect(note).to_contain_text("about 40 min")
    expect(note).to_contain_text("reduced to its lowest modes")
    expect(page.get_by_role("button", name="Follow them")).to_be_visible()
