"""Every example is a valid request of its kind."""

from __future__ import annotations

import pytest

from vibroimpact_schema import examples, requests, slow_flows, sweeps


def test_examples_are_found_by_kind() -> None:
    assert "chain" in examples.requests("impact-modes")
    assert examples.requests("no-such-kind") == {}


@pytest.mark.parametrize("name", examples.requests("slow-flow"))
def test_examples_of_slow_flows_fit_their_model(name: str) -> None:
    example = examples.requests("slow-flow")[name]
    assert example["summary"]
    request = slow_flows.SlowFlowRequest.model_validate(example["request"])
    assert slow_flows.SlowFlowRequest.model_validate(request.model_dump()) == request


@pytest.mark.parametrize("name", examples.requests("impact-modes"))
def test_examples_of_impact_modes_fit_their_model(name: str) -> None:
    example = examples.requests("impact-modes")[name]
    assert example["summary"]
    request = requests.ImpactModesRequest.model_validate(example["request"])
    assert requests.ImpactModesRequest.model_validate(request.model_dump()) == request


@pytest.mark.parametrize("name", examples.requests("sweep"))
def test_examples_of_sweeps_fit_their_model(name: str) -> None:
    example = examples.requests("sweep")[name]
    assert example["summary"]
    request = sweeps.SweepRequest.model_validate(example["request"])
    assert sweeps.SweepRequest.model_validate(request.model_dump()) == request
