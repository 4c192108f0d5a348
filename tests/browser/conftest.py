"""A service and a real Chromium, which fails a test on any request to another origin.

Not among the tests that always run, for want of a browser: ``nox -s browser`` runs them with
the Chromium that VIBROIMPACT_CHROMIUM names, or /usr/bin/chromium.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, expect, sync_playwright

from tests.browser.visits import LONG, Service, Visit, visit

CHROMIUM = os.environ.get("VIBROIMPACT_CHROMIUM", "/usr/bin/chromium")

expect.set_options(timeout=LONG)


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    running = Service(tmp_path_factory.mktemp("console"))
    running.start()
    yield running
    running.stop()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def console(browser: Browser, service: Service) -> Iterator[Visit]:
    """Return a page that fails the test on a request elsewhere or an error on its console."""
    context = browser.new_context(
        viewport={"width": 1600, "height": 1000}, permissions=["clipboard-write"]
    )
    made = visit(context, service.url)
    yield made
    context.close()
    origins = {urlsplit(each).netloc for each in made.asked if not each.startswith("blob:")}
    assert origins <= {urlsplit(service.url).netloc}
    # Chromium reports every answer with an error status there; the tests look at those themselves.
    assert [text for text in made.wrong if "Failed to load resource" not in text] == []
