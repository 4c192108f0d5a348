"""Claims are judged by what documents say, before anything of that size exists."""

from __future__ import annotations

import itertools
import math
import random
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from tests.effort import least
from vibroimpact_schema.requests import ImpactModesRequest
from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_schema.systems import MatrixSystem
from vibroimpact_service import problems
from vibroimpact_service.documents import limits, planning
from vibroimpact_service.jobs import process_limits
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_solvers.plan import Plan, Stage, Step

SETTINGS = Settings(data=Path("nowhere"), max_dofs=100, max_points=1000, max_result_bytes=2**20)
CHAIN = {"preset": "chain", "n": 3, "constraints": [{"dof": 0, "gap": 0.2}]}
GRID = {"values": [1.0]}


def check(system: dict[str, Any], frequency: dict[str, Any]) -> None:
    content = {"system": {"constraints": [], **system}, "frequency": frequency}
    limits.check(ImpactModesRequest.model_validate(content), SETTINGS)


@pytest.mark.parametrize(
    "system",
    [
        {"preset": "chain", "n": 101},
        {"preset": "chain", "n": 10**15},
        {"M": {"scalar": 1, "n": 10**15}, "K": {"scalar": 1, "n": 1}},
        {"M": {"scalar": 1, "n": 1}, "K": {"diagonal": [1] * 101}},
        {"M": {"scalar": 1, "n": 1}, "K": {"bands": {"0": [1], "999999999": []}}},
        {"M": {"scalar": 1, "n": 1}, "K": {"bands": {"0": [1] * 101}}},
        {
            "M": {"scalar": 1, "n": 1},
            "K": {"shape": [1, 10**15], "row": [], "col": [], "data": []},
        },
        {"M": {"scalar": 1, "n": 1}, "K": [[1.0] * 101]},
        {"M": {"scalar": 1, "n": 1}, "K": [[1.0]] * 101},
        {"M": {"scalar": 1, "n": 1}, "K": [[1.0]], "C": {"scalar": 0, "n": 101}},
    ],
)
def test_too_many_degrees_of_freedom(system: dict[str, Any]) -> None:
    with pytest.raises(ProblemError) as caught:
        check(system, GRID)
    assert caught.value.type is problems.TOO_LARGE
    assert caught.value.errors[0].pointer == "/system"


@pytest.mark.parametrize(
    "frequency",
    [
        {"start": 1, "stop": 2, "num": 1001},
        {"start": 1, "stop": 2, "num": 10**15},
        {"start": 1, "stop": 2, "step": 1e-300},
        {"values": [1.0] * 1001},
    ],
)
def test_too_many_points(frequency: dict[str, Any]) -> None:
    with pytest.raises(ProblemError) as caught:
        check(CHAIN, frequency)
    assert caught.value.errors[0].pointer == "/frequency"


@pytest.mark.parametrize("where", ["/axes/0", "/base/frequency"])
def test_grids_that_no_memory_holds_are_refused_without_settings(where: str) -> None:
    """A step of 5e-11 would ask for 45 GiB."""
    step, small = {"start": 0.1, "stop": 0.4, "step": 5e-11}, {"start": 0.1, "stop": 0.4, "num": 2}
    axis, frequency = (step, small) if where == "/axes/0" else (small, step)
    content = {
        "kind": "impact-modes",
        "base": {"system": CHAIN, "frequency": frequency},
        "axes": [{"path": "system.constraints.0.gap", **axis}],
    }
    kind = KINDS["sweep"]
    with pytest.raises(ProblemError) as caught:
        planning.plan(Store("memory://limits"), kind, kind.request.model_validate(content))
    assert caught.value.type is problems.TOO_LARGE
    assert caught.value.errors[0].pointer == where
    assert caught.value.errors[0].code == "too_many_points"


def test_what_is_at_the_limits_passes() -> None:
    check({**CHAIN, "n": 100}, {"start": 1, "stop": 2, "num": 1000})


def entries(pairs: Any, n: int, diagonal: float = 10.0) -> dict[str, Any]:
    """Return the symmetric matrix with small entries at some places beside its diagonal."""
    places = {(i, j) for i, j in pairs if i != j}
    both = sorted(places | {(j, i) for i, j in places})
    own = range(n) if diagonal else range(0)
    rows, columns = [*own, *(i for i, _ in both)], [*own, *(j for _, j in both)]
    data = [diagonal] * len(own) + [0.01] * len(both)
    return {"shape": [n, n], "row": rows, "col": columns, "data": data}


def anywhere(n: int, each: int) -> Iterator[tuple[int, int]]:
    draw = random.Random(1)
    return ((draw.randrange(n), draw.randrange(n)) for _ in range(n * each))


def near(k: int) -> Iterator[tuple[int, int]]:
    """Yield neighbours in a cube of k^3 nodes with three degrees of freedom each."""
    steps = list(itertools.product((-1, 0, 1), repeat=3))
    for at in itertools.product(range(k), repeat=3):
        for step in steps:
            to = [a + b for a, b in zip(at, step, strict=True)]
            if min(to) >= 0 and max(to) < k:
                one, other = (3 * (k * (k * a + b) + c) for a, b, c in (at, to))
                yield from ((one + p, other + q) for p in range(3) for q in range(3))


N = 5000
UNIT = {"scalar": 1.0, "n": N}
STAR = [(0, k) for k in range(1, N)]
MASSLESS = {"diagonal": [1.0] * 100 + [0.0] * (N - 100)}


@pytest.mark.parametrize(
    ("M", "K", "pointer"),
    [
        (entries(anywhere(N, 8), N), UNIT, "/system/M"),
        (MASSLESS, entries(anywhere(N, 8), N), "/system/K"),
        (entries([], N, 0.0), entries(anywhere(N, 8), N), "/system/K"),
        (UNIT, entries(anywhere(N, 8), N), None),  # whose factors no plan needs
        (entries(near(11), 3993), {"scalar": 1.0, "n": 3993}, None),
        (MASSLESS, entries(STAR, N), None),
    ],
)
def test_factors_of_plans_are_bounded(M: Any, K: Any, pointer: str | None) -> None:
    """Three of those that are refused took the threads of all plans for a minute."""
    settings = SETTINGS.model_copy(update={"max_dofs": N})
    system = MatrixSystem.model_validate({"M": M, "K": K, "constraints": []})
    if pointer is None:
        limits.check_system(system, settings, "/system")
        return

    def spent() -> float:
        began = time.thread_time()
        with pytest.raises(ProblemError, match="operations") as refused:
            limits.check_system(system, settings, "/system")
        assert refused.value.type.status == 413
        assert refused.value.errors[0].pointer == pointer
        return time.thread_time() - began

    assert least(spent, 1.0) <= 1.0


def test_results_are_bounded_and_spectra_are_not_results() -> None:
    large = Step(Stage.SPECTRUM, "dense", "", bytes=2.0**30)
    limits.check_plan(Plan("kind", (large, Step(Stage.SHAPE, "sum", "", bytes=2.0**20))), SETTINGS)
    with pytest.raises(ProblemError) as caught:
        limits.check_plan(Plan("kind", (Step(Stage.SHAPE, "sum", "", bytes=2.0**21),)), SETTINGS)
    assert caught.value.type is problems.TOO_LARGE


def test_sizes_that_are_only_expected_may_turn_out_smaller() -> None:
    steps = (
        Step(Stage.SPECTRUM, "dense", "", bytes=7e3),
        Step(Stage.HISTORY, "sum", "", bytes=2e3),
        Step(Stage.FREE_MOTION, "exact", "", bytes=1e3, bounded=False),
    )
    assert limits.result_bytes(Plan("kind", steps)) == 3e3
    assert limits.least_bytes(Plan("kind", steps)) == 2.1e3


def test_plans_respect_the_memory_of_a_worker() -> None:
    tight = SETTINGS.model_copy(update={"max_result_bytes": 2**30, "worker_memory_bytes": 2**29})

    def check_plan(stage: Stage, size: float, **more: Any) -> None:
        limits.check_plan(Plan("kind", (Step(stage, "sum", "", bytes=size),)), tight, **more)

    check_plan(Stage.SHAPE, 5e7)
    check_plan(Stage.SPECTRUM, 2e8)
    check_plan(Stage.SHAPE, 2e8, joined_in_files=True)
    for stage, size in ((Stage.SHAPE, 6e7), (Stage.SPECTRUM, 3e8)):
        with pytest.raises(ProblemError, match="bytes of memory are more than 536870912") as caught:
            check_plan(stage, size)
        assert caught.value.errors[0].code == "too_much_memory"


def test_a_worker_has_a_limit_of_memory_where_none_is_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Shares of the machine, or of the container; elsewhere, workers have their own settings."""
    container = tmp_path / "memory.max"
    monkeypatch.setattr(process_limits, "_CONTAINER", container)
    container.write_text(str(10 * 2**30))
    assert process_limits.worker_memory(None, 1) == 5 * 2**30
    assert process_limits.worker_memory(None, 4) == 2 * 2**30
    assert process_limits.worker_memory(None, 100) == 2**30
    assert process_limits.worker_memory(2**29, 4) == 2**29
    shared = SETTINGS.model_copy(update={"max_result_bytes": 2**34, "workers": 4})
    large = Plan("kind", (Step(Stage.SHAPE, "sum", "", bytes=5e8),))
    with pytest.raises(ProblemError, match="bytes of memory are more than 2147483648"):
        limits.check_plan(large, shared)
    limits.check_plan(large, shared.model_copy(update={"scheduler": "tls://elsewhere:8786"}))


def sweep(axes: list[dict[str, Any]], frequency: dict[str, Any] = GRID) -> SweepRequest:
    base = {"system": CHAIN, "frequency": frequency}
    return SweepRequest.model_validate({"kind": "impact-modes", "base": base, "axes": axes})


def test_parameter_grids_are_bounded_with_their_numbers() -> None:
    axes = [
        {"path": "system.stiffness", "start": 1, "stop": 2, "num": 100},
        {"path": "system.mass", "start": 1, "stop": 2, "num": 101},
    ]
    settings = SETTINGS.model_copy(update={"max_sweep_points": 10_000})
    limits.check(sweep([axes[0], {**axes[1], "num": 100}]), settings)
    with pytest.raises(ProblemError) as caught:
        limits.check(sweep(axes), settings)
    assert caught.value.type is problems.TOO_LARGE
    assert caught.value.errors[0].pointer == "/axes"
    assert "100 x 101 = 10100 points are more than 10000" in caught.value.errors[0].message


def test_the_base_of_a_sweep_is_bounded_too() -> None:
    axis = {"path": "system.stiffness", "values": [1.0]}
    with pytest.raises(ProblemError) as caught:
        limits.check(sweep([axis], {"start": 1, "stop": 2, "num": 1001}), SETTINGS)
    assert caught.value.errors[0].pointer == "/base/frequency"


def test_a_plan_without_end_is_refused(http: TestClient, request_body: dict[str, Any]) -> None:
    request_body["frequency"] = {"start": 5e-324, "stop": 1.0, "step": 0.1}
    for path in ("/v1/plan/impact-modes", "/v1/compute/impact-modes"):
        answer = http.post(path, json=request_body)
        assert answer.status_code == 422
        assert answer.json()["errors"][0]["pointer"] == "/frequency"


def test_what_is_blamed_for_a_computation_without_end() -> None:
    endless = Plan("kind", (Step(Stage.SHAPE, "sum", "", flops=math.inf),))
    with pytest.raises(ProblemError, match="not finite") as caught:
        limits.check_plan(endless, SETTINGS, long=lambda: "/t_end")
    assert caught.value.type.status == 413
    assert [(each.pointer, each.code) for each in caught.value.errors] == [("/t_end", "not_finite")]
