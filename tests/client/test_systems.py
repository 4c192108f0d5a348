"""The documents that the helpers make are those that the schema takes."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse
from pydantic import TypeAdapter

import vibroimpact as vi
from vibroimpact.grids import frequencies
from vibroimpact.systems import matrix
from vibroimpact_schema.requests import ImpactModesRequest, TimeHistoryRequest
from vibroimpact_schema.slow_flows import SlowFlowRequest
from vibroimpact_schema.systems import System

STOP = [vi.constraint(0, 0.1)]


@pytest.mark.parametrize(
    "document",
    [
        vi.chain(3, STOP),
        vi.oscillator(STOP),
        vi.two_mass(STOP, coupling=0.5),
        vi.double_pendulum(STOP, 2.0),
        vi.absorber(STOP, tuning=0.0, damping=0.01),
        vi.beam(4, STOP, EI=100.0, rhoA=0.8, damping=0.01),
        vi.bouncing_ball([vi.constraint(0, {"lower": 0.0, "upper": None})]),
        vi.system(np.eye(2), np.eye(2), STOP, C=np.ones(2), force=[0, 1]),
        vi.system(
            np.ones(2),
            scipy.sparse.eye_array(2),
            [vi.constraint(gap=1.0, direction={0: 1.0, 1: -1.0})],
            units={"length": "m", "mass": "kg", "time": "s"},
        ),
    ],
)
def test_documents_are_valid(document: dict[str, object]) -> None:
    TypeAdapter(System).validate_python(document)


def test_matrices_keep_every_bit() -> None:
    K = np.array([[2.0, -1 / 3], [-1 / 3, np.pi]])
    assert matrix(K) == K.tolist()
    assert matrix(scipy.sparse.csr_array(K))["data"] == K.ravel().tolist()


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (np.array([1.0, 2.0]), {"values": [1.0, 2.0], "unit": "Omega"}),
        (1.5, {"values": [1.5], "unit": "Omega"}),
        ((1.0, 2, 3), {"start": 1.0, "stop": 2.0, "num": 3, "unit": "Omega"}),
        (
            {"start": 1.0, "stop": 2.0, "step": 0.5},
            {"start": 1.0, "stop": 2.0, "step": 0.5, "unit": "Omega"},
        ),
    ],
)
def test_grids(given: object, expected: dict[str, object]) -> None:
    assert frequencies(given) == expected


def test_the_request_is_what_the_schema_takes() -> None:
    request = vi.impact_modes_request(
        vi.chain(3, STOP), [1.0], outputs=("waveform",), tau=[0.5], dofs=np.array([1]), active=[0]
    )
    ImpactModesRequest.model_validate(request)


def test_the_request_of_a_slow_flow_is_what_the_schema_takes() -> None:
    for t in ((0, 9, 10), [0.5, 1.0], {"stop": 3.0, "num": 4}):
        request = vi.slow_flow_request(
            vi.oscillator(STOP), "oscillator", "family", {"energy": 1, "root": 1}, t
        )
        SlowFlowRequest.model_validate(request)


def test_a_coordinate_between_degrees_of_freedom_is_named_in_two_ways() -> None:
    weights = {0: 1.0, 1: -1.0}
    stop = vi.constraint(weights, 0.5)
    assert stop == vi.constraint(direction=weights, gap=0.5)
    assert stop["direction"] == {"dofs": [0, 1], "weights": [1.0, -1.0]}
    assert vi.dashpot(weights, 3.0) == vi.dashpot(direction=weights, c=3.0)
    for both in (vi.constraint, vi.dashpot):
        with pytest.raises(ValueError, match="either a dof or a direction"):
            both(0, 0.5, direction=weights)


def test_a_single_constraint_or_output_needs_no_list() -> None:
    assert vi.chain(3, STOP[0]) == vi.chain(3, STOP)
    assert vi.system([1.0], [1.0], STOP[0]) == vi.system([1.0], [1.0], STOP)
    request = vi.impact_modes_request(vi.chain(3, STOP), (1.0, 2.0, 3), outputs="impulse")
    assert request["outputs"] == ["impulse"]
    assert vi.sweep_request("impact-modes", request, {}, "exists")["outputs"] == ["exists"]


@pytest.mark.parametrize("given", [(1.0, 1.5, 2.0), (1, 2, 3), (0.5, 1, 1.5), (3, 2, 1)])
def test_a_tuple_that_can_be_three_values_is_refused(given: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="three values"):
        vi.impact_modes_request(vi.chain(3, STOP), given)
    with pytest.raises(ValueError, match="three values"):
        vi.sweep_request("impact-modes", {}, {"system.stiffness": given})
    assert vi.impact_modes_request(vi.chain(3, STOP), list(given))["frequency"]["values"] == [
        float(one) for one in given
    ]


def test_the_number_of_times_may_be_numpys() -> None:
    request = vi.time_history_request(vi.chain(3, STOP), 2.0, 10.0, t=np.int64(7))
    assert request["t"] == {"num": 7}
    assert type(request["t"]["num"]) is int


def test_sampled_loads_and_moving_bases() -> None:
    force, acceleration = np.array([0.0, 1.0, 0.5]), [0, 2]
    load = [
        vi.sampled(1, force, interval=0.5),
        vi.sampled({0: 1.0, 2: -0.5}, force, np.array([0.0, 0.5, 1.0])),
        vi.base_motion(np.ones(3), acceleration, interval=1),
        vi.harmonic(0, 1.0, 2.0),
    ]
    request = vi.time_history_request(vi.chain(3, STOP), ([0.0] * 3, [0.1] * 3), 1.0, load=load)
    read = TimeHistoryRequest.model_validate(request)
    assert [type(term).__name__ for term in read.load or ()] == [
        "SampledLoad", "SampledLoad", "BaseMotion", "HarmonicLoad"
    ]  # fmt: skip
    assert load[1]["direction"] == {"dofs": [0, 2], "weights": [1.0, -0.5]}
    assert load[2] == {"base": [1.0] * 3, "acceleration": [0.0, 2.0], "interval": 1.0}
