"""The pages are small: all that they load, as the browser receives it."""

from __future__ import annotations

from playwright.sync_api import expect

from tests.browser.visits import Visit, received

BUDGET = 150_000
"""Bytes of both pages with everything that they load, compressed."""


def test_both_pages_with_all_their_files_are_below_the_budget(console: Visit) -> None:
    sizes = received(console.page)
    console.open("modes")
    expect(console.page.locator(".verdict")).to_contain_text("Admissible")
    console.page.goto(f"{console.url}/docs")
    expect(console.page.locator("#operation h2")).to_have_text("POST /v1/compute/impact-modes")
    assert len(sizes) > 30
    assert sum(sizes.values()) < BUDGET, sizes
