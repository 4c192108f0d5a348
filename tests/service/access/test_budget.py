"""Rates and quotas: what is left is said, too much is refused with the numbers."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from vibroimpact_service import problems
from vibroimpact_service.access import budget
from vibroimpact_service.access.caller import Caller, Scope
from vibroimpact_service.app import create_app
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_service.use_case import computation
from vibroimpact_solvers.plan import Plan

COMPUTE = "/v1/compute/impact-modes"


@pytest.fixture
def noon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the clock stand still in the midst of an hour, and of a minute.

    What is spent is counted by the minutes and hours of the clock: at the turn of one, there is
    room for more.
    """
    moment = time.time() // 3600.0 * 3600.0 + 1830.0
    monkeypatch.setattr(time, "time", lambda: moment)


@pytest.mark.usefixtures("noon")
def test_requests_are_counted_per_key(closed: TestClient, make_key: Any, bob: Any) -> None:
    key = make_key("ann", rate=5)
    left = []
    for _ in range(5):
        answer = closed.get("/v1/jobs", headers=key)
        assert answer.status_code == 200
        assert answer.headers["ratelimit-policy"] == '"requests";q=5;w=60;qu="requests"'
        left.append(answer.headers["ratelimit"].split(";")[1])
    assert left == ["r=4", "r=3", "r=2", "r=1", "r=0"]
    over = closed.get("/v1/jobs", headers=key)
    assert over.status_code == 429
    assert over.json()["code"] == "too_many_requests"
    assert 1 <= int(over.headers["retry-after"]) <= 120
    assert over.headers["ratelimit"].startswith('"requests";r=0;t=')
    assert closed.get("/v1/jobs", headers=bob).status_code == 200
    # Other errors say what is left as well.
    assert "ratelimit" in closed.get("/v1/jobs/x", headers=bob).headers


def _left(answer: Any) -> int:
    """Return the milliseconds that are left, from the header of an answer to a computation."""
    return int(answer.headers["ratelimit"].partition('"compute";r=')[2].partition(";")[0])


@pytest.mark.usefixtures("noon")
@pytest.mark.parametrize(("planned", "used"), [(0.9, 0.0), (0.001, 0.4)])
def test_what_was_used_is_charged_and_not_the_estimate(
    closed: TestClient,
    make_key: Any,
    request_body: dict[str, Any],
    monkeypatch: pytest.MonkeyPatch,
    planned: float,
    used: float,
) -> None:
    """The difference between estimate and use is given back, or taken."""
    quota, compute = 3.0, computation.compute
    spent: list[float] = []

    def busy(*arguments: Any) -> Any:
        began = time.thread_time()
        content = compute(*arguments)
        while time.thread_time() < began + used:
            pass
        spent.append(time.thread_time() - began)
        return content

    monkeypatch.setattr(computation, "compute", busy)
    monkeypatch.setattr(Plan, "seconds", planned)
    key, left = make_key("eve", seconds=quota), []
    for number in range(2):
        request_body["frequency"]["stop"] = 2.0 + 0.01 * number
        answer = closed.post(COMPUTE, json=request_body, headers=key)
        assert answer.status_code == 200
        left.append(_left(answer))
    # The first is held when it is answered, and settled when the second is.
    assert left[0] == 1000 * quota - 1000 * planned
    charged = 1e-3 * (left[0] - left[1])
    assert charged == pytest.approx(spent[0], abs=0.1)


@pytest.mark.usefixtures("noon")
def test_computing_that_is_planned_beyond_the_quota_is_refused(
    closed: TestClient,
    make_key: Any,
    request_body: dict[str, Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    used = budget.Budget.settle

    async def as_planned(self: budget.Budget, account: str, held: float, _used: float) -> None:
        await used(self, account, held, held)

    monkeypatch.setattr(budget.Budget, "settle", as_planned)
    plan = closed.post("/v1/plan/impact-modes", json=request_body, headers=make_key("ann")).json()
    quota = 2.5 * max(plan["seconds"], 0.001)
    key = make_key("eve", seconds=quota)
    answers = []
    for number in range(4):
        request_body["frequency"]["stop"] = 2.0 + 0.01 * number
        answers.append(closed.post(COMPUTE, json=request_body, headers=key))
    assert answers[0].status_code == 200
    assert '"compute";q=' in answers[0].headers["ratelimit-policy"]
    assert answers[-1].status_code == 429
    problem = answers[-1].json()
    assert problem["code"] == "quota_spent"
    assert f"of {quota:g} s per hour" in problem["detail"]
    assert "flops" in problem["detail"]
    assert int(answers[-1].headers["retry-after"]) >= 1
    # What is known costs nothing.
    request_body["frequency"]["stop"] = 2.0
    again = closed.post(COMPUTE, json=request_body, headers=key)
    assert (again.status_code, again.headers["cache-status"]) == (200, "vibroimpact; hit")


def test_a_computation_may_cost_too_much_at_all(
    settings: Settings, queue: Any, request_body: dict[str, Any]
) -> None:
    request_body["frequency"]["num"] = 100_000
    chosen = settings.model_copy(update={"max_job_seconds": 1e-4})
    with TestClient(create_app(chosen, queue)) as http:
        for path, body in (
            (COMPUTE, request_body),
            ("/v1/jobs", {"kind": "impact-modes", "request": request_body}),
        ):
            answer = http.post(path, json=body)
            assert answer.status_code == 413
            assert answer.json()["code"] == "too_costly"
            assert "0.0001 s" in answer.json()["detail"]


def test_unfinished_jobs_are_counted_per_owner(
    settings: Settings, queue: Any, request_body: dict[str, Any]
) -> None:
    chosen = settings.model_copy(update={"max_unfinished_jobs": 2})
    with TestClient(create_app(chosen, queue)) as http:
        codes = []
        for number in range(3):
            request_body["frequency"]["stop"] = 2.0 + number
            body = {"kind": "impact-modes", "request": request_body}
            codes.append(http.post("/v1/jobs", json=body))
        assert [a.status_code for a in codes] == [201, 201, 429]
        assert codes[-1].json()["code"] == "too_many_jobs"
        assert codes[-1].headers["retry-after"] == "10"


@pytest.mark.usefixtures("noon")
def test_guessing_keys_ends_soon(closed: TestClient, ann: dict[str, str]) -> None:
    codes = {closed.get("/v1/jobs").status_code for _ in range(60)}
    assert codes == {401}
    over = closed.get("/v1/jobs")
    assert over.status_code == 429
    assert over.headers["retry-after"]
    assert closed.get("/v1/jobs", headers=ann).status_code == 200


@pytest.mark.parametrize(
    ("before", "before_left", "here", "rest", "cost", "seconds"),
    [
        # Room for 60 per minute. A minute that ended with 60 frees one per second.
        (60, 60.0, 0, 60.0, 1, 1),
        (60, 60.0, 0, 60.0, 10, 10),
        # All spent in this minute: nothing fades before it ends in 20 s, then one per second.
        (0, 0.0, 60, 20.0, 1, 21),
        (0, 0.0, 60, 20.0, 30, 50),
    ],
)
def test_the_wait_until_a_cost_has_room(
    before: float, before_left: float, here: float, rest: float, cost: int, seconds: int
) -> None:
    assert budget._wait(cost, 60, 60, before, before_left, here, rest) == seconds


@pytest.mark.usefixtures("noon")
def test_a_computation_costs_as_many_milliseconds_as_planned() -> None:
    caller = Caller("ann", "key", frozenset(Scope), seconds_per_hour=1.0)
    plan = Plan("impact-modes", ())

    async def scenario() -> None:
        spent = budget.Budget(Settings(data=Path("unused")))
        left = [
            (await spent.spend(caller, plan, seconds))["RateLimit"].split(";")[1]
            for seconds in (0.4, 0.4)
        ]
        assert left == ["r=600", "r=200"]
        with pytest.raises(ProblemError, match=r"0\.2 s are left of 1 s") as caught:
            await spent.spend(caller, plan, 0.4)
        assert caught.value.type is problems.QUOTA_SPENT
        assert "r=0" in (await spent.spend(caller, plan, 0.2))["RateLimit"]

        await spent.settle("key", 0.4, 0.1)  # what was not used is given back
        assert "r=200" in (await spent.spend(caller, plan, 0.1))["RateLimit"]
        await spent.settle("key", 0.1, 2.0)  # and what was used beyond the quota is taken
        with pytest.raises(ProblemError):
            await spent.spend(caller, plan, 0.001)

    asyncio.run(scenario())


@pytest.mark.usefixtures("noon")
@pytest.mark.parametrize(("age", "left"), [(0.0, 1000), (900.0, 850), (3600.0, 400), (9e9, 400)])
def test_no_more_is_given_back_than_is_left_of_what_was_held(age: float, left: int) -> None:
    """What is counted fades within the hour: a job of two hours must not earn a quota."""
    caller = Caller("ann", "key", frozenset(Scope), seconds_per_hour=1.0)

    async def scenario() -> None:
        spent = budget.Budget(Settings(data=Path("unused")))
        await spent.spend(caller, Plan("impact-modes", ()), 0.6)
        await spent.settle("key", 0.6, 0.0, age)
        answer = await spent.spend(caller, Plan("impact-modes", ()), 0.0)
        assert f"r={left};" in answer["RateLimit"]

    asyncio.run(scenario())


def test_a_changed_quota_counts_what_was_used_before_the_change() -> None:
    before = Caller("ann", "key", frozenset(Scope), seconds_per_hour=10.0)
    after = Caller("ann", "key", frozenset(Scope), seconds_per_hour=5.0)

    async def scenario() -> None:
        spent, plan = budget.Budget(Settings(data=Path("unused"))), Plan("impact-modes", ())
        await spent.spend(before, plan, 4.0)
        with pytest.raises(ProblemError, match="1 s are left of 5 s"):
            await spent.spend(after, plan, 2.0)

    asyncio.run(scenario())
