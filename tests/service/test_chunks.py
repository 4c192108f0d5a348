"""A computation in chunks gives what it gives in one go."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vibroimpact_schema.requests import ImpactModesRequest
from vibroimpact_service.documents import digest, planning, requests
from vibroimpact_service.jobs.work import ChunkMissingError
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.results import encode
from vibroimpact_service.store import Store, StoreUnavailableError
from vibroimpact_service.use_case import chunks as job_chunks
from vibroimpact_service.use_case import computation, warming
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.meter import LimitPassedError, StopSignal

KIND = KINDS["impact-modes"]
RESULT = "ab" * 32


def keep_request(store: Store, content: dict[str, Any]) -> tuple[ImpactModesRequest, str, bytes]:
    request = ImpactModesRequest.model_validate(content)
    data = digest.canonical(request)
    name = digest.content(data)
    store.requests.put(name, data)
    return request, name, data


@pytest.mark.needs("compiled kernels")
def test_pieces_give_the_numbers_of_the_whole(
    store: Store, request_body: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    request_body["frequency"] = {"start": 0.5, "stop": 3.0, "num": 997}
    request_body["outputs"] = ["impulse", "exists", "reason", "shape", "energy"]
    request, name, data = keep_request(store, request_body)
    whole_seconds = planning.plan(store, KIND, request).seconds
    monkeypatch.setattr(job_chunks, "CHUNK_SECONDS", whole_seconds / 6)
    names = job_chunks.split(store.url, KIND.name, name, RESULT)
    assert 3 < len(names) == len(set(names)) < 20
    for index in range(len(names)):
        job_chunks.solve(store.url, KIND.name, name, RESULT, [index])
    job_chunks.join(store.url, KIND.name, name, RESULT, names)
    whole = "cd" * 32
    computation.put(
        store, computation.compute(planning.plan(store, KIND, request), whole, data), durable=False
    )
    joined, once = (encode.unpack(store.results.get(n) or b"") for n in (RESULT, whole))
    assert set(joined.arrays) == set(once.arrays)
    for field, values in once.arrays.items():
        np.testing.assert_array_equal(joined.arrays[field], values)


def keep_for(store: Store, owner: str, content: dict[str, Any]) -> str:
    request = ImpactModesRequest.model_validate(content)
    block = requests.stored_form(owner, digest.canonical(request))
    name = digest.content(block)
    store.requests.put(name, block)
    return name


def steps(start: float, stop: float) -> dict[str, Any]:
    return {"start": start, "stop": stop, "step": 0.001}


@pytest.mark.needs("compiled kernels")
def test_longer_and_shifted_sweeps_share_their_chunks(
    store: Store, request_body: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job_chunks, "CHUNK_SECONDS", 0.0002)

    def chunks(owner: str, **changes: Any) -> set[str]:
        name = keep_for(store, owner, {**request_body, **changes})
        found = job_chunks.split(store.url, KIND.name, name, RESULT)
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


@pytest.mark.needs("compiled kernels")
def test_a_longer_sweep_from_shared_chunks_has_the_numbers_of_one_in_one_go(
    store: Store, request_body: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job_chunks, "CHUNK_SECONDS", 0.0002)
    request_body["outputs"] = ["impulse", "exists", "reason", "shape", "energy"]
    computed = []
    for grid in (steps(0.9, 1.6), steps(0.6, 2.1)):
        name = keep_for(store, "ann", {**request_body, "frequency": grid})
        chunks = job_chunks.split(store.url, KIND.name, name, RESULT)
        there = store.chunks.sound([chunk.name for chunk in chunks])
        missing = [i for i, chunk in enumerate(chunks) if chunk.name not in there]
        computed.append(len(missing))
        job_chunks.solve(store.url, KIND.name, name, RESULT, missing)
    assert computed[1] < len(chunks)
    job_chunks.join(store.url, KIND.name, name, RESULT, chunks)
    request = ImpactModesRequest.model_validate({**request_body, "frequency": steps(0.6, 2.1)})
    planned = planning.plan(store, KIND, request)
    whole = "cd" * 32
    computation.put(
        store, computation.compute(planned, whole, digest.canonical(request)), durable=False
    )
    joined, once = (encode.unpack(store.results.get(n) or b"") for n in (RESULT, whole))
    assert set(joined.arrays) == set(once.arrays)
    for field, values in once.arrays.items():
        np.testing.assert_array_equal(joined.arrays[field], values)


def test_what_surrounds_the_numbers_is_fixed_when_they_are_stored(
    store: Store, request_body: dict[str, Any]
) -> None:
    request, _, data = keep_request(store, request_body)
    planned = planning.plan(store, KIND, request)
    computation.put(store, computation.compute(planned, RESULT, data), durable=False)
    first = store.results.get(RESULT)
    computation.put(store, computation.compute(planned, RESULT, data), durable=False)
    assert store.results.get(RESULT) == first
    head = encode.unpack(first or b"").head
    assert head["request"].encode() == data
    assert head["provenance"]["solver_version"] == digest.SOLVER_VERSION
    assert head["units"] is None


def test_a_failure_is_explained_without_its_inner_words() -> None:
    assert job_chunks.explain(ConvergenceError("no root"))["code"] == "no_convergence"
    document = job_chunks.explain(RuntimeError("/secret/path"))
    assert document["code"] == "internal_error"
    assert "secret" not in str(document)


def test_lost_requests_and_chunks_are_errors(store: Store, request_body: dict[str, Any]) -> None:
    # It is no fault of the job, which is begun again, with its request from the records.
    with pytest.raises(StoreUnavailableError):
        job_chunks.split(store.url, KIND.name, "f" * 64, RESULT)
    _, name, _ = keep_request(store, request_body)
    names = job_chunks.split(store.url, KIND.name, name, RESULT)
    with pytest.raises(ChunkMissingError):
        job_chunks.join(store.url, KIND.name, name, RESULT, names)
    assert not Path(store.url, "results").exists()


def test_a_repeated_call_leaves_the_chunks_that_are_there(
    store: Store, request_body: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job_chunks, "CHUNK_SECONDS", 0.0002)
    name = keep_for(store, "ann", {**request_body, "frequency": steps(0.6, 1.6)})
    chunks = job_chunks.split(store.url, KIND.name, name, RESULT)
    store.chunks.put(chunks[0].name, b"of the first call")
    job_chunks.solve(store.url, KIND.name, name, RESULT, [0, 1])
    assert store.chunks.get(chunks[0].name) == b"of the first call"
    assert store.chunks.has(chunks[1].name)
    assert not store.chunks.has(chunks[2].name)


def test_a_piece_that_takes_far_more_than_planned_ends_and_says_what_is_kept(
    store: Store, request_body: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    from vibroimpact_solvers import impact_modes

    monkeypatch.setattr(job_chunks, "CHUNK_SECONDS", 0.0002)
    name = keep_for(store, "ann", {**request_body, "frequency": steps(0.6, 1.6)})
    arguments = (store.url, KIND.name, name, RESULT)
    total = len(job_chunks.split(*arguments))
    job_chunks.solve(*arguments, [0], StopSignal())

    def endless(_problem: Any, _plan: Any, tick: Any) -> None:
        while True:
            tick(0, 1)

    monkeypatch.setattr(impact_modes, "solve", endless)
    monkeypatch.setattr(job_chunks, "_LEAST_LIMIT", 0.05)
    monkeypatch.setattr(warming, "is_compiled", lambda kind: kind == KIND.name)
    with pytest.raises(
        LimitPassedError, match=f"0% of it was done. 1 of {total} pieces are kept"
    ) as passed:
        job_chunks.solve(*arguments, [1], StopSignal())
    problem = job_chunks.explain(passed.value)
    assert (problem["code"], problem["status"]) == ("limit_passed", 422)
    assert problem["detail"] == str(passed.value)


@pytest.mark.needs("compiled kernels")
def test_kernels_may_be_compiled_beside_the_limit_of_a_piece(
    store: Store, request_body: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """No processor time is left for the piece: what it takes could be that of its kernels."""
    name = keep_for(store, "ann", {**request_body, "frequency": steps(0.6, 1.6)})
    arguments = (store.url, KIND.name, name, RESULT)
    monkeypatch.setattr(job_chunks, "_LEAST_LIMIT", 0.0)
    monkeypatch.setattr(job_chunks, "_TIMES_PLANNED", 0.0)
    monkeypatch.setattr(warming, "is_compiled", lambda _kind: True)
    with pytest.raises(LimitPassedError):
        job_chunks.solve(*arguments, [0], StopSignal())
    monkeypatch.setattr(warming, "is_compiled", lambda _kind: False)
    job_chunks.solve(*arguments, [0], StopSignal())
    (chunk, *_) = job_chunks.split(*arguments)
    assert store.chunks.has(chunk.name)
