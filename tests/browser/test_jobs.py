"""Jobs in the console: live, cancelled, downloaded, sent again; and the service away and back."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys

import pytest
from playwright.sync_api import Browser, Page, Route, expect

from tests.browser.visits import Service, Visit, visit


def _queue(page: Page) -> None:
    # It stays open from the view before.
    if page.locator("#requests details[open]").count() == 0:
        page.get_by_text("Plan and request").click()
    page.get_by_role("button", name="Queue as a job").click()
    expect(page.locator("#jobs-title")).to_be_visible()


def test_a_job_is_followed_to_its_end_and_downloaded(console: Visit) -> None:
    page = console.open("modes", points=4001)
    expect(page.locator(".readout")).to_contain_text("4001 frequencies")
    _queue(page)
    row = page.locator("table.jobs tbody tr").first
    expect(row).to_contain_text("succeeded")
    with page.expect_download() as saved:
        row.get_by_role("button", name=re.compile("^JSON")).click()
    assert b'"impulse"' in saved.value.path().read_bytes()
    row.get_by_role("link", name=re.compile("Open the view")).click()
    expect(page.get_by_label("points")).to_have_value("4001")


def test_another_browser_shows_the_name_with_which_a_job_was_queued(
    console: Visit, browser: Browser
) -> None:
    page = console.open("modes", {"form": "two_mass"}, points=1234)
    expect(page.locator(".readout").first).to_contain_text("1234 frequencies")
    _queue(page)
    expect(page.locator("table.jobs tbody tr").first).to_contain_text("Two coupled masses")
    named = {"kind": "natural-frequencies", "name": "tube, gap 0.2 mm"}
    system = {"preset": "chain", "n": 7}
    sent = page.request.post(
        f"{console.url}/v1/jobs", data={**named, "request": {"system": system}}
    )
    context = browser.new_context()
    other = visit(context, console.url).open("jobs")
    row = other.locator("table.jobs tbody tr", has_text=sent.json()["id"][:12])
    expect(row).to_contain_text("tube, gap 0.2 mm")
    expect(other.locator("table.jobs tbody")).to_contain_text("Two coupled masses")
    other.get_by_role("searchbox").fill("tube gap")
    expect(other.locator("table.jobs tbody tr:visible")).to_have_count(1)
    context.close()


def test_a_job_is_cancelled_and_sent_again(console: Visit) -> None:
    # The bands of a beam of ten elements are many: an hour's work.
    page = console.open("modes", {"form": "beam", "parameters": {"elements": 10}})
    expect(page.locator(".content")).to_contain_text(
        re.compile("Certified bands take about|The stability of the bands takes about")
    )
    page.get_by_text("Plan and request").click()
    page.get_by_role("button", name="Bands", exact=True).click()
    page.get_by_role("button", name="Queue as a job").click()
    row = page.locator("table.jobs tbody tr").first
    row.get_by_role("button", name=re.compile("^Cancel")).click()
    expect(row).to_contain_text("cancelled")
    row.get_by_role("button", name=re.compile("^Submit again")).click()
    first = page.locator("table.jobs tbody tr").first
    expect(first).to_contain_text(re.compile("queued|running"))
    first.get_by_role("button", name=re.compile("^Cancel")).click()
    expect(first).to_contain_text("cancelled")


def test_a_failed_job_is_tried_again_and_shows_its_attempts(console: Visit) -> None:
    page = console.open("jobs")
    stop = {"dof": 6, "gap": 0.05}
    request = {
        "system": {"preset": "chain", "n": 60, "constraints": [stop, stop | {"dof": 40}]},
        "frequency": {"start": 0.05, "stop": 2.6},
        "outputs": ["bands", "stability"],
    }
    job = {"kind": "existence-bands", "request": request, "deadline_seconds": 5}
    made = page.request.post(f"{console.url}/v1/jobs", data=job).json()
    row = page.locator("table.jobs tbody tr", has_text=made["id"][:12])
    expect(row).to_contain_text("failed")
    row.locator("summary").click()
    expect(row.locator(".attempts li")).to_have_count(1)
    with page.expect_response("**/retry") as answer:
        row.get_by_role("button", name=re.compile("^Retry")).click()
    assert answer.value.ok
    expect(row).to_contain_text(re.compile("queued|running|failed"))


def test_the_request_of_a_job_is_taken_away_as_curl_and_python(console: Visit) -> None:
    console.page.add_init_script(
        """navigator.clipboard.writeText = (text) => {
          window.copied = text; return Promise.resolve();
        };"""
    )
    page = console.open("modes", points=901)
    expect(page.locator(".readout")).to_contain_text("901 frequencies")
    _queue(page)
    row = page.locator("table.jobs tbody tr").first
    row.get_by_role("button", name=re.compile("^curl")).click()
    command = shlex.split(page.evaluate("window.copied").replace("\\\n", " "))
    sent = json.loads(command[command.index("-d") + 1])
    assert sent["frequency"]["num"] == 901
    row.get_by_role("button", name=re.compile("^Python")).click()
    code = page.evaluate("window.copied")
    # The program as it is, against this service.
    code = code.replace("result.plot()", "print(len(result.Omega))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["901"]


def test_faults_stand_at_their_fields(console: Visit) -> None:
    page = console.open("modes")
    expect(page.locator(".readout")).to_contain_text("1500 frequencies")
    page.get_by_role("group", name="Stop 0").get_by_label("Coordinate").fill("13")
    field = page.get_by_role("group", name="Stop 0").get_by_label("Coordinate")
    expect(field).to_have_attribute("aria-invalid", "true")
    note = page.locator(f"#{field.get_attribute('aria-describedby')}")
    expect(note).not_to_be_empty()
    field.fill("4")
    expect(field).not_to_have_attribute("aria-invalid", "true")
    page.get_by_label("Ω from").fill("5")
    expect(page.get_by_label("to", exact=True)).to_have_attribute("aria-invalid", "true")


def test_the_service_goes_away_and_comes_back(
    browser: Browser, tmp_path_factory: pytest.TempPathFactory
) -> None:
    own = Service(tmp_path_factory.mktemp("away"))
    own.start()
    context = browser.new_context(viewport={"width": 1600, "height": 1000})
    made = visit(context, own.url)
    page = made.open("modes")
    expect(page.locator(".verdict")).to_contain_text("Admissible")
    own.stop()
    page.get_by_label("Ω of the cursor", exact=True).fill("2.4")
    expect(page.locator("#away")).to_be_visible()
    expect(page.locator(".verdict")).to_contain_text("Admissible")
    own.start()
    expect(page.locator("#away")).to_be_hidden()
    expect(page.locator(".values")).to_contain_text("2.4")
    context.close()
    own.stop()


def test_a_busy_service_is_asked_again(console: Visit) -> None:
    refused: list[str] = []

    def answer(route: Route) -> None:
        if len(refused) < 2:
            refused.append(route.request.url)
            problem = {"detail": "3 requests are waiting already."}
            route.fulfill(status=503, headers={"Retry-After": "1"}, json=problem)
        else:
            route.continue_()

    console.page.route("**/compute/impact-modes", answer)
    page = console.open("modes")
    expect(page.locator(".verdict")).to_contain_text("Admissible")
    assert len(refused) == 2
    expect(page.locator("#message")).to_be_empty()


def test_two_users_see_their_own_jobs(
    browser: Browser, tmp_path_factory: pytest.TempPathFactory
) -> None:
    data = tmp_path_factory.mktemp("keys")
    keys = {}
    for user in ("ann", "bob"):
        command = [sys.executable, "-m", "vibroimpact.cli", "keys", "create", user, "--data", data]
        made = subprocess.run(command, capture_output=True, check=True, text=True)
        keys[user] = re.search(r"vik_\S+", made.stdout + made.stderr)[0]  # type: ignore[index]
    own = Service(data)
    own.start()
    context = browser.new_context(viewport={"width": 1600, "height": 1000})
    pages = {user: visit(context, own.url).open("jobs") for user in keys}
    for user, page in pages.items():
        # Without a key the page asks for one.
        page.get_by_label("Kept by this tab").fill(keys[user])
        page.get_by_label("Kept by this tab").press("Enter")
        expect(page.get_by_text("There are no jobs yet.")).to_be_visible()
    page = pages["ann"]
    page.get_by_role("link", name="Impact modes").click()
    expect(page.locator(".verdict")).to_contain_text("Admissible")
    _queue(page)
    expect(page.locator("table.jobs tbody tr").first).to_contain_text("succeeded")
    other = pages["bob"]
    other.wait_for_timeout(5000)
    expect(other.get_by_text("There are no jobs yet.")).to_be_visible()
    context.close()
    own.stop()


def test_jobs_have_names_structures_and_a_search(console: Visit) -> None:
    for points in (701, 702):
        page = console.open("modes", points=points)
        expect(page.locator(".readout")).to_contain_text(f"{points} frequencies")
        _queue(page)
    rows = page.locator("table.jobs tbody tr")
    first = rows.first
    expect(first).to_contain_text("Chain of masses between walls, masses 13")
    expect(first).to_contain_text(re.compile(r"\d{4}.*job_"))  # with its date
    name = first.get_by_label(re.compile("^Name of job"))
    name.fill("the second one")
    name.press("Enter")
    # It is kept, and found.
    page.reload()
    expect(name).to_have_value("the second one")
    page.get_by_role("searchbox").fill("SECOND one")
    expect(page.locator("table.jobs tbody tr:visible")).to_have_count(1)
    page.get_by_role("searchbox").fill("no such words")
    expect(page.get_by_text("No job that is loaded has these words.")).to_be_visible()
    page.get_by_role("searchbox").fill("second")
    visible = page.locator("table.jobs tbody tr:visible")
    visible.get_by_role("button", name=re.compile("^Remove")).click()
    expect(visible).to_have_count(0)
    page.reload()
    page.get_by_role("searchbox").fill("second")
    expect(page.get_by_text("No job that is loaded has these words.")).to_be_visible()


def test_a_phone_shows_all_of_a_job(console: Visit) -> None:
    console.page.set_viewport_size({"width": 390, "height": 844})
    page = console.open("modes", points=777)
    expect(page.locator(".readout").first).to_contain_text("777 frequencies")
    page.get_by_text("Plan and request").click()
    page.get_by_role("button", name="Queue as a job").click()
    row = page.locator("table.jobs tbody tr").first
    expect(row).to_contain_text("succeeded")
    for part in (row.locator(".named"), row.get_by_role("button", name=re.compile("HDF5"))):
        box = part.bounding_box()
        assert box is not None
        assert 0 < box["x"] < box["x"] + box["width"] <= 390
    assert page.evaluate("document.documentElement.scrollWidth") == 390


def test_two_runs_stand_side_by_side(console: Visit) -> None:
    for points in (801, 802):
        page = console.open("modes", {"form": "oscillator"}, points=points)
        expect(page.locator(".readout")).to_contain_text(f"{points} frequencies")
        _queue(page)
    compare = page.get_by_role("button", name="Compare the two chosen")
    expect(compare).to_be_disabled()
    boxes = page.get_by_role("checkbox", name=re.compile("^Choose job"))
    boxes.nth(0).check()
    boxes.nth(1).check()
    compare.click()
    expect(page.locator("figure.kept")).to_contain_text("of 802 frequencies")
    expect(page.locator(".readout")).to_contain_text("of 801 frequencies")


def test_what_views_compute_while_one_looks_is_no_entry_of_the_list(console: Visit) -> None:
    structure = {"form": "oscillator", "damping": 0.05}
    with console.page.expect_response("**/compute/branches") as answer:
        page = console.open("driven", structure, points=40, **{"from": 0.8, "to": 1.2})
        expect(page.locator(".readout").first).to_contain_text("solutions")
        if page.get_by_role("button", name="Follow them").count():
            page.get_by_role("button", name="Follow them").click()
    job = answer.value.json()["id"][:12]
    page.get_by_role("link", name="Jobs").click()
    expect(page.locator("#jobs-title")).to_be_visible()
    entry = page.locator("table.jobs tbody tr", has_text=job)
    expect(entry).to_have_count(1)
    expect(entry).to_be_hidden()
    page.get_by_label("with those that views made").check()
    expect(entry).to_be_visible()
