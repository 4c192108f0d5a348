"""Every example is a valid request of its kind."""

from __future__ import annotations

import pytest

from vibroimpact_schema import examples, requests


def test_examples_are_found_by_kind() -> None:
    assert "chain" in examples.requests("impact-modes")
    assert examples.requests("no-such-kind") == {}


@pytest.mark.parametrize("name", examples.requests("impact-modes"))
def test_examples_of_impact_modes_fit_their_model(name: str) -> None:
    example = examples.requests("impact-modes")[name]
    assert example["summary"]
    request = requests.ImpactModesRequest.model_validate(example["request"])
    assert requests.ImpactModesRequest.model_validate(request.model_dump()) == request
