"""A computation in pieces gives what it gives in one go; wrong requests leave nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vibroimpact_schema.requests import ImpactModesRequest
from vibroimpact_schema.systems import SystemReference
from vibroimpact_service import digest, encode, problems, tasks
from vibroimpact_service.jobs.work import ChunkMissingError
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_solvers.errors import ConvergenceError

KIND = KINDS["impact-modes"]
RESULT = "ab" * 32


def keep_request(store: Store, content: dict[str, Any]) -> tuple[ImpactModesRequest, str, bytes]:
    request = ImpactModesRequest.model_validate(content)
    data = digest.canonical(request)
    name = digest.content(data)
    store.requests.put(name, data)
    return request, name, data


def test_pieces_give_the_numbers_of_the_whole(
    store: Store, request_body: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    request_body["frequency"] = {"start": 0.5, "stop": 3.0, "num": 997}
    request_body["outputs"] = ["impulse", "exists", "reason", "shape", "energy"]
    request, name, data = keep_request(store, request_body)
    whole_seconds = tasks.seconds(tasks.assign(store, KIND, request))
    monkeypatch.setattr(tasks, "CHUNK_SECONDS", whole_seconds / 6)
    names = tasks.split(store.url, KIND.name, name, RESULT)
    assert 3 < len(names) == len(set(names)) < 20
    for index in range(len(names)):
        tasks.solve(store.url, KIND.name, name, RESULT, [index])
    tasks.join(store.url, KIND.name, name, RESULT, names)
    whole = "cd" * 32
    tasks.compute(store, whole, tasks.assign(store, KIND, request), data)
    joined, once = (encode.open_bundle(store.results.get(n) or b"") for n in (RESULT, whole))
    assert set(joined.arrays) == set(once.arrays)
    for field, values in once.arrays.items():
        np.testing.assert_array_equal(joined.arrays[field], values)


def keep_for(store: Store, owner: str, content: dict[str, Any]) -> str:
    request = ImpactModesRequest.model_validate(content)
    block = tasks.request_block(owner, digest.canonical(request))
    name = digest.content(block)
    store.requests.put(name, block)
    return name


def steps(start: float, stop: float) -> dict[str, Any]:
    return {"start": start, "stop": stop, "step": 0.001}


def test_longer_and_shifted_sweeps_share_their_chunks(
    store: Store, request_body: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tasks, "CHUNK_SECONDS", 0.0002)

    def chunks(owner: str, **changes: Any) -> set[str]:
        name = keep_for(store, owner, {**request_body, **changes})
        found = tasks.split(store.url, KIND.name, name, RESULT)
        assert all(chunk.lasting for chunk in found)
        assert len({chunk.name for chunk in found}) == len(found)
        return {chunk.name for chunk in found}

    first = chunks("ann", frequency=steps(0.6, 1.6))
    assert len(first) > 6
    assert first == chunks("ann", frequency=steps(0.6, 1.6))
    # All but the incomplete pieces at the ends are the same.
    assert len(first - chunks("ann", frequency=steps(0.6, 1.9))) <= 1
    assert len(first - chunks("ann", frequency=steps(0.573, 1.6))) <= 1
    # Whatever else changes, nothing is shared; nor is anything between owners.
    assert first.isdisjoint(chunks("bob", frequency=steps(0.6, 1.6)))
    assert first.isdisjoint(chunks("ann", frequency=steps(0.6, 1.6), outputs=["impulse"]))
    assert first.isdisjoint(chunks("ann", frequency={**steps(0.6, 1.6), "unit": "omega"}))
    assert first.isdisjoint(chunks("ann", frequency={**steps(0.6, 1.6), "step": 0.0011}))


def test_a_longer_sweep_from_shared_chunks_has_the_numbers_of_one_in_one_go(
    store: Store, request_body: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tasks, "CHUNK_SECONDS", 0.0002)
    request_body["outputs"] = ["impulse", "exists", "reason", "shape", "energy"]
    computed = []
    for grid in (steps(0.9, 1.6), steps(0.6, 2.1)):
        name = keep_for(store, "ann", {**request_body, "frequency": grid})
        chunks = tasks.split(store.url, KIND.name, name, RESULT)
        there = store.chunks.present([chunk.name for chunk in chunks])
        missing = [i for i, chunk in enumerate(chunks) if chunk.name not in there]
        computed.append(len(missing))
        tasks.solve(store.url, KIND.name, name, RESULT, missing)
    assert computed[1] < len(chunks)
    tasks.join(store.url, KIND.name, name, RESULT, chunks)
    request = ImpactModesRequest.model_validate({**request_body, "frequency": steps(0.6, 2.1)})
    assignment = tasks.assign(store, KIND, request)
    whole = "cd" * 32
    tasks.compute(store, whole, assignment, digest.canonical(request))
    joined, once = (encode.open_bundle(store.results.get(n) or b"") for n in (RESULT, whole))
    assert set(joined.arrays) == set(once.arrays)
    for field, values in once.arrays.items():
        np.testing.assert_array_equal(joined.arrays[field], values)


def test_what_surrounds_the_numbers_is_fixed_when_they_are_stored(
    store: Store, request_body: dict[str, Any]
) -> None:
    request, _, data = keep_request(store, request_body)
    assignment = tasks.assign(store, KIND, request)
    tasks.compute(store, RESULT, assignment, data)
    first = store.results.get(RESULT)
    tasks.compute(store, RESULT, assignment, data)
    assert store.results.get(RESULT) == first
    head = encode.open_bundle(first or b"").head
    assert head["request"].encode() == data
    assert head["provenance"]["solver_version"] == tasks.SOLVER_VERSION
    assert head["units"] is None


def test_limits_hold_before_the_system_is_made(settings: Settings, store: Store) -> None:
    content = {
        "system": {"M": {"scalar": 1, "n": 10**12}, "K": {"scalar": 1, "n": 1}, "constraints": []},
        "frequency": {"values": [1]},
    }
    request = ImpactModesRequest.model_validate(content)
    with pytest.raises(ProblemError) as caught:
        tasks.assign(store, KIND, request, settings)
    assert caught.value.type is problems.TOO_LARGE


def test_stored_systems_stand_for_themselves(store: Store, chain: dict[str, Any]) -> None:
    document = tasks.SYSTEM.validate_python(chain)
    name = "sys_" + "0" * 64
    store.systems.put(name, digest.canonical(document))
    assert tasks.stored_system(store, SystemReference(id=name)) == document
    moved = tasks.SYSTEM.validate_python({"id": name, "constraints": [{"dof": 1, "gap": 3}]})
    assert isinstance(moved, SystemReference)
    found = tasks.stored_system(store, moved)
    assert found.constraints == moved.constraints
    with pytest.raises(ProblemError) as caught:
        tasks.stored_system(store, SystemReference(id="sys_" + "1" * 64), "system")
    assert caught.value.errors[0].pointer == "/system/id"


def test_a_failure_is_explained_without_its_inner_words() -> None:
    assert tasks.explain(ConvergenceError("no root"))["code"] == "no_convergence"
    document = tasks.explain(RuntimeError("/secret/path"))
    assert document["code"] == "internal_error"
    assert "secret" not in str(document)


def test_the_solvers_are_named_by_their_sources() -> None:
    version, _, fingerprint = tasks.solver_name().partition("+")
    assert version == tasks.SOLVER_VERSION
    assert len(fingerprint) == 16
    assert tasks.solver_name() == tasks.solver_name()


def test_lost_requests_and_chunks_are_errors(store: Store, request_body: dict[str, Any]) -> None:
    with pytest.raises(FileNotFoundError):
        tasks.split(store.url, KIND.name, "f" * 64, RESULT)
    _, name, _ = keep_request(store, request_body)
    names = tasks.split(store.url, KIND.name, name, RESULT)
    with pytest.raises(ChunkMissingError):
        tasks.join(store.url, KIND.name, name, RESULT, names)
    assert not Path(store.url, "results").exists()
