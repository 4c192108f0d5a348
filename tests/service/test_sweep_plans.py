"""Plans of sweeps do not grow with the sweep: a short request must not stop the service."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from vibroimpact_service.documents import decode, planning, requests, sweep_axes
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

CHAIN = {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]}
GAP = {"path": "system.constraints.0.gap", "start": 0.1, "stop": 0.3}
RESTITUTION = {"path": "system.constraints.0.restitution", "start": 0.1, "stop": 0.9}
RESONANCES = {"system": CHAIN, "constraint": 0, "odd_max": 3, "outputs": ["Omega"]}


def modes(num: int) -> dict[str, Any]:
    frequency = {"start": 1.0, "stop": 2.0, "num": num}
    return {"system": CHAIN, "frequency": frequency, "outputs": ["impulse"]}


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Return counts: problems and limiters that are decoded, and all their frequencies."""
    counts: Counter[str] = Counter()
    problem, limiters, frequencies = decode.problem, decode.constraints, decode.frequencies

    def counted_problem(*given: Any) -> Any:
        counts["problems"] += 1
        return problem(*given)

    def counted_limiters(*given: Any) -> Any:
        counts["limiters"] += 1
        return limiters(*given)

    def counted_frequencies(grid: Any, units: Any) -> Any:
        counts["frequencies"] += grid.count
        return frequencies(grid, units)

    monkeypatch.setattr(decode, "problem", counted_problem)
    monkeypatch.setattr(decode, "constraints", counted_limiters)
    monkeypatch.setattr(decode, "frequencies", counted_frequencies)
    return counts


def plan(folder: Path, kind: str, base: dict[str, Any], *axes: dict[str, Any]) -> planning.Planned:
    content = {"kind": kind, "base": base, "axes": list(axes)}
    asked = requests.read("ann", KINDS["sweep"], content)
    return planning.plan(Store(str(folder)), asked.kind, asked.document, Settings(data=folder))


def test_sizes_come_before_everything_else(tmp_path: Path, decoded: Counter[str]) -> None:
    with pytest.raises(ProblemError) as error:
        plan(tmp_path, "impact-modes", modes(10**7), {**GAP, "num": 10**6})
    assert error.value.type.status == 413
    assert error.value.errors[0].pointer == "/axes"
    assert not decoded


def test_few_of_a_million_points_are_tried(tmp_path: Path, decoded: Counter[str]) -> None:
    for axes in (
        [{**GAP, "num": 10**6}],
        [{**GAP, "num": 1000}, {**RESTITUTION, "num": 1000}],
        [{**GAP, "num": 10}, {**RESTITUTION, "num": 10**5}],
    ):
        decoded.clear()
        planned = plan(tmp_path, "resonances", RESONANCES, *axes)
        assert planned.problem.shape == tuple(axis["num"] for axis in axes)
        assert decoded["problems"] < 500
        assert decoded["limiters"] < 500


def test_frequencies_are_not_made_for_each_value(tmp_path: Path, decoded: Counter[str]) -> None:
    plan(tmp_path, "impact-modes", modes(10**5), {**GAP, "num": 100})
    assert decoded["problems"] > 64
    assert decoded["frequencies"] < 3 * 10**5
    decoded.clear()
    stop = {"path": "frequency.stop", "start": 2.0, "stop": 3.0, "num": 100}
    plan(tmp_path, "impact-modes", modes(10**5), stop)
    assert decoded["frequencies"] < 3 * 10**5


def test_the_least_and_the_greatest_value_are_tried(tmp_path: Path) -> None:
    values = [0.2 + 1e-6 * k for k in range(10_000)]
    values[5001] = -0.5
    with pytest.raises(ProblemError) as error:
        plan(tmp_path, "resonances", RESONANCES, {"path": RESTITUTION["path"], "values": values})
    assert error.value.errors[0].pointer == "/axes/0/values/5001"


def test_all_values_of_an_integer_are_whole(tmp_path: Path) -> None:
    values = [0.0] * 20_000
    values[15_001] = 0.5
    system = {**CHAIN, "constraints": [{"dof": 5, "gap": 0.2}, {"dof": 6, "gap": 0.2}]}
    base, axis = {**RESONANCES, "system": system}, {"path": "constraint", "values": values}
    with pytest.raises(ProblemError) as error:
        plan(tmp_path, "resonances", base, axis)
    assert error.value.errors[0].pointer == "/axes/0/values/15001"
    assert error.value.errors[0].code == "wrong_type"
    assert sweep_axes._VALUES_TRIED < 15_001
