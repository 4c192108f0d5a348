"""No request takes more to plan than a plan may, nor more to compute than its price tells."""

from __future__ import annotations

import contextlib
import itertools
import resource
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.testclient import TestClient

from tests.effort import least
from vibroimpact_service import problems
from vibroimpact_service.app import create_app
from vibroimpact_service.documents import decode, limits, planning, requests
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results import encode
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_solvers.meter import StoppedError, StopSignal

PLAN_SECONDS = 0.05
"""A fifth of what a plan may take, so that none is refused where processors are busy or slow."""
LIMITER = {"dof": 5, "gap": 0.2}
BALL = {"preset": "bouncing_ball", "g": 9.81}
OSCILLATOR = {"preset": "oscillator", "Omega0": 1.0, "zeta": 0.1}


def chain(n: int, *constraints: dict[str, Any]) -> dict[str, Any]:
    return {"preset": "chain", "n": n, "constraints": list(constraints) or [LIMITER]}


def modes(num: int, n: int = 13, start: float = 0.6, **more: Any) -> dict[str, Any]:
    frequency = {"start": start, "stop": 1.9, "num": num}
    return {"system": chain(n), "frequency": frequency, **more}


def sweep(kind: str, base: dict[str, Any], *axes: tuple[str, float, float, int]) -> dict[str, Any]:
    listed = [
        {"path": path, "start": start, "stop": stop, "num": num} for path, start, stop, num in axes
    ]
    return {"kind": kind, "base": base, "axes": listed}


GAP = ("system.constraints.0.gap", 0.1, 1.0, 10**6)
EVERYWHERE = [{"dof": i, "gap": 1.0} for i in range(0, 5000, 2)]
COUPLED = [
    {"direction": {"dofs": [i, i + 1], "weights": [1.0, -1.0]}, "gap": 1.0} for i in range(2500)
]
FREE = {"x": [0.0] * 13, "v": [1.0] + [0.0] * 12}
HISTORY = {"system": chain(13), "initial": FREE, "t_end": 100.0, "outputs": ["impacts"]}
SLOW = {
    "initial": {"x": [0.0] * 5000, "v": [1e-9] + [0.0] * 4999}, "t_end": 10.0,
    "outputs": ["impacts"],
}  # fmt: skip
WIDE = {
    "M": {"scalar": 1.0, "n": 5000},
    "K": {"bands": {str(k): [-0.5 if k else 1e3] * (5000 - k) for k in range(100)}},
    "constraints": EVERYWHERE,
}
RING = {  # its ends are joined: no band
    "M": {"scalar": 1.0, "n": 5000},
    "K": {
        "shape": [5000, 5000], "row": [*range(5000), 0, 4999], "col": [*range(5000), 4999, 0],
        "data": [2.0] * 5000 + [-0.5] * 2,
    },
    "constraints": [LIMITER],
}  # fmt: skip
OUTSIDE = {
    # The states keep all limiters but the last one.
    "system": chain(
        3,
        *(
            {"direction": {"dofs": [0, 1], "weights": [1.0, 1.0 + k / 1000]}, "gap": 100.0}
            for k in range(1000)
        ),
        {"dof": 2, "gap": 0.2},
    ),
    "initial": {"x": [[1.0] * 3] * 10_000, "v": [[0.0] * 3] * 10_000},
    "t_end": 1.0,
}
PLANS: dict[str, tuple[str, dict[str, Any]]] = {
    "a million frequencies": ("impact-modes", modes(10**6)),
    "two million, all outputs": (
        "impact-modes",
        modes(2 * 10**6, outputs=["impulse", "exists", "energy", "stability"]),
    ),
    "two million of a large structure": ("impact-modes", modes(2 * 10**6, 800)),
    "two million far below its modes": ("impact-modes", modes(2 * 10**6, 1000, 0.01)),
    "thousands of limiters": ("impact-modes", {**modes(10), "system": chain(5000, *EVERYWHERE)}),
    "limiters between neighbours": ("impact-modes", {**modes(10), "system": chain(2501, *COUPLED)}),
    "thousands of limiters out of reach": ("time-history", {**SLOW, "system": WIDE}),
    "thousands of loads": (
        "time-history",
        {
            **HISTORY,
            "load": [
                {"dof": 0, "amplitude": 1.0, "frequency": 1.0 + k / 1000} for k in range(20_000)
            ],
        },
    ),
    "bands far below the modes": (
        "existence-bands",
        {"system": chain(13), "frequency": {"start": 1e-12, "stop": 5.0}},
    ),
    "ten million times": (
        "time-history",
        {**HISTORY, "t": {"num": 10**7}, "dofs": [0], "outputs": ["x"]},
    ),
    "a million drives": (
        "periodic-motions",
        {
            "system": {**OSCILLATOR, "constraints": [{"dof": 0, "gap": 0.2, "restitution": 0.8}]},
            "load": [{"dof": 0, "amplitude": 1.0}],
            "frequency": {"start": 0.5, "stop": 2.0, "num": 10**6},
            "sequence": "symmetric",
        },
    ),
    "ten million frequencies": ("impact-modes", modes(10**7)),
    "a million gaps": ("sweep", sweep("impact-modes", modes(100), GAP)),
    "a million structures": (
        "sweep",
        sweep(
            "impact-modes",
            modes(10),
            ("system.stiffness", 0.1, 1.0, 1000),
            ("system.mass", 0.1, 1.0, 1000),
        ),
    ),
    "a million gaps at ten million frequencies": (
        "sweep",
        sweep("impact-modes", modes(10**7), GAP),
    ),
    "a million ends": ("sweep", sweep("time-history", HISTORY, ("t_end", 1.0, 2.0, 10**6))),
    "ends of slow motions of thousands of limiters": (
        "sweep",
        sweep(
            "time-history",
            {**SLOW, "system": chain(5000, *EVERYWHERE)},
            ("t_end", 1.0, 2.0, 1000),
        ),
    ),
    "structures of thousands of limiters": (
        "sweep",
        sweep(
            "impact-modes",
            {**modes(100), "system": chain(5000, *EVERYWHERE)},
            ("system.stiffness", 0.5, 1.0, 100),
            ("system.mass", 0.5, 1.0, 100),
        ),
    ),
    "structures of thousands of entries": (
        "sweep",
        sweep("impact-modes", {**modes(100), "system": RING}, ("system.K.data.0", 2.0, 3.0, 1000)),
    ),
    "ten thousand motions outside of a thousand limiters": ("ensemble", OUTSIDE),
    "ten thousand motions outside of a limiter": (
        "attractors",
        {
            "system": {**OSCILLATOR, "constraints": [{"dof": 0, "gap": 0.2}]},
            "load": [{"dof": 0, "amplitude": 1.0}],
            "frequency": {"values": [1.0]},
            "initial": {"x": [[1.0]] * 10_000, "v": [[0.0]] * 10_000},
        },
    ),
    "no point is possible": (
        "sweep",
        sweep(
            "impact-modes",
            modes(10),
            ("system.constraints.0.gap", -1.0, -0.1, 10**6),
            ("system.stiffness", 0.1, 1.0, 1),
        ),
    ),
}


def planned(folder: Path, kind: str, content: dict[str, Any], **more: Any) -> planning.Planned:
    asked = requests.read("ann", KINDS[kind], content)
    settings = Settings(data=folder, **more)
    return planning.plan(Store(str(folder)), asked.kind, asked.document, settings)


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("name", PLANS)
def test_every_plan_is_quick_or_refused(tmp_path: Path, name: str) -> None:
    """Beside the time for its matrices; the least of some attempts, the first loads libraries."""
    kind, content = PLANS[name]
    store, settings, attempt = Store(str(tmp_path)), Settings(data=tmp_path), itertools.count()

    def spent() -> float:
        asked = requests.read("ann", KINDS[kind], moved(content, 1.0 + next(attempt) / 1000))
        decode.system(asked.document.system)
        began = planning._used()
        with contextlib.suppress(ProblemError):
            planning.plan(store, asked.kind, asked.document, settings)
        return min(now - then for now, then in zip(planning._used(), began, strict=True))

    assert least(spent, PLAN_SECONDS) <= PLAN_SECONDS


def moved(content: dict[str, Any], factor: float) -> dict[str, Any]:
    """Return a request whose limiters have other gaps, so that nothing is known of it before."""
    if "base" in content:
        return {**content, "base": moved(content["base"], factor)}
    constraints = [
        {**each, "gap": each["gap"] * factor} for each in content["system"]["constraints"]
    ]
    return {**content, "system": {**content["system"], "constraints": constraints}}


def test_a_plan_that_takes_long_ends_with_the_reason(tmp_path: Path) -> None:
    content = sweep("impact-modes", modes(10), ("system.stiffness", 0.1, 1.0, 1000))
    with pytest.raises(ProblemError, match="The plan alone") as refused:
        planned(tmp_path, "sweep", content, plan_seconds=1e-6)
    assert refused.value.type is problems.TOO_COSTLY
    assert [fault.pointer for fault in refused.value.errors] == ["/axes"]
    assert refused.value.errors[0].code == "plan_too_long"


@pytest.mark.parametrize(("sent", "pointer"), [(False, "/system"), (True, "/t")])
def test_of_a_plan_that_takes_long_a_field_is_blamed_that_was_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, sent: bool, pointer: str
) -> None:
    clock = iter(range(100))
    monkeypatch.setattr(planning, "_used", lambda: (float(next(clock)),) * 2)
    content = {**HISTORY, "outputs": ["impacts"]}
    content.pop("t", None)
    with pytest.raises(ProblemError, match="The plan alone") as refused:
        planned(tmp_path, "time-history", {**content, "t": [0.0]} if sent else content)
    assert [fault.pointer for fault in refused.value.errors] == [pointer]


@pytest.mark.parametrize("scattered", [True, False])
def test_factors_of_scattered_matrices_have_a_time_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, scattered: bool
) -> None:
    """Bounds of the modes of a full mass matrix take longer than all else in a plan."""
    clock = itertools.count()
    settings = Settings(data=tmp_path)
    monkeypatch.setattr(planning, "_used", lambda: (0.5 * settings.plan_seconds * next(clock),) * 2)
    mass: Any = {"scalar": 1.0, "n": 500}
    if scattered:
        mass = [[float(i == j) for i in range(500)] for j in range(500)]
        mass[0][-1] = mass[-1][0] = 0.1
    system = {"M": mass, "K": {"scalar": 1.0, "n": 500}, "constraints": [LIMITER]}
    content = {**modes(10, outputs=["impulse"]), "system": system}
    if scattered:
        assert planned(tmp_path, "impact-modes", content).plan.steps
        return
    with pytest.raises(ProblemError, match=f"more than {settings.plan_seconds:g} s"):
        planned(tmp_path, "impact-modes", content)


def test_checks_of_many_states_are_part_of_the_plan(tmp_path: Path) -> None:
    """They end where the time of a plan does, not after the last limiter of the last state."""
    asked = requests.read("ann", KINDS["ensemble"], OUTSIDE)
    system, calls = decode.system(asked.document.system), 0

    def meter() -> None:
        nonlocal calls
        calls += 1
        if calls == 100:
            raise ProblemError(problems.TOO_COSTLY, "enough")

    with pytest.raises(ProblemError, match="enough"):
        decode.problem(asked.kind, asked.document, system, meter)


@pytest.mark.needs("compiled kernels")
@pytest.mark.skipif(sys.platform != "linux", reason="the system does not tell its time apart")
def test_what_the_system_takes_for_memory_is_not_the_time_of_a_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first plan of a service touches its memory for the first time.

    Here the clocks of this thread go on where the plan looks at them and nowhere else: how the
    system shares its time out depends on what else the machine does.
    """
    asked = requests.read("ann", KINDS["impact-modes"], modes(10))
    settings = Settings(data=tmp_path, plan_seconds=0.5)
    used = SimpleNamespace(ru_utime=0.0, ru_stime=0.0)

    def tell(who: int) -> SimpleNamespace:
        assert who == resource.RUSAGE_THREAD
        return SimpleNamespace(**vars(used))

    monkeypatch.setattr(resource, "getrusage", tell)
    monkeypatch.setattr(time, "thread_time", lambda: used.ru_utime + used.ru_stime)

    def in_the_system(_done: int, _total: int) -> None:
        used.ru_stime += 0.8

    def in_this_process(_done: int, _total: int) -> None:
        used.ru_utime += 0.8

    def plan(tick: Any) -> planning.Planned:
        return planning.plan(Store(str(tmp_path)), asked.kind, asked.document, settings, tick)

    assert plan(in_the_system).plan.steps
    with pytest.raises(ProblemError, match="The plan alone"):
        plan(in_this_process)


def test_a_plan_is_not_refused_for_what_the_system_samples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a thread that has run for long, the time that is not the system's jumps now and then."""
    asked = requests.read("ann", KINDS["impact-modes"], modes(10))
    jumps = itertools.count()
    monkeypatch.setattr(planning, "_used", lambda: (float(next(jumps)), time.thread_time()))
    store, settings = Store(str(tmp_path)), Settings(data=tmp_path)
    assert planning.plan(store, asked.kind, asked.document, settings).plan.steps
    assert next(jumps) > 2  # it was asked


def test_a_plan_ends_when_its_caller_has_gone(tmp_path: Path) -> None:
    content = sweep("impact-modes", modes(10), ("system.stiffness", 0.1, 1.0, 1000))
    asked = requests.read("ann", KINDS["sweep"], content)
    left, settings = StopSignal(), Settings(data=tmp_path)
    left.stop()
    with pytest.raises(StoppedError):
        planning.plan(Store(str(tmp_path)), asked.kind, asked.document, settings, left)


def ball(restitution: float, x: float) -> dict[str, Any]:
    wall = {"dof": 0, "gap": {"lower": 0.0, "upper": None}, "restitution": restitution}
    return {
        "system": {**BALL, "constraints": [wall]}, "initial": {"x": [x], "v": [0.0]},
        "t_end": 1e5, "outputs": ["impacts"],
    }  # fmt: skip


UNBOUNDED: dict[str, tuple[str, dict[str, Any], str | None]] = {
    "an impact mode of any frequency": (
        "time-history", {**HISTORY, "initial": {"impact_mode": {"Omega": 1e12}}}, "/t_end",
    ),
    "a ball that loses next to nothing": ("time-history", ball(1.0 - 1e-12, 1e-6), "/t_end"),
    "a ball that loses nothing": ("time-history", ball(1.0, 1e-6), "/t_end"),
    "all resonances with all odd numbers": (
        "resonances", {"system": chain(5000), "constraint": 0, "odd_max": 9999}, "/outputs",
    ),
    "a motion as fast as can be": (
        "ensemble",
        {
            "system": chain(13), "t_end": 100.0, "outputs": ["impacts"],
            "initial": {"x": [[0.0] * 13] * 2, "v": [[0.0] * 13, [9e15] + [0.0] * 12]},
        },
        "/t_end",
    ),
    "ten million frequencies of a large structure": (
        "impact-modes", modes(10**7, 5000, 1e-4), None,
    ),
}  # fmt: skip


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("name", UNBOUNDED)
def test_what_takes_far_too_much_is_refused_by_its_price(tmp_path: Path, name: str) -> None:
    """Each of them was priced at milliseconds, or took gibibytes."""
    kind, content, pointer = UNBOUNDED[name]
    if pointer is None:  # a job, and charged as one
        assert planned(tmp_path, kind, content, plan_seconds=10.0).seconds > 60.0
        return
    with pytest.raises(ProblemError, match=r"about \S+ (bytes|years)") as refused:
        planned(tmp_path, kind, content)
    takes_years = "years" in str(refused.value)  # which is no size
    assert refused.value.type.status == (422 if takes_years else 413)
    assert refused.value.errors[0].pointer == pointer


def test_a_ball_that_comes_to_rest_is_cheap(tmp_path: Path) -> None:
    assert planned(tmp_path, "time-history", ball(0.7, 1.0)).seconds < 0.1
    assert planned(tmp_path, "time-history", ball(0.99, 0.0)).seconds < 0.1


def test_ensembles_are_priced_by_the_mean_of_their_speeds(tmp_path: Path) -> None:
    def price(*speeds: float) -> float:
        v = [[speed] + [0.0] * 12 for speed in speeds]
        initial = {"x": [[0.0] * 13] * len(v), "v": v}
        content = {"system": chain(13), "t_end": 100.0, "outputs": ["impacts"], "initial": initial}
        return planned(tmp_path, "ensemble", content).plan.flops

    assert price(1.0, 3.0) == pytest.approx(price(2.0, 2.0))
    assert price(1.0, 3.0) == pytest.approx(price(3.0, 1.0))


def test_a_price_that_is_no_bound_says_so(tmp_path: Path) -> None:
    def plan(kind: str, content: dict[str, Any]) -> dict[str, Any]:
        return planning.steps(planned(tmp_path, kind, content).plan)

    def moving(wall: float) -> dict[str, Any]:
        return plan("time-history", {**HISTORY, "system": chain(13, {"dof": 5, "gap": wall})})

    near, far = moving(0.2), moving(1e3)  # where the motion does not reach it
    assert not near["bounded"]
    assert [step["bounded"] for step in near["steps"]] == [True, False]
    assert "no upper bound" in near["steps"][1]["reason"]
    assert far["bounded"]
    assert "no upper bound" not in far["steps"][1]["reason"]
    assert plan("impact-modes", modes(10, outputs=["impulse"]))["bounded"]
    assert not plan("impact-modes", modes(10, outputs=["exists"]))["bounded"]
    swept = sweep("impact-modes", modes(10, outputs=["impulse"]), GAP)
    assert not plan("sweep", swept)["bounded"]  # the other points cost what the first one does


DRIVEN = {
    "system": {**OSCILLATOR, "constraints": [{"dof": 0, "gap": 0.2, "restitution": 0.8}]},
    "load": [{"dof": 0, "amplitude": 1.0}],
    "frequency": {"start": 0.5, "stop": 2.0, "num": 50},
    "sequence": "symmetric",
}
SIZES: dict[str, tuple[str, dict[str, Any]]] = {
    "impulses": ("impact-modes", modes(200, outputs=["impulse"])),
    "waveforms": (
        "impact-modes", modes(50, outputs=["waveform"], tau=[0.0, 0.5], dofs=[0, 1]),
    ),
    "shapes": ("impact-modes", modes(200, outputs=["shape"])),
    "resonances": ("resonances", {"system": chain(13), "constraint": 0, "odd_max": 99}),
    "solutions": ("periodic-motions", DRIVEN),
    "multipliers": ("periodic-motions", {**DRIVEN, "outputs": ["multipliers"]}),
    "positions": (
        "time-history",
        {
            **HISTORY, "system": chain(13, {"dof": 5, "gap": 1e3}), "t": {"num": 500},
            "outputs": ["x", "v", "energy"],
        },
    ),
}  # fmt: skip


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("name", SIZES)
def test_results_are_as_large_as_planned(tmp_path: Path, name: str) -> None:
    """What a plan promises is not a third of what there is, nor many times as much."""
    kind, content = SIZES[name]
    work = planned(tmp_path, kind, content)
    result = work.kind.solver.solve(work.problem, work.plan)
    size = encode.describe(result, {}).nbytes
    assert size <= limits.result_bytes(work.plan) + 1000  # of what does not grow
    assert limits.result_bytes(work.plan) <= 3 * size


WALL = [{"dof": 0, "gap": 0.2}]
LONG: dict[str, tuple[str, dict[str, Any], str]] = {
    "frequencies": ("impact-modes", modes(10), "/frequency"),
    "the end of a history": ("time-history", HISTORY, "/t_end"),
    "axes": ("sweep", sweep("impact-modes", modes(10), ("system.mass", 0.1, 1.0, 3)), "/axes"),
    "resonances of the usual order": (
        "resonances", {"system": chain(13), "constraint": 0}, "/system",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LONG)
def test_a_computation_that_costs_too_much_names_the_field(
    settings: Settings, queue: Any, name: str
) -> None:
    kind, content, pointer = LONG[name]
    chosen = settings.model_copy(update={"max_job_seconds": 1e-12})
    with TestClient(create_app(chosen, queue)) as http:
        for where, sent, prefix in (
            (f"/v1/compute/{kind}", content, ""),
            ("/v1/jobs", {"kind": kind, "request": content}, "/request"),
        ):
            answer = http.post(where, json=sent)
            assert answer.status_code == 413, answer.text
            errors = answer.json()["errors"]
            assert [(e["pointer"], e["code"]) for e in errors] == [(prefix + pointer, "too_costly")]


def test_a_sweep_with_a_large_result_names_its_axes(tmp_path: Path) -> None:
    with pytest.raises(ProblemError, match="bytes of results") as refused:
        planned(tmp_path, "sweep", sweep("impact-modes", modes(100), GAP))
    assert refused.value.errors[0].pointer == "/axes"


PRESETS: dict[str, tuple[dict[str, Any], str]] = {
    "the damping": ({"preset": "oscillator", "Omega0": 1.0, "zeta": 1e200}, "zeta"),
    "no spring is left": ({"preset": "oscillator", "Omega0": 1e-200}, "Omega0"),
    "beyond doubles": ({"preset": "two_mass", "Omega0": 1e200}, "Omega0"),
    "damping beyond doubles": ({"preset": "oscillator", "Omega0": 1e40, "zeta": 1e300}, "zeta"),
    "springs beyond doubles": ({"preset": "chain", "n": 3, "stiffness": 1.7e308}, "stiffness"),
    "coupling beyond doubles": (
        {"preset": "two_mass", "Omega0": 1e40, "coupling": 1e300},
        "coupling",
    ),
    "the coupling": ({"preset": "two_mass", "Omega0": 1.0, "coupling": 1e200}, "coupling"),
    "its damping": ({"preset": "two_mass", "Omega0": 1.0, "zeta": 1e180}, "zeta"),
    "the ratio": ({"preset": "double_pendulum", "mu": 1e80}, "mu"),
    "gravity": ({"preset": "bouncing_ball", "g": 1e200}, "g"),
    "masses": ({"preset": "chain", "n": 3, "mass": 1e-200}, "mass"),
    "springs": ({"preset": "chain", "n": 3, "stiffness": 1e200}, "stiffness"),
}


@pytest.mark.parametrize("name", PRESETS)
def test_faults_of_presets_point_to_their_parameters(tmp_path: Path, name: str) -> None:
    preset, parameter = PRESETS[name]
    content = {"system": {**preset, "constraints": WALL}, "frequency": {"values": [1.0]}}
    with pytest.raises(ProblemError) as refused:
        planned(tmp_path, "impact-modes", content)
    assert [each.pointer for each in refused.value.errors] == [f"/system/{parameter}"]


UNDAMPED = {
    "load": [{"dof": 0, "amplitude": 1.0}], "frequency": {"values": [1.0]},
    "initial": {"x": [[0.0]], "v": [[0.2]]},
}  # fmt: skip


@pytest.mark.parametrize(
    ("preset", "field"),
    [
        ({"preset": "oscillator", "Omega0": 1.0}, "/zeta"),
        ({"preset": "chain", "n": 1}, "/preset"),
        ({"M": [[1.0]], "K": [[1.0]]}, "/C"),
        (None, ""),
    ],
)
def test_what_a_model_lacks_points_to_what_was_sent(
    settings: Settings, queue: Any, preset: dict[str, Any] | None, field: str
) -> None:
    """No motion of an undamped structure settles."""
    with TestClient(create_app(settings, queue)) as http:
        system = {**(preset or {"preset": "oscillator", "Omega0": 1.0}), "constraints": WALL}
        if preset is None:
            system = {"id": http.post("/v1/systems", json=system).json()["id"]}
        answer = http.post("/v1/plan/attractors", json={"system": system, **UNDAMPED})
        assert answer.status_code == 422
        assert [each["pointer"] for each in answer.json()["errors"]] == [f"/system{field}"]
