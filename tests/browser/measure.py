"""Measure the pages in a real Chromium: ``python -m tests.browser.measure``, as ``nox`` runs it.

Prints the size of what the first view loads, the time until it is drawn, the frame times of an
animation of 200 masses, and the time from a move of the cursor to the mode that it shows.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from tests.browser.conftest import CHROMIUM
from tests.browser.visits import LONG, Service, received, visit

CHAIN = {
    "form": "chain",
    "parameters": {"n": 200},
    "stops": [{"dof": 99, "lower": 0.2, "upper": 0.2}],
}

FRAMES = """() => new Promise((resolve) => {
  const times = [];
  let last = 0;
  const frame = (now) => {
    if (last) times.push(now - last);
    last = now;
    if (times.length < 240) requestAnimationFrame(frame);
    else resolve(times);
  };
  requestAnimationFrame(frame);
})"""
"""Times between the frames of the display while the page animates."""

WORK = """() => new Promise((resolve) => {
  const draw = CanvasRenderingContext2D.prototype.clearRect;
  const times = [];
  let began = 0;
  CanvasRenderingContext2D.prototype.clearRect = function (...area) {
    if (this.canvas.className === "shape") {
      began = performance.now();
      queueMicrotask(() => times.push(performance.now() - began));
    }
    return draw.apply(this, area);
  };
  setTimeout(() => resolve(times), 4000);
})"""
"""Times that the drawing of one frame takes."""


def _percentile(values: list[float], share: float) -> float:
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def _sizes(browser: Browser, url: str) -> None:
    context = browser.new_context()
    page = context.new_page()
    sizes = received(page)
    for path, sign in (("/", ".verdict >> text=certified"), ("/docs", "#operation h2")):
        page.goto(url + path)
        page.locator(sign).wait_for(timeout=LONG)
        print(f"received until {path} is there: {sum(sizes.values()) / 1e3:.1f} kB")
    context.close()


def _first_view(browser: Browser, url: str) -> None:
    times = []
    for _ in range(7):
        context = browser.new_context(viewport={"width": 1600, "height": 1000})
        page = visit(context, url).page
        began = time.perf_counter()
        page.goto(url)
        page.locator(".readout >> text=frequencies").wait_for(timeout=LONG)
        times.append(time.perf_counter() - began)
        context.close()
    print(f"first view, s: median {statistics.median(times):.2f}, all {sorted(times)}")


def _frames(browser: Browser, url: str) -> None:
    context = browser.new_context(viewport={"width": 1600, "height": 1000})
    page = visit(context, url).open("modes", CHAIN, Omega=2.2, points=300)
    page.locator(".verdict >> text=certified").wait_for(timeout=LONG)
    page.wait_for_timeout(1500)
    times = page.evaluate(FRAMES)
    work = page.evaluate(WORK)
    print(
        f"N=200, ms between frames: median {statistics.median(times):.1f}, "
        f"p95 {_percentile(times, 0.95):.1f}, max {max(times):.1f}; "
        f"ms of drawing a frame: median {statistics.median(work):.2f}, "
        f"p95 {_percentile(work, 0.95):.2f}"
    )
    context.close()


def _cursor(browser: Browser, url: str, n: int) -> None:
    structure = CHAIN | {"parameters": {"n": n}}
    structure["stops"] = [{"dof": n // 2 - 1, "lower": 0.2, "upper": 0.2}]
    context = browser.new_context(viewport={"width": 1600, "height": 1000})
    page = visit(context, url).open("modes", structure, Omega=2.3, points=300)
    page.locator(".verdict >> text=certified").wait_for(timeout=LONG)
    page.wait_for_timeout(1500)
    slider = page.get_by_role("slider", name="Frequency Ω of the cursor")
    for step in range(60):
        slider.fill(str(2.1 + 0.004 * step))
        page.wait_for_timeout(120)
    # From the request to the mode on the canvas; the browser's own clock.
    times = page.evaluate("performance.getEntriesByName('cursor').map((each) => each.duration)")
    times = times[-50:]
    print(
        f"cursor to the mode drawn, N={n}, ms: median {statistics.median(times):.1f}, "
        f"p95 {_percentile(times, 0.95):.1f}, {len(times)} moves"
    )
    context.close()


def main() -> None:
    """Measure everything once."""
    service = Service(Path(tempfile.mkdtemp(prefix="console-")))
    service.start()
    print("load of the machine:", os.getloadavg())
    try:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
            _sizes(browser, service.url)
            _first_view(browser, service.url)
            _frames(browser, service.url)
            for n in (13, 200):
                _cursor(browser, service.url, n)
            browser.close()
    finally:
        service.stop()
    print("load of the machine:", os.getloadavg())


if __name__ == "__main__":
    main()
