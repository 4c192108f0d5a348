"""Draw the pictures of the docs: ``python -m tests.browser.pictures``; look at them afterwards."""

from __future__ import annotations

import io
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from tests.browser.conftest import CHROMIUM
from tests.browser.visits import LONG, Service, visit

IMAGES = Path(__file__).parents[2] / "docs" / "images"
BELOW_A_WALL = {
    "form": "oscillator",
    "damping": 0.05,
    "stops": [{"dof": 0, "lower": None, "upper": 0.0, "restitution": 0.8}],
}
BETWEEN_JUMPS = {
    "form": "oscillator",
    "damping": 0.05,
    "stops": [{"dof": 0, "lower": None, "upper": 0.5, "restitution": 0.8}],
}
TWO_MASSES = {
    "form": "two_mass",
    "stops": [{"dof": 0, "lower": 1, "upper": 1, "restitution": 0.9}],
}
VIEWS = {
    "modes": ("modes", {"Omega": 1.365}, ".verdict >> text=certified"),
    "phantom": ("modes", {"Omega": 0.788}, ".verdict >> text=passed"),
    "driven": (
        "driven",
        {
            "structure": BELOW_A_WALL,
            "load": [{"dof": 0, "amplitude": 1.0}],
            "from": 2.2,
            "to": 4.4,
            "switch": 3,
        },
        ".special button",
    ),
    "attractors": (
        "attractors",
        {
            "structure": BETWEEN_JUMPS,
            "Omega": 1.4,
            "load": [{"dof": 0, "amplitude": 0.25}],
            "cells": 17,
        },
        ".readout >> text=motions settle",
    ),
    "history": ("history", {"mode": 2.3, "soft": True}, ".readout >> text=impacts"),
    "basins": ("basins", {"structure": TWO_MASSES}, ".readout >> text=motions"),
    "map": ("map", {"structure": {"form": "two_mass"}, "rows": 120}, ".readout >> text=points"),
}
"""Name of the picture -> view, fields of its address, and what tells that it is there."""


def _save(picture: bytes, name: str) -> None:
    """Save a picture with 256 colours, which text and curves do not miss."""
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    if name not in {"basins.png", "map.png"}:  # whose colours are more
        image = image.quantize(256, dither=Image.Dither.NONE)
    image.save(IMAGES / "console" / name, optimize=True)


def _pause(page: Page, place: str) -> None:
    slider = page.locator(".controls input[type=range]").first
    if slider.count():
        slider.fill(place)
        slider.blur()
    page.wait_for_timeout(300)


def _views(browser: Browser, url: str) -> None:
    for name, (view, fields, sign) in VIEWS.items():
        context = browser.new_context(viewport={"width": 1360, "height": 900})
        page = visit(context, url).open(view, **fields)
        page.locator(sign).first.wait_for(timeout=LONG)
        page.locator(".progress-line").wait_for(state="hidden", timeout=LONG)
        page.wait_for_timeout(1500)
        _pause(page, "0.42")
        if name == "phantom":
            page.get_by_role("button", name="Show the place").click()
            page.wait_for_timeout(300)
        _save(page.screenshot(full_page=True), f"{name}.png")
        context.close()


def _jobs(browser: Browser, url: str) -> None:
    context = browser.new_context(viewport={"width": 1360, "height": 520})
    made = visit(context, url)
    for view, fields in (("modes", {"points": 5000}), ("history", {"mode": 2.3})):
        page = made.open(view, **fields)
        page.locator(".readout").first.wait_for(timeout=LONG)
        page.wait_for_timeout(1500)
        if not page.get_by_role("button", name="Queue as a job").is_visible():
            page.get_by_text("Plan and request").click()
        page.get_by_role("button", name="Queue as a job").click()
        page.locator("table.jobs tbody tr").first.wait_for(timeout=LONG)
        page.wait_for_timeout(2000)
    _save(page.screenshot(), "jobs.png")
    context.close()


def _phone(browser: Browser, url: str) -> None:
    context = browser.new_context(viewport={"width": 390, "height": 844}, color_scheme="dark")
    page = visit(context, url).open("modes", Omega=1.365)
    page.locator(".verdict >> text=certified").wait_for(timeout=LONG)
    page.wait_for_timeout(2500)
    _pause(page, "0.42")
    page.locator("#modes-title").scroll_into_view_if_needed()
    part = {"x": 0.0, "y": 0.0, "width": 390.0, "height": 1500.0}
    _save(page.screenshot(full_page=True, clip=part), "phone.png")
    context.close()


def _docs(browser: Browser, url: str) -> None:
    context = browser.new_context(viewport={"width": 1360, "height": 1000})
    page = visit(context, url).page
    page.goto(f"{url}/docs")
    page.get_by_role("button", name="Send").click()
    page.locator("#operation >> text=200 OK").wait_for(timeout=LONG)
    _save(page.screenshot(), "docs.png")
    context.close()


def _recording(browser: Browser, url: str) -> None:
    """Record one period of the mode at each of some frequencies."""
    frames = []
    for Omega in (1.365, 2.3):
        context = browser.new_context(viewport={"width": 1180, "height": 900})
        page = visit(context, url).open("modes", Omega=Omega)
        page.locator(".verdict >> text=certified").wait_for(timeout=LONG)
        page.wait_for_timeout(1500)
        card = page.locator("section:has(canvas.shape)")
        for step in range(40):
            page.locator(".motion input[type=range]").fill(str(step / 40))
            page.locator(".motion input[type=range]").blur()
            picture = Image.open(io.BytesIO(card.screenshot())).convert("RGB")
            frames.append(picture.resize((720, round(720 * picture.height / picture.width))))
        context.close()
    size = min(frame.height for frame in frames)
    palette = frames[0].quantize(48)
    cut = [frame.crop((0, 0, 720, size)).quantize(palette=palette, dither=0) for frame in frames]
    cut[0].save(
        IMAGES / "moving-mode.gif", save_all=True, append_images=cut[1:], duration=60, loop=0
    )


def main() -> None:
    """Draw all pictures."""
    (IMAGES / "console").mkdir(parents=True, exist_ok=True)
    service = Service(Path(tempfile.mkdtemp(prefix="console-")))
    service.start()
    try:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
            for draw in (_views, _jobs, _phone, _docs, _recording):
                draw(browser, service.url)
            browser.close()
    finally:
        service.stop()


if __name__ == "__main__":
    main()
