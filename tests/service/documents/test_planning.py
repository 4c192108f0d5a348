"""Requests are checked and planned; what is wrong is refused before memory is allocated."""

from __future__ import annotations

import gc
import time
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


def test_garbage_of_others_is_no_work_of_a_plan(settings: Settings, store: Store) -> None:
    """A collection takes a second where there are millions of objects, in whichever thread."""
    content = examples.requests(KIND.name)["chain"]["request"]
    request, before = ImpactModesRequest.model_validate(content), gc.get_threshold()
    planning.plan(store, KIND, request, settings)  # loads what it needs

    def collect(phase: str, _: object) -> None:
        end = time.thread_time() + 2.0 * settings.plan_seconds
        while phase == "start" and time.thread_time() < end:
            pass

    gc.callbacks.append(collect)
    try:
        gc.set_threshold(1)
        planned = planning.plan(store, KIND, request, settings)
    finally:
        gc.callbacks.remove(collect)
        gc.set_threshold(*before)
    assert planned.seconds > 0.0
