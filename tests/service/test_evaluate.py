"""The use case: computed once, answered at once or by a job, nothing kept of what is wrong."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import orjson
import pytest

from vibroimpact_service import problems
from vibroimpact_service.documents import parse, requests
from vibroimpact_service.documents.requests import Request
from vibroimpact_service.jobs.metrics import JobMetrics
from vibroimpact_service.jobs.records import NewJob
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.kinds import KINDS, Kind, Solver
from vibroimpact_service.metrics import Metrics
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results import representations
from vibroimpact_service.results.encoders import HDF5, JSON
from vibroimpact_service.results.representations import Results
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_service.use_case.charges import Admission
from vibroimpact_service.use_case.evaluation import Answer, Evaluation, Preference
from vibroimpact_solvers import impact_modes
from vibroimpact_solvers.errors import ConvergenceError

OWNER = "me"
PLAIN = Preference()


@dataclass(frozen=True)
class Counting(Kind):
    """Impact modes that count how often they are solved, and wait to be let go on."""

    calls: Any = None
    gate: Any = None
    error: Exception | None = None

    @property
    def solver(self) -> Solver:
        def solve(problem: Any, plan: Any, tick: Any = None) -> Any:
            self.calls.append(problem)
            assert self.gate.wait(60)
            if self.error is not None:
                raise self.error
            return impact_modes.solve(problem, plan)

        offered = ("Result", "plan", "split", "content", "join")
        given = {name: getattr(impact_modes, name) for name in offered}
        return SimpleNamespace(solve=solve, **given)  # type: ignore[return-value]


def counting(error: Exception | None = None) -> Counting:
    row = KINDS["impact-modes"]
    return Counting(
        row.name, row.title, row.request, row.result, row.axis,
        [], threading.Event(), error, extent=row.extent,
    )  # fmt: skip


async def charge(plan: Any, seconds: float) -> None:
    """Charge nothing."""


@pytest.fixture(params=[True, False], ids=["free", "charged"])
def free(request: pytest.FixtureRequest) -> Admission:
    """Return admissions with which a request is one call in a thread, and two."""
    return Admission(charge, request.param)


@pytest.fixture
def use(settings: Settings, store: Store, queue: Any) -> Iterator[Evaluation]:
    evaluation = Evaluation(settings, store, queue, Metrics(JobMetrics().registry))
    yield evaluation
    evaluation.close()


def run(main: Callable[[], Awaitable[Any]]) -> Any:
    async def bounded() -> Any:
        async with asyncio.timeout(60):
            value = await main()
            # What threads still do may have a charge to settle, for which a loop that is ending
            # has no time.
            await asyncio.get_running_loop().shutdown_default_executor()
            await asyncio.sleep(0)
            return value

    return asyncio.run(bounded())


def asked(content: dict[str, Any], kind: Kind | None = None, owner: str = OWNER) -> Request:
    kind = kind or KINDS["impact-modes"]
    return requests.read(owner, kind, parse.json(orjson.dumps(content)))


@pytest.mark.needs("compiled kernels")
def test_small_work_is_answered_at_once_and_known_the_next_time(
    use: Evaluation, request_body: dict[str, Any], free: Admission
) -> None:
    async def main() -> None:
        question = asked(request_body)
        first = await use.compute(question, PLAIN, JSON, free)
        second = await use.compute(asked(request_body), PLAIN, JSON, free)
        assert isinstance(first, Answer)
        assert isinstance(second, Answer)
        assert (first.cache, second.cache) == ("fwd=miss", "hit")
        assert set(first.seconds) == {"plan", "solve", "encode"}
        assert first.representation == second.representation
        file = await use.compute(question, PLAIN, HDF5, free)
        assert isinstance(file, Answer)
        assert file.cache == "hit"
        assert file.representation.data.startswith(b"\x89HDF")

    run(main)


def test_equal_requests_at_the_same_time_are_computed_once(
    use: Evaluation, request_body: dict[str, Any], free: Admission
) -> None:
    kind = counting()

    async def main() -> None:
        questions = [asked(request_body, kind) for _ in range(200)]
        waiting = [asyncio.create_task(use.compute(q, PLAIN, JSON, free)) for q in questions]
        while not kind.calls:
            await asyncio.sleep(0.01)
        kind.gate.set()
        answers = await asyncio.gather(*waiting)
        assert len(kind.calls) == 1
        assert len({answer.representation.data for answer in answers}) == 1
        assert [answer.cache for answer in answers].count("fwd=miss") == 1

    run(main)


def test_what_an_equal_request_computed_meanwhile_is_a_hit(
    use: Evaluation, request_body: dict[str, Any], free: Admission
) -> None:
    kind = counting()
    kind.gate.set()

    async def main() -> None:
        admitted, may = asyncio.Event(), asyncio.Event()

        async def slow(plan: Any, seconds: float) -> None:
            admitted.set()
            await may.wait()

        question = asked(request_body, kind)
        late = asyncio.create_task(use.compute(question, PLAIN, JSON, Admission(slow)))
        await admitted.wait()
        first = await use.compute(question, PLAIN, JSON, free)
        may.set()
        second = await late
        assert isinstance(first, Answer)
        assert isinstance(second, Answer)
        assert (first.cache, second.cache) == ("fwd=miss", "hit")
        assert len(kind.calls) == 1

    run(main)


def test_one_who_goes_away_takes_nothing_from_the_others(
    use: Evaluation, request_body: dict[str, Any], free: Admission
) -> None:
    kind = counting()

    async def main() -> None:
        question = asked(request_body, kind)
        impatient = asyncio.create_task(use.compute(question, PLAIN, JSON, free))
        while not kind.calls:
            await asyncio.sleep(0.01)
        patient = asyncio.create_task(use.compute(question, PLAIN, JSON, free))
        await asyncio.sleep(0.05)
        impatient.cancel()
        kind.gate.set()
        assert isinstance(await patient, Answer)
        assert len(kind.calls) == 1

    run(main)


def test_a_job_for_what_is_being_computed_waits_for_it(
    use: Evaluation, request_body: dict[str, Any], free: Admission, queue: Any
) -> None:
    kind = counting()

    async def main() -> None:
        question = asked(request_body, kind)
        inline = asyncio.create_task(use.compute(question, PLAIN, JSON, free))
        while not kind.calls:
            await asyncio.sleep(0.01)
        job = asyncio.create_task(use.submit(question, free, None))
        await asyncio.sleep(0.05)
        assert not queue.rows
        kind.gate.set()
        assert (await job).reused
        assert isinstance(await inline, Answer)

    run(main)


def test_a_job_that_is_computed_while_it_is_submitted_is_new_and_an_equal_one_reuses_it(
    settings: Settings, store: Store, queue: Any, request_body: dict[str, Any], free: Admission
) -> None:
    chosen = settings.model_copy(update={"on_submission_seconds": 10.0})
    use, kind, submitted = (
        Evaluation(chosen, store, queue, Metrics(JobMetrics().registry)),
        counting(),
        [],
    )

    async def submit(new: NewJob) -> NewJob:
        submitted.append(new)
        return new

    queue.submit = submit

    async def main() -> None:
        question = asked(request_body, kind)
        first = asyncio.create_task(use.submit(question, free, "first"))
        while not kind.calls:
            await asyncio.sleep(0.01)
        second = asyncio.create_task(use.submit(question, free, "second"))
        kind.gate.set()
        await asyncio.gather(first, second)

    try:
        run(main)
    finally:
        use.close()
    told = {new.key: (new.computed, new.reused) for new in submitted}
    assert told == {"first": (True, False), "second": (False, True)}
    assert len(kind.calls) == 1


def test_equal_requests_at_the_same_time_are_charged_once(
    use: Evaluation, request_body: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    kind, charged, asking, once = counting(), [], [], use.threads.once

    async def note(plan: Any, seconds: float) -> None:
        charged.append(seconds)

    async def noted(name: str, work: Any, seconds: float | None) -> Any:
        asking.append(name)
        return await once(name, work, seconds)

    monkeypatch.setattr(use.threads, "once", noted)

    async def main() -> None:
        question = asked(request_body, kind)
        first = asyncio.create_task(use.compute(question, PLAIN, JSON, Admission(note)))
        while not kind.calls:
            await asyncio.sleep(0.01)
        second = asyncio.create_task(use.compute(question, PLAIN, JSON, Admission(note)))
        while len(asking) < 2:
            await asyncio.sleep(0.01)
        kind.gate.set()
        answers = [await first, await second]
        assert [answer.cache for answer in answers] == ["fwd=miss", "fwd=miss; collapsed"]

    run(main)
    assert len(charged) == 1


def test_a_result_that_is_lost_or_damaged_is_computed_again(
    use: Evaluation, queue: Any, store: Store, request_body: dict[str, Any], free: Admission
) -> None:
    async def main() -> None:
        question = asked(request_body)
        job = await use.submit(question, free, None)
        quick = replace(job, queue="quick", state="succeeded")
        # Other solvers than those of the job would give it other numbers.
        old = replace(quick, result="0" * 64)
        assert await use.result_of(old, JSON) is None
        assert not list(store.results.entries())
        result = await use.result_of(quick, JSON)
        assert result is not None
        assert orjson.loads(result.data)["digest"] == question.digest
        # So is the damaged result of a long job.
        path = next((Path(store.url) / "results").glob("*/*"))
        path.write_bytes(path.read_bytes()[:-1] + b"?")
        use.results = Results(store)  # one that has nothing in memory
        result = await use.result_of(replace(quick, queue="bulk"), JSON)
        assert result is not None
        assert orjson.loads(result.data)["digest"] == question.digest
        store.requests.remove(job.request)
        assert await use.result_of(old, JSON) is None

    run(main)


def test_a_lost_result_whose_kernels_are_missing_is_left_to_the_workers(
    use: Evaluation, queue: Any, store: Store, request_body: dict[str, Any], free: Admission,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    # One job for each ten minutes: none may end while the first answer is waited for.
    monkeypatch.setattr("vibroimpact_service.use_case.evaluation._LOST_SECONDS", 1e12)

    async def main() -> None:
        question = asked(request_body)
        quick = replace(await use.submit(question, free, None), queue="quick", state="succeeded")
        use.warming.states["impact-modes"] = "warming"
        with pytest.raises(ProblemError) as error:
            await use.result_of(quick, JSON)
        assert error.value.type is problems.UNAVAILABLE
        assert not list(store.results.entries())  # nothing was compiled or computed here
        with pytest.raises(ProblemError):
            await use.result_of(quick, JSON)
        assert len(queue.rows) == 2  # however often it is asked for
        queue.run(list(queue.rows)[-1])
        result = await use.result_of(quick, JSON)
        assert result is not None
        assert orjson.loads(result.data)["digest"] == question.digest

    run(main)


def test_a_failed_computation_is_a_problem_for_all_and_may_be_tried_again(
    use: Evaluation, request_body: dict[str, Any], free: Admission, store: Store
) -> None:
    kind = counting(ConvergenceError("no root"))
    kind.gate.set()

    async def main() -> None:
        question = asked(request_body, kind)
        for _ in range(2):
            with pytest.raises(ConvergenceError):
                await use.compute(question, PLAIN, JSON, free)
        assert len(kind.calls) == 2
        assert not store.results.has(question.digest)

    run(main)


def test_large_work_becomes_a_job(
    store: Store, queue: Any, request_body: dict[str, Any], free: Admission
) -> None:
    use = Evaluation(
        Settings(data=Path("unused"), inline_seconds=0, on_submission_seconds=0),
        store,
        queue,
        Metrics(JobMetrics().registry),
    )

    async def main() -> None:
        question = asked(request_body)
        outcome = await use.compute(question, PLAIN, JSON, free)
        assert isinstance(outcome, JobRow)
        assert outcome.seconds > 0
        assert store.requests.get(outcome.request) == requests.stored_form(
            OWNER, question.canonical
        )
        assert not store.results.has(question.digest)
        queue.run(outcome.id)
        known = await use.compute(question, PLAIN, JSON, free)
        assert isinstance(known, Answer)

    run(main)
    use.close()


def test_preferences(
    use: Evaluation, queue: Any, request_body: dict[str, Any], free: Admission
) -> None:
    async def main() -> None:
        question = asked(request_body)
        first = await use.compute(question, Preference(respond_async=True), JSON, free)
        assert isinstance(first, JobRow)
        assert first.state == "queued"
        short = await use.compute(question, Preference(True, 0.05), JSON, free)
        assert isinstance(short, JobRow)
        queue.at_once = True
        waited = await use.compute(question, Preference(True, 5), JSON, free)
        assert isinstance(waited, Answer)
        again = await use.compute(question, Preference(respond_async=True), JSON, free)
        assert isinstance(again, JobRow)
        assert again.reused
        assert again.final

    run(main)


def test_a_failed_job_is_returned_as_a_job(
    use: Evaluation, queue: Any, store: Store, request_body: dict[str, Any], free: Admission
) -> None:
    async def main() -> None:
        question = asked(request_body)
        outcome = await use.compute(question, Preference(respond_async=True), JSON, free)
        assert isinstance(outcome, JobRow)
        store.requests.remove(outcome.request)
        queue.run(outcome.id)
        assert queue.rows[outcome.id].state == "failed"
        assert queue.rows[outcome.id].error["code"] == "unavailable"

    run(main)


def test_plans_do_no_work(
    use: Evaluation, store: Store, request_body: dict[str, Any], free: Admission
) -> None:
    async def main() -> None:
        question = asked(request_body)
        plan = await use.plan(question)
        assert plan.digest == question.digest
        assert not plan.cached
        assert plan.inline
        assert plan.seconds > 0
        assert [step.stage for step in plan.steps][:2] == ["spectrum", "impulse"]
        assert not store.results.has(question.digest)
        await use.compute(question, PLAIN, JSON, free)
        assert (await use.plan(question)).cached

    run(main)


def test_owners_do_not_share_names(use: Evaluation, request_body: dict[str, Any]) -> None:
    async def main() -> None:
        kind = KINDS["impact-modes"]
        mine = asked(request_body, kind, "me")
        yours = asked(request_body, kind, "you")
        assert mine.digest != yours.digest

    run(main)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("system", "constraints", 0, "dof"), 13),
        (("system", "constraints", 0, "gap"), 0),
        (("system", "n"), 501),
        (("frequency", "stop"), 0.5),
        (("frequency", "num"), 10**9),
        (("active",), [1]),
        (("color",), "red"),
    ],
)
def test_nothing_is_kept_of_what_is_wrong(
    use: Evaluation,
    store: Store,
    queue: Any,
    request_body: dict[str, Any],
    free: Admission,
    path: Any,
    value: Any,
) -> None:
    place: Any = request_body
    for part in path[:-1]:
        place = place[part]
    place[path[-1]] = value

    async def main() -> None:
        for preference in (PLAIN, Preference(respond_async=True)):
            with pytest.raises(ProblemError) as caught:
                await use.compute(asked(request_body), preference, JSON, free)
            assert caught.value.type in (problems.INVALID, problems.TOO_LARGE)

    run(main)
    assert not queue.rows
    assert not Path(store.url).exists()


def test_large_bodies_are_read_off_the_event_loop(
    use: Evaluation, request_body: dict[str, Any]
) -> None:
    request_body["frequency"] = {"values": [1.0 + i * 1e-6 for i in range(50_000)]}
    sent = orjson.dumps(request_body)

    async def main() -> None:
        stalls = []

        async def watch() -> None:
            loop = asyncio.get_running_loop()
            while True:
                before = loop.time()
                await asyncio.sleep(0.001)
                stalls.append(loop.time() - before)

        watching = asyncio.create_task(watch())
        await asyncio.sleep(0.01)
        count = len(stalls)
        question = await use.threads.parse(
            sent, lambda: requests.read(OWNER, KINDS["impact-modes"], parse.json(sent))
        )
        watching.cancel()
        assert len(stalls) > count  # the loop went on while the body was read
        assert question.document.frequency.count == 50_000

    run(main)


def test_too_many_waiting_requests_are_sent_away(
    settings: Settings, store: Store, queue: Any, request_body: dict[str, Any], free: Admission
) -> None:
    chosen = settings.model_copy(update={"max_waiting": 2, "inline_threads": 1})
    use = Evaluation(chosen, store, queue, Metrics(JobMetrics().registry))

    async def main() -> None:
        questions = []
        for number in range(8):
            content = {**request_body, "frequency": {"values": [1.0 + number]}}
            questions.append(asked(content))
        answers = await asyncio.gather(
            *(use.compute(q, PLAIN, JSON, free) for q in questions), return_exceptions=True
        )
        refused = [each for each in answers if isinstance(each, ProblemError)]
        assert len(refused) == 6
        assert {each.type for each in refused} == {problems.UNAVAILABLE}
        assert refused[0].headers["Retry-After"] == "1"
        assert isinstance(await use.compute(questions[-1], PLAIN, JSON, free), Answer)

    try:
        run(main)
    finally:
        use.close()


def test_a_wait_is_kept_whatever_runs(
    settings: Settings, store: Store, queue: Any, request_body: dict[str, Any], free: Admission
) -> None:
    """One computation takes the only thread for longer; another waits for the same thread."""
    chosen = settings.model_copy(update={"inline_threads": 1})
    use, kind = Evaluation(chosen, store, queue, Metrics(JobMetrics().registry)), counting()

    async def main() -> None:
        clock, held = asyncio.get_running_loop().time, asked(request_body, kind)
        other = asked({**request_body, "frequency": {"values": [3.0]}})
        blocked = asyncio.create_task(use.compute(held, PLAIN, JSON, free))
        while not kind.calls:
            await asyncio.sleep(0.01)
        for question in (held, other):
            began = clock()
            outcome = await use.compute(question, Preference(wait=1.0), JSON, free)
            assert clock() - began < 5.0  # else as long as the first one runs, 20 s
            assert isinstance(outcome, JobRow)
            assert outcome.state == "queued"
        kind.gate.set()
        assert isinstance(await blocked, Answer)

    try:
        run(main)
    finally:
        use.close()


@pytest.mark.parametrize("respond_async", [True, False])
@pytest.mark.parametrize("wait", [0.0, 0.001])
def test_no_wait_is_a_wait_for_nothing_but_the_job(
    use: Evaluation,
    queue: Any,
    request_body: dict[str, Any],
    free: Admission,
    wait: float,
    respond_async: bool,
) -> None:
    kind = counting()  # which computes nothing before the job is there

    async def main() -> None:
        question = asked(request_body, kind)
        job = await use.compute(question, Preference(respond_async, wait), JSON, free)
        assert isinstance(job, JobRow)
        assert (job.state, list(queue.rows)) == ("queued", [job.id])
        kind.gate.set()

    run(main)


def test_a_wait_is_kept_where_the_result_takes_long_to_read(
    settings: Settings,
    store: Store,
    queue: Any,
    request_body: dict[str, Any],
    free: Admission,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    chosen = settings.model_copy(update={"inline_seconds": 0.0, "on_submission_seconds": 0.0})
    queue.at_once = True
    use, load = (
        Evaluation(chosen, store, queue, Metrics(JobMetrics().registry)),
        representations.load,
    )
    read = threading.Event()

    def load_slowly(*arguments: Any) -> Any:
        read.wait(30.0)
        return load(*arguments)

    monkeypatch.setattr(representations, "load", load_slowly)

    async def main() -> None:
        clock, question = asyncio.get_running_loop().time, asked(request_body)
        began = clock()
        outcome = await use.compute(question, Preference(wait=1.0), HDF5, free)
        assert clock() - began < 5.0  # reading takes 30 s
        assert isinstance(outcome, JobRow)
        assert outcome.state == "succeeded"
        read.set()
        assert isinstance(await use.compute(question, Preference(wait=1.0), HDF5, free), Answer)

    try:
        run(main)
    finally:
        use.close()


def test_a_result_that_is_too_large_for_json_is_refused_before_it_is_computed(
    use: Evaluation, queue: Any, request_body: dict[str, Any], free: Admission
) -> None:
    kind = counting()
    kind.gate.set()
    large = {**request_body, "frequency": {"start": 1.0, "stop": 2.0, "num": 800_000}}
    large["outputs"] = ["impulse"]

    async def main() -> None:
        question = asked(large, kind)
        for preference in (PLAIN, Preference(wait=1)):
            with pytest.raises(ProblemError, match="x-hdf5") as refused:
                await use.compute(question, preference, JSON, free)
            assert refused.value.type is problems.NOT_ACCEPTABLE
        assert kind.calls == []
        assert queue.rows == {}
        # A job has no media type yet.
        job = await use.compute(question, Preference(respond_async=True), JSON, free)
        assert isinstance(job, JobRow)

    run(main)


def test_a_key_stands_for_one_request_whatever_answers_it(
    use: Evaluation, request_body: dict[str, Any], free: Admission
) -> None:
    async def main() -> None:
        question = asked(request_body)
        other = asked({**request_body, "frequency": {"values": [3.0]}})
        first = await use.compute(question, PLAIN, JSON, free, "key")
        assert isinstance(first, Answer)
        assert (await use.compute(question, PLAIN, HDF5, free, "key")).cache == "hit"
        for preference in (PLAIN, Preference(respond_async=True)):
            with pytest.raises(ProblemError) as clash:
                await use.compute(other, preference, JSON, free, "key")
            assert clash.value.type is problems.KEY_REUSED
        job = await use.compute(question, Preference(respond_async=True), JSON, free, "key")
        assert isinstance(job, JobRow)

    run(main)
