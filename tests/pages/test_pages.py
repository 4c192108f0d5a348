"""The built documentation in a real Chromium: ``nox -s site`` builds it and runs this.

Every page is read by axe in light and dark, on a telephone and on a wide screen, and asks for
nothing from elsewhere: mathematics, fonts and scripts are the site's own.
"""

from __future__ import annotations

import functools
import http.server
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, sync_playwright

SITE = Path(os.environ.get("VIBROIMPACT_SITE", Path(__file__).parents[2] / "site"))
CHROMIUM = os.environ.get("VIBROIMPACT_CHROMIUM", "/usr/bin/chromium")
PAGES = sorted(path.parent.relative_to(SITE).as_posix() for path in SITE.rglob("index.html"))
SEEN = ("serious", "critical")
SETTLED = "() => document.getAnimations().every((each) => each.playState !== 'running')"
"""Colours that change by and by have arrived."""


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves files without a log."""

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture(scope="session")
def url() -> Iterator[str]:
    handler = functools.partial(Quiet, directory=str(SITE))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


def test_there_are_pages() -> None:
    assert len(PAGES) > 30, f"build the site first: mkdocs build ({SITE})"


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", PAGES)
def test_a_page_can_be_read_by_everybody(
    browser: Browser, url: str, name: str, scheme: str
) -> None:
    context = browser.new_context(color_scheme="dark" if scheme == "dark" else "light")
    page, wrong, asked = context.new_page(), list[str](), list[str]()
    page.on("console", lambda message: wrong.append(f"{message.type}: {message.text}"))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"{url}/{name}/")
    for width in (390, 1600):
        page.set_viewport_size({"width": width, "height": 900})
        page.wait_for_function(SETTLED)
        wrong += [f"{width}: {fault}" for fault in _faults(page)]
    context.close()
    assert wrong == []
    assert [each for each in asked if urlsplit(each).netloc != urlsplit(url).netloc] == []


def _faults(page: Page) -> list[str]:
    findings = Axe().run(page).response["violations"]
    faults = [
        f"{one['id']}: {one['help']}: {node['html'][:160]} {node['failureSummary'][:200]}"
        for one in findings
        if one["impact"] in SEEN
        for node in one["nodes"][:3]
    ]
    if page.locator(".katex-error").count():
        faults.append(f"formula: {page.locator('.katex-error').first.inner_text()}")
    formulas = page.locator(".arithmatex").count()
    if formulas != page.locator(".arithmatex > .katex, .arithmatex > .katex-display").count():
        faults.append("a formula is not drawn")
    wide, window = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
    if wide > window:
        faults.append(f"the page is {wide} wide")
    return faults
