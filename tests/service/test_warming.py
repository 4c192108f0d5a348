"""Kernels are compiled beforehand, in processes that may fail, be killed, or meet others."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import time
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import orjson
import pytest
import structlog.testing
from starlette.testclient import TestClient
from typer.testing import CliRunner

from tests.service.compiling import failing, killed, noted
from vibroimpact_schema import examples
from vibroimpact_service import cli
from vibroimpact_service.app import create_app
from vibroimpact_service.documents import parse, planning, requests
from vibroimpact_service.jobs.metrics import JobMetrics
from vibroimpact_service.jobs.tables import JobRow
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.metrics import Metrics
from vibroimpact_service.results.encoders import JSON
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import warming
from vibroimpact_service.use_case.charges import Admission
from vibroimpact_service.use_case.evaluation import Answer, Evaluation, Preference
from vibroimpact_service.use_case.warming import STEPS, Warming, is_warm
from vibroimpact_service.use_case.warming_problems import PROBLEMS
from vibroimpact_solvers.kernels import cache


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the kernels."""
    folder = tmp_path / "kernels"
    folder.mkdir()
    monkeypatch.setattr("vibroimpact_solvers.kernels.cache.folder", lambda *_: folder)
    return folder


@pytest.fixture
def runner(monkeypatch: pytest.MonkeyPatch) -> CliRunner:
    """Return what runs commands, whose log would go on to a stream that is closed by then."""
    monkeypatch.setattr("vibroimpact_service.logs.to_stderr", lambda: None)
    return CliRunner()


@pytest.fixture
def notes(tmp_path: Path) -> Path:
    """Return the folder in which attempts are counted."""
    folder = tmp_path / "notes"
    folder.mkdir()
    return folder


def attempts(notes: Path) -> dict[str, int]:
    return {file.name: file.stat().st_size for file in notes.iterdir()}


def run(*several: Warming) -> None:
    for each in several:
        each.start()
    for each in several:
        assert list(each.progress())[-1] == len(KINDS)
        each.close()


def test_every_kind_is_compiled_once(place: Path, notes: Path) -> None:
    first, second = Warming(partial(noted, notes)), Warming(partial(noted, notes))
    assert first.summary == "warm"  # nobody compiles anything beforehand
    assert first.start() == place
    assert first.summary == "warming"
    assert first.states["impact-modes"] == first.states["time-history"] == "warming"
    run(first, second)
    assert first.summary == second.summary == "warm"
    assert attempts(notes) == dict.fromkeys(STEPS, 1)
    third = Warming(partial(noted, notes))
    third.start()
    assert third.summary == "warm"  # at once
    assert attempts(notes) == dict.fromkeys(STEPS, 1)


def test_it_ends_where_no_process_can_be_started(
    place: Path, notes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where there is no memory for one, or the server that forks them has died."""

    def start(process: Any) -> None:
        raise EOFError("unexpected EOF")

    monkeypatch.setattr("multiprocessing.context.ForkServerProcess.start", start)
    run(warming := Warming(partial(noted, notes)))
    assert set(warming.states.values()) == {"failed"}
    assert attempts(notes) == {}


def test_two_services_that_start_at_once_share_the_work(place: Path, notes: Path) -> None:
    run(*(Warming(partial(noted, notes, seconds=0.1)) for _ in range(2)))
    assert all(is_warm(place, kind) for kind in KINDS)
    assert attempts(notes) == dict.fromkeys(STEPS, 1)


def test_a_kind_that_cannot_be_compiled_does_not_stop_the_others(place: Path, notes: Path) -> None:
    some = Warming(partial(failing, notes))
    run(some)
    assert some.summary == "failed: time-history"
    assert [kind for kind in KINDS if some.states[kind] != "warm"] == ["time-history"]
    assert not is_warm(place, "time-history")
    later = Warming(partial(noted, notes))  # the next start tries again, and that kind alone
    run(later)
    assert later.summary == "warm"
    assert attempts(notes) == dict.fromkeys(STEPS, 1) | {"time-history": 3}


@pytest.mark.parametrize(("times", "state"), [(1, "warm"), (2, "failed: slow-flow")])
def test_a_process_that_is_killed_is_started_once_more(
    place: Path, notes: Path, times: int, state: str
) -> None:
    some = Warming(partial(killed, notes, times))
    run(some)
    assert some.summary == state
    assert is_warm(place, "slow-flow") == (state == "warm")
    assert attempts(notes) == dict.fromkeys(STEPS, 1) | {"slow-flow": 2}


def test_a_service_that_stops_does_not_wait(place: Path, notes: Path) -> None:
    some = Warming(partial(noted, notes, seconds=3600.0))
    with some.in_background():
        while not attempts(notes):
            time.sleep(0.01)
    assert not any(is_warm(place, kind) for kind in KINDS)


def test_a_kind_is_warm_once_all_its_steps_are_done(place: Path) -> None:
    """Each of its requests belongs to one of them."""
    for kind in KINDS:
        steps = [step for step, of in STEPS.items() if of == kind]
        for step in steps:
            assert not is_warm(place, kind)
            warming.note_done(place, step)
        assert is_warm(place, kind)
        asked = [each for step in steps for each in warming.problems(step)]
        assert len(asked) == len(examples.requests(kind)) + len(PROBLEMS.get(kind, ()))
    assert len(STEPS) == len(KINDS) + 1


@pytest.mark.parametrize("text", ["", "0.", version("vibroimpact"), "0.1.0\n", "\n", "\0\n"])
def test_half_a_mark_marks_nothing(place: Path, text: str) -> None:
    warming.mark_file(place, "sweep").write_text(text)
    assert not is_warm(place, "sweep")
    warming.note_done(place, "sweep")
    assert is_warm(place, "sweep")
    warming.mark_file(place, "sweep").write_bytes(b"\xff\xfe")
    assert not is_warm(place, "sweep")


def test_a_kind_is_warm_as_long_as_the_kernels_it_needs_are_there(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Installations that share a folder each have theirs, and what both need is there once."""
    first = {"kernels.flow": "flow-1", "kernels.bands": "bands-1", "kernels.waves": "waves-1"}
    second = first | {"kernels.flow": "flow-2", "kernels.waves": "waves-2"}
    for name in ("flow-1", "bands-1"):
        (place / name).mkdir()
    monkeypatch.setattr(cache, "folders", lambda: first)
    warming.note_done(place, "sweep", ["bands-1", "flow-1"])
    warming.note_done(place, "resonances", ["bands-1"])
    assert is_warm(place, "sweep")
    monkeypatch.setattr(cache, "folders", lambda: second)
    assert not is_warm(place, "sweep")  # it would compile what imports another flow
    assert is_warm(place, "resonances")
    (place / "flow-2").mkdir()
    warming.note_done(place, "sweep", ["bands-1", "flow-2"])
    assert is_warm(place, "sweep")
    monkeypatch.setattr(cache, "folders", lambda: first)
    assert is_warm(place, "sweep")  # both keep theirs
    (place / "flow-1").rmdir()
    assert not is_warm(place, "sweep")
    warming.note_done(place, "sweep", ["bands-1"])
    assert warming.mark_file(place, "sweep").read_text().count("\n") == 2  # flow-1 is forgotten


REACHED = """
import os
from vibroimpact_service.use_case import warming
from vibroimpact_solvers.kernels import inventory

for step in warming.STEPS:
    warming.solve_problems(step)
print(*(name for name, each in inventory.kernels().items() if not each.signatures))
"""


def test_warming_reaches_every_kernel_that_a_request_can_need() -> None:
    done = subprocess.run(
        [sys.executable, "-c", REACHED], check=True, timeout=1000, stdout=subprocess.PIPE, text=True
    )
    assert set(done.stdout.split()) == warming.LIBRARY_ONLY


def test_those_who_wait_are_told(
    place: Path, notes: Path, runner: CliRunner, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = ["rigid_motion.follow", "whole_soft_motion.whole_soft_motion"]
    monkeypatch.setattr("vibroimpact_solvers.kernels.inventory.missing", lambda: left)
    monkeypatch.setattr("vibroimpact_solvers.kernels.inventory.SECONDS", {left[0]: 41.0})
    line = "compiling kernels, about 41 s, once"
    some = Warming(partial(noted, notes))
    with structlog.testing.capture_logs() as logged, some.in_background():
        list(some.progress())
    assert line in [each["event"] for each in logged]
    with structlog.testing.capture_logs() as logged, Warming().in_background():
        pass
    assert logged == []  # all is there
    warming.mark_file(place, "sweep").unlink()
    monkeypatch.setattr(warming, "Warming", lambda: Warming(partial(noted, notes)))
    outcome = runner.invoke(cli.app, ["warm"])
    assert outcome.stderr.splitlines() == [line]
    warming.mark_file(place, "sweep").unlink()
    monkeypatch.setattr("vibroimpact_solvers.kernels.inventory.missing", lambda: left[1:])
    outcome = runner.invoke(cli.app, ["warm"])
    assert (outcome.stderr, outcome.exit_code) == ("", 0)  # only problems are solved again


NEEDED = """
import os
from pathlib import Path
import numba
from vibroimpact_solvers.kernels import cache
from vibroimpact_service.use_case import warming
from vibroimpact_service.kinds import KINDS

os.nice = lambda by: 0  # the test waits for it, beside whatever else is computed
place = cache.folder()
warming.compile_step(place, "resonances", warming.solve_problems)
warming.compile_step(place, "slow-flow", warming.solve_problems)
for kind in ("resonances", "slow-flow"):
    (line,) = warming.mark_file(place, kind).read_text().splitlines()
    print(kind, *(name.partition("-")[0] for name in line.split()[1:]))
"""


@pytest.mark.timeout(1260)  # it compiles, beside whatever else is computed
def test_what_a_kind_needs_is_what_it_called(tmp_path: Path) -> None:
    """Counted by the files that numba has written."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", NEEDED],
        env=environment, check=True, timeout=1200, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    nothing, needed = done.stdout.splitlines()
    assert nothing == "resonances"
    written = {file.parent.name.partition("-")[0] for file in tmp_path.glob("*/*/*.nbi")}
    assert written == set(needed.split()[1:]) == {"damped_walls", "elastic_walls", "lossy_walls"}


def test_nowhere_to_keep_kernels(runner: CliRunner, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vibroimpact_solvers.kernels.cache.folder", lambda *_: None)
    outcome = runner.invoke(cli.app, ["warm"])
    assert outcome.exit_code == 3
    assert "NUMBA_CACHE_DIR" in outcome.output
    with Warming().in_background():  # a service starts nevertheless
        pass


def test_the_command_names_what_was_not_compiled(
    place: Path, notes: Path, runner: CliRunner, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warming, "Warming", lambda: Warming(partial(failing, notes)))
    outcome = runner.invoke(cli.app, ["warm"])
    assert outcome.exit_code == 1
    assert "not compiled: time-history" in outcome.output
    monkeypatch.setattr(warming, "Warming", lambda: Warming(partial(noted, notes)))
    outcome = runner.invoke(cli.app, ["warm"])
    assert outcome.exit_code == 0
    assert str(place) in outcome.output


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("step", STEPS)
def test_the_problems_of_a_step_can_be_solved(step: str, tmp_path: Path) -> None:
    kind = KINDS[STEPS[step]]
    asked = [requests.read("warming", kind, each) for each in warming.problems(step)]
    assert asked
    for each in asked:
        assert planning.plan(Store(str(tmp_path)), each.kind, each.document).plan.steps


PLANS = """
import sys, tempfile
from numba import njit
from numba.core import event
from vibroimpact_service.use_case import warming
from vibroimpact_service.documents import planning, requests
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

free = {
    "system": {
        "M": {"scalar": 1, "n": 2}, "K": [[1, -1], [-1, 1]], "constraints": [{"dof": 0, "gap": 1}],
    },
    "load": [{"dof": 0, "amplitude": 1}],
    "frequency": {"values": [0.7]},
}
store, settings = Store(sys.argv[1]), Settings(data=sys.argv[1])
with event.install_recorder("numba:compile") as compiled:
    for step, kind in warming.STEPS.items():
        # Of a body that nothing holds, the modes say which impacts it can have.
        more = [free] if kind == "periodic-motions" else []
        for content in [*warming.problems(step), *more]:
            request = requests.read("ann", KINDS[kind], content)
            planning.plan(store, request.kind, request.document, settings)
    during_plans = len(compiled.buffer)
    njit(lambda x: x + 1)(1)
assert len(compiled.buffer) > during_plans == 0
"""


def test_plans_compile_nothing(tmp_path: Path) -> None:
    """Else they would be refused for their processor time while kernels are missing."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "empty")}
    command = [sys.executable, "-c", PLANS, str(tmp_path)]
    subprocess.run(command, env=environment, check=True, timeout=1000)


def test_what_needs_missing_kernels_becomes_a_job(
    settings: Settings,
    store: Store,
    queue: Any,
    request_body: dict[str, Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def over(owner: str, job: str, seconds: float) -> JobRow:
        """Return as if the time were over."""
        row: JobRow = queue.rows[job]
        return row

    monkeypatch.setattr(queue, "wait", over)
    cold = Warming()
    cold.states["impact-modes"] = "warming"
    chosen = settings.model_copy(
        update={"inline_overrun_seconds": 60.0, "on_submission_seconds": 60.0}
    )
    use = Evaluation(chosen, store, queue, Metrics(JobMetrics().registry), cold)
    free = Admission(lambda *_: asyncio.sleep(0), True)
    sweep = {
        "kind": "impact-modes",
        "base": request_body,
        "axes": [{"path": "system.constraints.0.gap", "values": [0.1, 0.2]}],
    }

    def asked(content: dict[str, Any], kind: str = "impact-modes") -> requests.Request:
        return requests.read("ann", KINDS[kind], parse.json(orjson.dumps(content)))

    async def main() -> None:
        for question in (asked(request_body), asked(sweep, "sweep")):
            outcome = await use.compute(question, Preference(), JSON, free)
            assert isinstance(outcome, JobRow)
            assert outcome.state == "queued"
            queue.run(outcome.id)
            assert isinstance(await use.compute(question, Preference(), JSON, free), Answer)
        queue.at_once = True  # the job is done before the time is up
        other = asked({**request_body, "outputs": ["impulse"]})
        assert isinstance(await use.compute(other, Preference(), JSON, free), Answer)
        resonances = {"system": request_body["system"], "constraint": 0, "odd_max": 3}
        answer = await use.compute(asked(resonances, "resonances"), Preference(), JSON, free)
        assert isinstance(answer, Answer)
        assert answer.cache == "fwd=miss"

    asyncio.run(main())
    use.close()
    assert len(queue.rows) == 3  # the kernels of resonances were there


def test_a_service_says_what_is_missing(
    settings: Settings, queue: Any, request_body: dict[str, Any]
) -> None:
    cold = Warming()
    with TestClient(create_app(settings, queue, cold)) as http:
        for state, summary in (
            ("warming", "warming"),
            ("failed", "failed: impact-modes"),
            ("warm", "warm"),
        ):
            cold.states["impact-modes"] = state  # type: ignore[assignment]
            ready = http.get("/v1/health/ready")
            assert ready.status_code == 200
            assert ready.json()["kernels"] == summary
            figure = f'vibroimpact_kernels_warm{{kind="impact-modes"}} {float(state == "warm")}'
            assert figure in http.get("/metrics").text
            # There are no workers here, which could compute it.
            batch = {"kind": "impact-modes", "requests": [request_body]}
            answer = http.post("/v1/batch", json=batch)
            assert answer.status_code == (200 if state == "warm" else 503)


def test_what_is_marked_counts_as_compiled(
    place: Path, notes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warming, "_place", lambda: place)
    assert not any(map(warming.is_compiled, KINDS))
    run(Warming(partial(noted, notes)))
    assert all(map(warming.is_compiled, KINDS))
    monkeypatch.setattr(warming, "_place", lambda: None)  # kernels cannot be kept
    assert not any(map(warming.is_compiled, KINDS))
