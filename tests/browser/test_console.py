"""The pages in a real Chromium: they work, ask nobody else, and can be used by everybody.

Not among the tests that always run, for want of a browser: ``nox -s browser`` runs them with
the Chromium that VIBROIMPACT_CHROMIUM names, or /usr/bin/chromium.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect, sync_playwright

CHROMIUM = os.environ.get("VIBROIMPACT_CHROMIUM", "/usr/bin/chromium")
SHOTS = Path(os.environ.get("VIBROIMPACT_SHOTS", "/tmp"))


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    data = tmp_path_factory.mktemp("console")
    process = subprocess.Popen(
        [sys.executable, "-m", "vibroimpact_service", "--port", "0", "--data", str(data)],
        env={**os.environ, "OMP_NUM_THREADS": "1", "VIBROIMPACT_WORKERS": "1"},
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    note, end = data / "service.json", time.monotonic() + 60
    while not note.exists():
        assert process.poll() is None
        assert time.monotonic() < end
        time.sleep(0.05)
    yield json.loads(note.read_text())["url"]
    process.terminate()
    process.wait(30)


@pytest.fixture
def page(url: str) -> Iterator[Page]:
    """Return a page that fails the test on a request elsewhere or a word on its console."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        wrong: list[str] = []
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        yield page
        assert {urlsplit(each).netloc for each in asked} == {urlsplit(url).netloc}
        assert [w for w in wrong if "503" not in w and "422" not in w] == []
        browser.close()


def test_a_request_is_computed_and_drawn(page: Page, url: str) -> None:
    answer = page.goto(url)
    assert answer is not None
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    page.get_by_role("button", name="Compute").click()
    expect(page.locator("#caption")).to_contain_text("1500 frequencies", timeout=60_000)
    assert page.locator("polyline.real").count() >= 2
    assert page.locator("polyline.phantom").count() >= 2
    assert page.locator("rect.band").count() >= 2
    box = page.locator("#plot").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 3)
    expect(page.locator("#caption")).to_contain_text("Ω = ")
    expect(page.locator("#health")).to_have_text("ready", timeout=60_000)
    page.screenshot(path=SHOTS / "console.png", full_page=True)


def test_a_job_is_queued_listed_and_drawn(page: Page, url: str) -> None:
    page.goto(url)
    page.get_by_label("points").fill("4000")
    page.get_by_role("button", name="Queue as a job").click()
    row = page.locator("#jobs tr").first
    expect(row).to_contain_text("succeeded", timeout=90_000)
    row.get_by_role("button").click()
    expect(page.locator("#caption")).to_contain_text("4000 frequencies")
    page.screenshot(path=SHOTS / "console-job.png", full_page=True)


def test_faults_are_shown_with_their_places(page: Page, url: str) -> None:
    page.goto(url)
    page.get_by_label("Degree of freedom").fill("13")
    page.get_by_role("button", name="Compute").click()
    expect(page.get_by_role("alert")).to_contain_text("/system/constraints/0")


@pytest.mark.parametrize("path", ["/", "/docs"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_pages_can_be_used_by_everybody(page: Page, url: str, path: str, scheme: str) -> None:
    page.emulate_media(color_scheme=scheme)
    page.goto(url + path)
    page.wait_for_load_state("networkidle")
    found = Axe().run(page, options={"runOnly": ["wcag2a", "wcag2aa", "best-practice"]})
    assert found.violations_count == 0, found.generate_report()
    page.set_viewport_size({"width": 400, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    page.screenshot(path=SHOTS / f"page{path.replace('/', '-')}{scheme}.png")


def test_the_contract_is_readable(page: Page, url: str) -> None:
    page.goto(url + "/docs")
    expect(page.locator("#compute_impact_modes h3")).to_have_text("POST /v1/compute/impact-modes")
    page.set_viewport_size({"width": 1280, "height": 900})
    page.screenshot(path=SHOTS / "docs.png")
