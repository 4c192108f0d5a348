"""The whole story of a chain, an uploaded beam and a driven oscillator, as a user sees it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from playwright.sync_api import Page, expect

from benchmarks.beams import matrices
from tests.browser.visits import Visit

DAMPED = {
    "form": "oscillator",
    "damping": 0.02,
    "stops": [{"dof": 0, "lower": None, "upper": 1.0, "restitution": 0.8}],
}


def _picture(page: Page, selector: str) -> str:
    """Return the pixels of a canvas."""
    drawn: str = page.locator(selector).first.evaluate("canvas => canvas.toDataURL()")
    return drawn


def test_a_chain_from_its_impulses_to_a_time_history(console: Visit) -> None:
    page = console.open("modes")
    expect(page.locator(".readout")).to_contain_text("1500 frequencies")
    expect(page.locator(".verdict")).to_contain_text("Admissible (certified)")
    # It moves.
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    before = _picture(page, "canvas.shape")
    page.wait_for_timeout(300)
    assert _picture(page, "canvas.shape") != before
    # What is drawn is told to those who do not see it.
    expect(
        page.get_by_role("img", name=re.compile("have an admissible impact mode"))
    ).to_be_visible()
    expect(page.get_by_role("img", name=re.compile("Displacement of coordinate 5"))).to_be_visible()
    # The cursor is dragged to a phantom, and the page says why it is none.
    box = page.locator(".figure .u-over").bounding_box()
    assert box is not None
    across = {
        Omega: box["x"] + (Omega - 0.55) / (2.6 - 0.55) * box["width"] for Omega in (2.3, 1.5)
    }
    page.mouse.move(across[2.3], box["y"] + 50)
    expect(page.locator(".readout")).to_contain_text(re.compile(r"Ω = 2\.(29|30)"))
    page.mouse.down()
    page.mouse.move(across[1.5], box["y"] + 60, steps=8)
    page.mouse.up()
    expect(page.locator(".verdict")).to_contain_text("would have to pull")
    page.get_by_role("button", name="Show the place").click()
    expect(page.locator(".controls .time")).to_have_text("t/T 0.50")
    expect(page).to_have_url(re.compile(r"Omega=1\.(49|50)"))
    # Back to an impact mode, and its time history.
    page.get_by_label("Ω of the cursor", exact=True).fill("2.3")
    expect(page.locator(".verdict")).to_contain_text("Admissible")
    page.get_by_role("button", name="Time history from here").click()
    expect(page.locator(".readout")).to_contain_text("24 impacts")
    expect(page.locator(".readout")).to_contain_text("double precision cannot tell")
    page.get_by_label("soft stops beside").check()
    expect(page.locator(".shapes canvas")).to_have_count(2)
    page.get_by_label("Time", exact=True).fill("0.5")
    expect(page.locator(".controls .time")).to_have_text("t = 16.39")


def test_a_stop_is_placed_by_a_click_on_the_chain(console: Visit) -> None:
    page = console.open("modes")
    expect(page.locator(".verdict")).to_contain_text("Admissible")
    canvas = page.locator("canvas.still")
    box = canvas.bounding_box()
    assert box is not None
    # The middle of 13 masses between two walls is in the middle of the drawing.
    canvas.click(position={"x": box["width"] / 2, "y": box["height"] / 2})
    stop = page.get_by_role("group", name="Stop 1")
    expect(stop.get_by_label("Coordinate")).to_have_value("6")
    canvas.click(position={"x": box["width"] / 2, "y": box["height"] / 2})
    expect(stop).to_have_count(0)


def test_the_address_of_every_view_shows_it_again(console: Visit) -> None:
    page = console.open("modes")
    expect(page.locator(".verdict")).to_contain_text("Admissible")
    page.get_by_label("Show", exact=True).select_option("impulse")
    page.get_by_label("Ω of the cursor", exact=True).fill("2.2")
    expect(page.locator(".values")).to_contain_text("2.2")
    canvas = page.locator("canvas.shape")
    box = canvas.bounding_box()
    assert box is not None
    canvas.click(position={"x": box["width"] * 0.25, "y": box["height"] / 2})
    caption = page.locator(".motion .hint").inner_text()
    assert "Coordinate 5" not in caption
    expect(page).to_have_url(re.compile("coordinate="))
    values, verdict = (page.locator(each).inner_text() for each in (".values", ".verdict"))
    other = page.context.new_page()
    other.goto(page.url)
    expect(other.locator(".values")).to_have_text(values, use_inner_text=True)
    expect(other.locator(".verdict")).to_have_text(verdict, use_inner_text=True)
    expect(other.locator(".motion .hint")).to_have_text(caption)
    expect(other.get_by_label("Show", exact=True)).to_have_value("impulse")
    other.close()


def test_impacts_are_heard_if_wanted(console: Visit) -> None:
    console.page.add_init_script(
        """window.tones = 0;
        const tone = AudioContext.prototype.createOscillator;
        AudioContext.prototype.createOscillator = function () {
          window.tones += 1; return tone.call(this);
        };"""
    )
    page = console.open("history", {"form": "oscillator"}, v=3, duration=20)
    expect(page.locator(".readout")).to_contain_text("impacts")
    page.get_by_label("Speed").select_option("fast")
    page.wait_for_timeout(1500)
    assert page.evaluate("window.tones") == 0
    page.get_by_label("sound of impacts").check()
    for _ in range(100):  # the policy of the page lets nobody wait within it
        page.wait_for_timeout(100)
        if page.evaluate("window.tones") > 0:
            return
    pytest.fail("no impact is heard")


def test_a_phantom_that_passes_a_stop_is_shown_where_it_does(console: Visit) -> None:
    page = console.open("modes", Omega=0.79)
    expect(page.locator(".verdict")).to_contain_text("Between impacts")
    expect(page.locator(".verdict")).to_contain_text("is passed")
    page.get_by_role("button", name="Show the place").click()
    expect(page.locator(".controls .time")).not_to_have_text("t/T 0.00")


def test_matrices_of_a_beam_are_uploaded_with_their_geometry(
    console: Visit, tmp_path: Path
) -> None:
    n = 12
    stiffness = np.diag(np.full(n, 6.0)) - 4 * np.eye(n, k=1) - 4 * np.eye(n, k=-1)
    stiffness += np.eye(n, k=2) + np.eye(n, k=-2) + np.diag([1.0, *[0.0] * (n - 2), 1.0])
    entries = [(i, j) for i in range(n) for j in range(i + 1) if stiffness[i, j]]
    lines = "".join(f"{i + 1} {j + 1} {stiffness[i, j]}\n" for i, j in entries)
    header = f"%%MatrixMarket matrix coordinate real symmetric\n{n} {n} {len(entries)}\n"
    (tmp_path / "beam.mtx").write_text(header + lines)
    rows = "".join(f"{i / n}, 0, 0, z\n" for i in range(n))
    (tmp_path / "nodes.csv").write_text("x, y, z, direction\n" + rows)
    page = console.open("modes")
    page.locator("#upload").set_input_files(tmp_path / "beam.mtx")
    expect(page.locator("#structure")).to_contain_text("beam.mtx: 12 degrees of freedom")
    page.locator("#geometry").set_input_files(tmp_path / "nodes.csv")
    page.get_by_label("Ω from").fill("3.99")
    page.get_by_label("to", exact=True).fill("6")
    expect(page.locator(".verdict")).to_contain_text("Admissible")
    # A stop is placed by a click on the drawing, and the structure is computed with both.
    canvas = page.locator("canvas.still")
    box = canvas.bounding_box()
    assert box is not None
    for share in np.linspace(0.55, 0.9, 15):
        canvas.click(position={"x": box["width"] * float(share), "y": box["height"] / 2})
        if page.get_by_role("group", name="Stop 1").count():
            break
    expect(page.get_by_role("group", name="Stop 1")).to_be_visible()
    with page.expect_request(lambda asked: "1.5" in (asked.post_data or "")) as asked:
        page.get_by_role("group", name="Stop 1").get_by_label("Upper gap").fill("1.5")
    system = json.loads(asked.value.post_data or "")["system"]
    assert system["id"].startswith("sys_")
    assert system["constraints"][0]["dof"] in (5, 6)  # where the first mode moves most
    assert system["constraints"][1]["gap"] == {"lower": 1.0, "upper": 1.5}
    # Only the first stop is struck; the address holds all of it, and goes on from there.
    page.get_by_role("group", name="Stop 1").get_by_role("checkbox", name="struck").uncheck()
    expect(page.locator(".verdict")).to_contain_text("Admissible")
    page.get_by_label("Ω of the cursor", exact=True).fill("4.5")
    expect(page.locator(".values")).to_contain_text("4.5")
    expect(page).to_have_url(re.compile("Omega=4.5"))
    other = console.page.context.new_page()
    other.goto(page.url)
    expect(other.locator("#structure")).to_contain_text("12 degrees of freedom")
    expect(other.locator(".values")).to_contain_text("Ω4.5")
    other.close()
    page.get_by_role("button", name="Time history from here").click()
    expect(page.locator(".readout")).to_contain_text("24 impacts")
    page.get_by_text("Plan and request").click()
    page.get_by_role("button", name="Queue as a job").click()
    expect(page.locator("table.jobs tbody tr").first).to_contain_text("succeeded")


def test_a_driven_oscillator_shows_its_response_and_moves(console: Visit) -> None:
    page = console.open("driven", DAMPED, load=[{"dof": 0, "amplitude": 0.3}])
    expect(page.locator(".readout")).to_contain_text("solutions")
    expect(page.locator(".verdict")).to_contain_text("Stable")
    expect(page.locator(".values")).to_contain_text("largest multiplier")
    before = _picture(page, "canvas.shape")
    page.wait_for_timeout(300)
    assert _picture(page, "canvas.shape") != before
    # Started there, the time history stays on it: one impact a period.
    page.get_by_role("button", name="Time history from here").click()
    expect(page.locator(".readout")).to_contain_text("20 impacts")


def test_matrices_are_entered(console: Visit) -> None:
    page = console.open("modes")
    page.get_by_role("combobox", name="Structure").select_option("matrices")
    page.get_by_label("K 0, 1").fill("-0.5")
    expect(page.get_by_label("K 1, 0")).to_have_value("-0.5")
    smaller = "[[2,-0.5],[-0.5,2]]"
    with page.expect_request(lambda asked: smaller in (asked.post_data or "")):
        page.get_by_role("spinbutton", name="Degrees of freedom").fill("2")


def test_an_ensemble_leads_to_a_time_history_and_a_map_to_a_mode(console: Visit) -> None:
    page = console.open("basins", {"form": "oscillator"}, cells=21, t_end=10)
    expect(page.locator(".readout")).to_contain_text("441 motions")
    page.locator(".figure .u-over").click(position={"x": 600, "y": 100})
    expect(page.locator("#history-title")).to_be_visible()
    expect(page.locator(".readout")).to_contain_text("impacts")
    console.open("map", {"form": "chain"}, rows=11, points=60)
    expect(page.locator(".readout")).to_contain_text("of 660 points")
    page.locator(".figure .u-over").click(position={"x": 900, "y": 150})
    expect(page.locator(".verdict")).to_contain_text("certified")


def test_ensembles_of_the_usual_and_of_the_largest_size_are_drawn(console: Visit) -> None:
    stops = [{"dof": 0, "lower": 1, "upper": 1, "restitution": 0.9}]
    two = {"form": "two_mass", "stops": stops}
    for fields, count in (({}, 61**2), ({"cells": 301, "t_end": 2}, 301**2)):
        page = console.open("basins", two, **fields)
        expect(page.locator(".readout").first).to_contain_text(f"{count} motions")


def test_where_rounding_decides_the_page_says_so(console: Visit) -> None:
    # Five times 0.4 is a natural frequency: that mode alone reaches the stops, without impulses.
    page = console.open("modes", {"form": "two_mass", "parameters": {"coupling": 1.5}}, Omega=0.4)
    expect(page.locator(".verdict")).to_contain_text("(estimated)")
    expect(page.locator(".verdict")).to_contain_text("Rounding decides here")
    expect(page.locator(".verdict")).not_to_contain_text("all stops push")


@pytest.mark.parametrize("form", ["beam", "two_mass", "double_pendulum", "absorber"])
def test_every_preset_has_an_impact_mode_to_show(console: Visit, form: str) -> None:
    page = console.open("modes", {"form": form})
    expect(page.locator(".verdict")).to_contain_text("Admissible")


def test_the_plan_is_readable_before_and_the_request_can_be_taken_away(console: Visit) -> None:
    page = console.open("modes")
    page.get_by_text("Plan and request").click()
    expect(page.locator("#requests")).to_contain_text("existence")
    expect(page.locator("#requests")).to_contain_text("stored already")
    page.get_by_role("button", name="curl", exact=True).click()
    expect(page.locator("#requests pre")).to_contain_text("/v1/compute/impact-modes")
    page.get_by_role("button", name="Python", exact=True).click()
    code = page.locator("#requests pre").inner_text()
    compile(code, "request", "exec")
    assert "client.compute(" in code
    with page.expect_download() as saved:
        page.get_by_role("button", name="Download HDF5").click()
    assert saved.value.path().read_bytes().startswith(b"\x89HDF")


STOP_ROWS = """() => {
  const canvas = document.querySelector(".curve canvas, canvas.curve, .uplot canvas");
  const { width, height } = canvas;
  const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
  const red = (i) => data[i] > 140 && data[i + 1] < 110 && data[i + 2] < 90 && data[i + 3] > 128;
  const rows = [];
  for (let y = 0; y < height; y += 1) {
    let count = 0;
    for (let x = 0; x < width; x += 1) count += red(4 * (y * width + x));
    if (count > 0.6 * width) rows.push(y / height);
  }
  return rows;
}"""
"""Heights, from 0 at the top to 1, of rows that are red for the most part: stops."""


def test_both_stops_and_all_of_a_time_history_are_in_its_curve(console: Visit) -> None:
    page = console.open("history", mode=2.3)
    expect(page.locator(".readout").first).to_contain_text("impacts")
    rows = page.evaluate(STOP_ROWS)
    assert rows
    assert min(rows) < 0.35
    assert max(rows) > 0.5


@pytest.mark.parametrize("model", ["steel", "beam"])
def test_a_model_shows_certified_bands_before_a_number_is_typed(
    console: Visit, tmp_path: Path, model: str
) -> None:
    """Ranges follow from natural frequencies, and the stop stands where the first mode moves."""
    n = 10
    M, K = 0.2 * np.eye(n), 1e7 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    if model == "beam":
        M, K = matrices(12)
    first = float(np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)[0]))
    np.savez(tmp_path / "model.npz", M=M, K=K)
    page = console.open("modes")
    page.locator("#upload").set_input_files(tmp_path / "model.npz")
    expect(page.locator("#structure")).to_contain_text("model.npz")
    expect(page.locator(".natural summary")).to_contain_text(f"{first:.4g}")
    expect(page.locator(".verdict")).to_contain_text("Admissible (certified)")
    assert float(page.get_by_label("Ω from").input_value()) > 0.9 * first
    stop = page.get_by_role("group", name="Stop 0").get_by_label("Coordinate")
    expect(stop).to_have_value("4" if model == "steel" else "22")  # the middle; the tip
    # A range far below the spectrum is said to be one.
    page.get_by_label("to", exact=True).fill(f"{0.5 * first:.3g}")
    page.get_by_label("Ω from").fill(f"{0.4 * first:.3g}")
    expect(page.locator(".cautions")).to_contain_text("below the first natural frequency")


@pytest.mark.parametrize(("label", "number"), [("Masses", "1000000000"), ("points", "10000000")])
def test_numbers_that_no_page_could_draw_are_refused_at_their_fields(
    console: Visit, label: str, number: str
) -> None:
    page = console.open("modes")
    expect(page.locator(".readout")).to_contain_text("1500 frequencies")
    field = page.get_by_label(label, exact=True)
    field.fill(number)
    expect(field).to_have_attribute("aria-invalid", "true")
    expect(page.locator(".field", has=field).locator(".fault")).not_to_be_empty()


def test_a_stop_with_a_stiffness_is_met_in_a_time_history(console: Visit) -> None:
    page = console.open("history")
    expect(page.locator(".readout").first).to_contain_text("impacts")
    with page.expect_request("**/v1/compute/time-history") as asked:
        page.get_by_role("group", name="Stop 0").get_by_label("Stiffness").fill("50")
    stop = json.loads(asked.value.post_data or "")["system"]["constraints"][0]
    assert stop["law"] == {"type": "linear", "stiffness": 50, "damping": 0}
    assert "restitution" not in stop
    expect(page.locator(".readout").first).to_contain_text("contacts")
    # Impact modes are those of rigid stops, and the view says so.
    page.locator("[data-view=modes]").first.click()
    expect(page.locator(".cautions")).to_contain_text("The stiffness of stop 0 is neglected")
