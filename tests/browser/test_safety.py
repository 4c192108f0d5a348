"""Nothing that a result or an address says becomes markup, and nothing is loaded from elsewhere."""

from __future__ import annotations

import json

from playwright.sync_api import Route, expect

from tests.browser.visits import Visit

HOSTILE = "<img src=x onerror='window.hit=1'><script>window.hit=1</script>\" onmouseover='hit=1'"


def test_the_policy_permits_nothing_inline(console: Visit) -> None:
    for path in ("/", "/docs", "/console/main.js"):
        answer = console.page.request.get(console.url + path)
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "data:" not in policy


def test_hostile_jobs_stay_text(console: Visit) -> None:
    job = {
        "id": "job_1", "version": 1, "kind": HOSTILE, "state": HOSTILE, "final": True,
        "phase": HOSTILE, "waiting_reason": HOSTILE, "progress": {"done": 1, "total": 2},
        "created": "2026-11-23T02:00:00Z", "started": None, "finished": None,
        "attempts": 1, "digest": HOSTILE, "result": None,
        "error": {"detail": HOSTILE}, "reused": False, "estimate": None,
    }  # fmt: skip

    def answer(route: Route) -> None:
        route.fulfill(json={"jobs": [job], "next": None})

    began = "2026-11-23T02:00:00Z"
    history = [{"worker": HOSTILE, "began": began, "ended": began, "why": HOSTILE}]
    console.page.route("**/v1/jobs?*", answer)
    console.page.route("**/v1/jobs/job_*", lambda route: route.fulfill(json={"history": history}))
    page = console.open("jobs")
    expect(page.locator("table.jobs")).to_contain_text("onerror")
    page.locator("table.jobs summary").click()
    expect(page.locator(".attempts")).to_contain_text("onerror")
    assert page.locator("main img, main script").count() == 0
    assert page.evaluate("window.hit") is None


def test_hostile_results_problems_and_addresses_stay_text(console: Visit) -> None:
    page = console.page

    def spoilt(route: Route) -> None:
        document = route.fetch().json()
        document["reason"] = [HOSTILE for _ in document["reason"]]
        route.fulfill(json=document)

    page.route("**/v1/compute/impact-modes", spoilt)
    console.open("modes", {"form": "stored", "name": HOSTILE, "id": HOSTILE})
    expect(page.locator("#message")).not_to_be_empty()
    console.open("modes", {"form": "chain", "stops": [{"dof": 5, "upper": 0.2, "lower": 0.2}]})
    page.reload()
    expect(page.locator(".verdict")).to_contain_text("onerror")
    problem = {"detail": HOSTILE, "errors": [{"pointer": HOSTILE, "code": "x", "message": HOSTILE}]}
    page.unroute("**/v1/compute/impact-modes")
    page.route(
        "**/v1/compute/impact-modes",
        lambda route: route.fulfill(status=422, body=json.dumps(problem)),
    )
    page.get_by_label("Ω from").fill("0.7")
    expect(page.locator("#message")).to_contain_text("onerror")
    assert page.locator("main img, main script").count() == 0
    assert page.evaluate("window.hit") is None
