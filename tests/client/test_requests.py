"""Request builders: both clients send what they return, and the schema accepts it."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

import vibroimpact as vi
from vibroimpact import client, plots
from vibroimpact.computations import Computations
from vibroimpact_schema.requests import (
    AttractorsRequest,
    EnsembleRequest,
    ExistenceBandsRequest,
    ImpactModesRequest,
    ResonancesRequest,
    TimeHistoryRequest,
)
from vibroimpact_schema.slow_flows import SlowFlowRequest

CHAIN = vi.chain(3, [vi.constraint(0, 0.1)])
STATES = np.zeros((2, 3)), np.ones((2, 3))
START = {"gamma": 0.2}


class Recorder(Computations[Any, Any, Any, Any, Any, Any, Any, Any, Any, Any, Any, Any]):
    """Returns the kind and the request instead of a result."""

    def _compute(self, kind: str, request: Mapping[str, Any], *, progress: bool = False) -> Any:
        return kind, request


@pytest.mark.parametrize(
    ("method", "build", "arguments", "options"),
    [
        (
            "impact_modes",
            vi.impact_modes_request,
            (CHAIN, (1.0, 2.0, 5)),
            {"active": [0], "tau": 0.5},
        ),
        ("existence_bands", vi.existence_bands_request, (CHAIN, 1, 2), {"tolerance": 1e-9}),
        (
            "natural_frequencies",
            vi.natural_frequencies_request,
            (CHAIN, 3),
            {"fixed": [0], "directions": np.ones(13)},
        ),
        ("resonances", vi.resonances_request, (CHAIN, 0), {"odd_max": 5}),
        (
            "periodic_motions",
            vi.periodic_motions_request,
            (CHAIN, (1.0, 2.0, 5), [vi.drive(0, 1.0)]),
            {"sequence": [(0, "upper"), (0, "lower")], "phases": [1.0, 4.0]},
        ),
        (
            "branches",
            vi.branches_request,
            ({"system": CHAIN}, "frequency.values.0", 1.0, 2.0),
            {"switch": 1, "stop_at": ["end"]},
        ),
        (
            "attractors",
            vi.attractors_request,
            (CHAIN, 1.0, [vi.drive(0, 1.0)], *STATES),
            {"section": "impacts", "observe": 50},
        ),
        (
            "calibration",
            vi.calibration_request,
            (
                "natural-frequencies",
                {"system": CHAIN},
                {"system.stiffness": (1.0, 0.5, None)},
                [{"output": "Omega", "values": [0.3, float("nan")], "sigma": 0.01}],
            ),
            {"starts": 3, "outputs": "interval"},
        ),
        ("time_history", vi.time_history_request, (CHAIN, 2.0, 10), {"t": 7, "digits": 30}),
        ("ensemble", vi.ensemble_request, (CHAIN, *STATES, 10.0), {"dofs": [1]}),
        ("slow_flow", vi.slow_flow_request, (CHAIN, "damped", "exact", START, [1.0]), {}),
    ],
)
def test_the_method_sends_what_the_builder_returns(
    method: str, build: Callable[..., Any], arguments: tuple[Any, ...], options: dict[str, Any]
) -> None:
    kind, request = getattr(Recorder(), method)(*arguments, **options)
    assert kind == method.replace("_", "-")
    assert request == build(*arguments, **options)
    if method != "ensemble":
        given, built = (inspect.signature(f) for f in (getattr(Computations, method), build))
        assert list(given.parameters)[1:] == list(built.parameters)
        assert [p.default for p in given.parameters.values()][1:] == [
            p.default for p in built.parameters.values()
        ]


def test_an_ensemble_is_asked_for_like_a_motion_alone() -> None:
    shared = {
        "t": 7,
        "outputs": ["x", "impacts"],
        "dofs": [1],
        "load": [vi.harmonic(0, 1.0, 2.0)],
        "limiter": vi.soft(100.0),
        "method": "RK45",
        "tolerance": 1e-9,
    }
    alone = vi.time_history_request(CHAIN, STATES, 10.0, **shared)
    many = vi.ensemble_request(CHAIN, *STATES, 10.0, **shared)
    assert set(shared) <= set(many)
    x, v = STATES
    assert many.pop("initial") == {"x": x.tolist(), "v": v.tolist()}
    del alone["initial"]
    assert many == alone


@pytest.mark.parametrize(
    ("model", "request_body"),
    [
        (ExistenceBandsRequest, vi.existence_bands_request(CHAIN, 1, 2, active=[0])),
        (ImpactModesRequest, vi.impact_modes_request(CHAIN, [1.0])),
        (ResonancesRequest, vi.resonances_request(CHAIN)),
        (SlowFlowRequest, vi.slow_flow_request(CHAIN, "damped", "exact", START, (0.0, 1.0, 2))),
    ],
)
def test_the_schema_accepts_requests(model: type[BaseModel], request_body: dict[str, Any]) -> None:
    model.model_validate(request_body)


def test_both_clients_share_the_methods() -> None:
    for kind in ("impact_modes", "existence_bands", "resonances", "time_history", "sweep"):
        assert getattr(vi.Client, kind) is getattr(vi.AsyncClient, kind)
    answer = vi.AsyncClient("http://service").compute("resonances", vi.resonances_request(CHAIN))
    assert inspect.iscoroutine(answer)
    answer.close()


def test_former_addresses_warn() -> None:
    with pytest.warns(DeprecationWarning, match="import it from vibroimpact"):
        assert client.slow_flow_request is vi.slow_flow_request  # type: ignore[attr-defined]
    with pytest.warns(DeprecationWarning, match="ADMISSIBLE"):
        assert plots.REAL == plots.ADMISSIBLE  # type: ignore[attr-defined]
    for module, name in ((client, "nothing"), (client, "odd_request"), (plots, "nothing")):
        with pytest.raises(AttributeError, match=name):
            getattr(module, name)


def test_a_range_of_bands_is_two_numbers_or_a_pair() -> None:
    expected = vi.existence_bands_request(CHAIN, 1.0, 2.0)
    assert vi.existence_bands_request(CHAIN, (1.0, 2.0)) == expected
    assert vi.existence_bands_request(CHAIN, np.array([1.0, 2.0])) == expected  # type: ignore[arg-type]
    for wrong in (1.0, (1.0, 2.0, 3.0)):
        with pytest.raises(TypeError, match="two ends"):
            vi.existence_bands_request(CHAIN, wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (([0.0, 0.1], [1.0, 0.0]), {"x": [[0.0, 0.1]], "v": [[1.0, 0.0]]}),
        (([[0.0, 0.1]], [[1.0, 0.0]]), {"x": [[0.0, 0.1]], "v": [[1.0, 0.0]]}),
        ({"x": [0.0, 0.1], "v": [1.0, 0.0]}, {"x": [0.0, 0.1], "v": [1.0, 0.0]}),
        (1.5, {"impact_mode": {"Omega": 1.5}}),
        ([{"impact_mode": {"Omega": 1.5}}], [{"impact_mode": {"Omega": 1.5}}]),
    ],
)
def test_many_motions_take_initial_states_as_one_does(given: Any, expected: Any) -> None:
    drive = [vi.drive(0, 1.0)]
    for request, schema in (
        (vi.ensemble_request(CHAIN, t_end=1.0, initial=given), EnsembleRequest),
        (vi.attractors_request(CHAIN, 2.0, drive, initial=given), AttractorsRequest),
    ):
        assert request["initial"] == expected
        schema.model_validate(request)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((), {"t_end": 1.0}, "give x and v, or initial"),
        (([0.0], [1.0], 1.0), {"initial": 1.5}, "give x and v, or initial"),
        (([0.0],), {"t_end": 1.0}, "x and v go together"),
        (([0.0], [1.0]), {}, "t_end is missing"),
        ((), {"t_end": 1.0, "initial": [1.0, 2.0, 3.0]}, "initial must be"),
        ((), {"t_end": 1.0, "initial": "rest"}, "initial must be"),
    ],
)
def test_initial_states_that_are_none(arguments: Any, options: Any, message: str) -> None:
    with pytest.raises(TypeError, match=message):
        vi.ensemble_request(CHAIN, *arguments, **options)


def test_the_frequency_of_attractors_is_given_as_those_of_other_kinds() -> None:
    drive, at = [vi.drive(0, 1.0)], ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    asked = [vi.attractors_request(CHAIN, f, drive, *at) for f in (2.0, [2.0], {"values": [2.0]})]
    assert asked[0] == asked[1]
    assert {*map(str, map(AttractorsRequest.model_validate, asked))} == {
        str(AttractorsRequest.model_validate(asked[0]))
    }
    in_hz = vi.attractors_request(CHAIN, 2.0, drive, *at, unit="Hz")
    assert in_hz["frequency"] == {"unit": "Hz", "values": [2.0]}


def test_sweeps_are_continued_by_a_word() -> None:
    base = vi.time_history_request(CHAIN, ([0.0], [1.0]), 1.0)
    axes = {"t_end": {"start": 2.0, "stop": 1.0, "step": -0.5}}
    assert vi.sweep_request("time-history", base, axes, continued=True)["continue"] is True
    assert "continue" not in vi.sweep_request("time-history", base, axes)


def test_a_motion_starts_at_rest_where_nothing_is_said() -> None:
    request = vi.time_history_request(CHAIN, t_end=1.0)
    assert "initial" not in request
    TimeHistoryRequest.model_validate(request)
    with pytest.raises(TypeError, match="t_end is missing"):
        vi.time_history_request(CHAIN)


def test_impacts_may_be_given_as_requests_have_them() -> None:
    documents = [{"constraint": 0, "side": "upper"}, {"constraint": 0, "side": "lower"}]
    for sequence in (documents, [(0, "upper"), (0, "lower")]):
        request = vi.periodic_motions_request(CHAIN, [1.0], [vi.drive(0, 1.0)], sequence=sequence)
        assert request["sequence"] == documents
