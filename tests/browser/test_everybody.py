"""Every view can be used by everybody: axe has no findings, at any width and in both themes."""

from __future__ import annotations

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect

from tests.browser.visits import LONG, Visit

OSCILLATOR = {"form": "oscillator", "damping": 0.02}
VIEWS = {
    "modes": ("modes", {"structure": {"form": "chain"}, "Omega": 0.79}, ".verdict >> text=passed"),
    "driven": ("driven", {"structure": OSCILLATOR, "points": 200}, ".verdict >> text=certified"),
    "history": ("history", {"mode": 2.3, "soft": True}, ".readout >> text=impacts"),
    "basins": (
        "basins",
        {"structure": OSCILLATOR, "cells": 21, "t_end": 10},
        ".readout >> text=motions",
    ),
    "attractors": (
        "attractors",
        {"structure": OSCILLATOR, "cells": 3},
        ".readout >> text=motions settle",
    ),
    "map": ("map", {"rows": 11, "points": 60}, ".readout >> text=points"),
    "jobs": ("jobs", {}, "#jobs-title"),
    "matrices": ("modes", {"structure": {"form": "matrices"}}, ".verdict >> text=certified"),
}


def _check(page: Page) -> None:
    result = Axe().run(page)
    assert result.violations_count == 0, result.generate_report()
    widths = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
    assert widths[0] <= widths[1]


@pytest.mark.parametrize("width", [390, 1600])
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", VIEWS)
def test_a_view_has_no_findings(console: Visit, name: str, scheme: str, width: int) -> None:
    view, fields, sign = VIEWS[name]
    console.page.set_viewport_size({"width": width, "height": 900})
    console.page.emulate_media(color_scheme="light" if scheme == "light" else "dark")
    page = console.open(view, **fields)
    page.locator(sign).first.wait_for(timeout=LONG)
    if view != "jobs":
        page.get_by_text("Plan and request").click()
        page.locator("#requests table, #requests .hint").first.wait_for(timeout=LONG)
    if page.get_by_role("button", name="Pause").count():
        page.get_by_role("button", name="Pause").click()
    _check(page)


@pytest.mark.parametrize("width", [390, 1600])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_contract_is_readable_and_can_be_tried(console: Visit, scheme: str, width: int) -> None:
    page = console.page
    page.set_viewport_size({"width": width, "height": 900})
    page.emulate_media(color_scheme="light" if scheme == "light" else "dark")
    page.goto(f"{console.url}/docs")
    expect(page.locator("#operation h2")).to_have_text("POST /v1/compute/impact-modes")
    assert page.evaluate("document.documentElement.scrollHeight") < 6000
    page.get_by_role("button", name="Send").click()
    expect(page.locator("#operation")).to_contain_text("200 OK")
    _check(page)


def test_the_cursor_moves_by_keyboard(console: Visit) -> None:
    page = console.open("modes", Omega=2.3)
    expect(page.locator(".verdict")).to_contain_text("Admissible")
    slider = page.get_by_role("slider", name="Frequency Ω of the cursor")
    slider.focus()
    with page.expect_response("**/compute/impact-modes"):
        page.keyboard.press("ArrowRight")
    assert float(slider.input_value()) > 2.3
    # Everything can be reached: the first key is a link past the header.
    page.reload()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Skip to the view"


def test_those_who_ask_for_less_motion_get_less(console: Visit) -> None:
    console.page.emulate_media(reduced_motion="reduce")
    page = console.open("modes")
    expect(page.locator(".verdict")).to_contain_text("Admissible")
    expect(page.get_by_role("button", name="Play")).to_be_visible()
