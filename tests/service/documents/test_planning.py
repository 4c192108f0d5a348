"""Requests are checked and planned; what is wrong is refused before memory is allocated."""

from __future__ import annotations

from typing import Any

import pytest

from vibroimpact_schema import examples
from vibroimpact_schema.plans import Steps
from vibroimpact_schema.requests import ImpactModesRequest
from vibroimpact_service import problems
from vibroimpact_service.documents import parse, planning
from vibroimpact_service.kinds import KINDS, Kind
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

KIND = KINDS["impact-modes"]


def test_limits_hold_before_the_system_is_made(settings: Settings, store: Store) -> None:
    content = {
        "system": {"M": {"scalar": 1, "n": 10**12}, "K": {"scalar": 1, "n": 1}, "constraints": []},
        "frequency": {"values": [1]},
    }
    request = ImpactModesRequest.model_validate(content)
    with pytest.raises(ProblemError) as caught:
        planning.plan(store, KIND, request, settings)
    assert caught.value.type is problems.TOO_LARGE


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_steps_are_the_content_of_their_document(store: Store, kind: Kind) -> None:
    for example in examples.requests(kind.name).values():
        request: Any = parse.document(kind.request, example["request"])
        steps = planning.steps(planning.plan(store, kind, request).plan)
        assert Steps.model_validate(steps).model_dump() == steps
