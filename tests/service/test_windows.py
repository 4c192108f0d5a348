"""Long time histories as jobs: window by window to the store, resumed where they were cut off."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray

from vibroimpact_schema.requests import TimeHistoryRequest
from vibroimpact_service.documents import digest, requests
from vibroimpact_service.jobs.work import Chunk, ChunkMissingError
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.results import encode, hdf5
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import chunks as job_chunks
from vibroimpact_service.use_case import computation
from vibroimpact_solvers import time_history
from vibroimpact_solvers.time_history import planning

KIND = KINDS["time-history"]
REQUEST, RESULT = "1" * 64, "2" * 64


@pytest.fixture
def content() -> dict[str, Any]:
    """Return a request with contacts that last, whose result is larger than one window's."""
    return {
        "system": {
            "preset": "chain",
            "n": 3,
            "constraints": [
                {"dof": 0, "gap": {"upper": 0.05}, "restitution": 0.0},
                {"dof": 2, "gap": 0.3, "restitution": 0.7},
            ],
        },
        "initial": {"x": [0, 0, 0], "v": [0.2, 0.5, 0]},
        "t_end": 150.0,
        "t": {"num": 2001},
        "load": [{"dof": 0, "amplitude": 0.6, "frequency": 0.3}],
        "outputs": ["x", "v", "impacts", "contacts", "energy"],
    }


@pytest.fixture
def small_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planning, "BYTES", 1e4)


@pytest.fixture
def one_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let all results be created at the same time, which is one of their attributes."""
    moment = datetime(2026, 1, 1, tzinfo=UTC)
    monkeypatch.setattr(computation, "datetime", SimpleNamespace(now=lambda _: moment))


def keep(store: Store, content: dict[str, Any]) -> TimeHistoryRequest:
    request = TimeHistoryRequest.model_validate(content)
    job_chunks.KNOWN.clear()
    store.requests.put(REQUEST, requests.stored_form("ann", digest.canonical(request)))
    return request


def cut(store: Store) -> list[Chunk]:
    return list(job_chunks.split(store.url, KIND.name, REQUEST, RESULT))


def solve(store: Store, indices: Any) -> None:
    job_chunks.solve(store.url, KIND.name, REQUEST, RESULT, indices)


def joined(store: Store, chunks: list[Chunk]) -> bytes:
    job_chunks.join(store.url, KIND.name, REQUEST, RESULT, chunks)
    data = store.results.get(RESULT)
    assert data is not None
    return data


@pytest.mark.needs("compiled kernels")
@pytest.mark.usefixtures("small_windows", "one_moment")
def test_a_result_in_files_is_the_one_in_memory(store: Store, content: dict[str, Any]) -> None:
    request = keep(store, content)
    chunks = cut(store)
    assert len(chunks) > 8
    assert all(chunk.chained and not chunk.lasting for chunk in chunks)
    solve(store, range(len(chunks)))
    data = joined(store, chunks)
    planned = job_chunks._cut(store.url, KIND.name, REQUEST, job_chunks.CHUNK_SECONDS).planned
    whole = time_history.solve(planned.problem, planned.plan)
    head = computation.head(planned, RESULT, digest.canonical(request))
    assert data == encode.pack(encode.describe(whole, head))
    with xarray.open_dataset(
        io.BytesIO(hdf5.to_hdf5(encode.unpack(data))), engine="h5netcdf"
    ) as file:
        assert file.x.dims == ("t", "dof")
        np.testing.assert_array_equal(file.x.values, whole.x)
    with xarray.open_dataset(
        io.BytesIO(hdf5.to_hdf5(encode.unpack(data))), engine="h5netcdf", group="contacts"
    ) as file:
        np.testing.assert_array_equal(file.impulse.values, whole.contact_impulse)
        assert np.isfinite(file.stop.values).all()
        assert file.stop.size > 5
    assert not [path for path in Path(store.url, "results").iterdir() if path.name[0] == "."]


@pytest.mark.needs("compiled kernels")
@pytest.mark.usefixtures("small_windows", "one_moment")
def test_a_resumed_motion_has_the_numbers_of_one_in_one_go(
    store: Store, content: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep(store, content)
    chunks = cut(store)
    solve(store, range(len(chunks)))
    once = joined(store, chunks)
    other = Store(str(tmp_path / "other"))
    keep(other, content)
    solve(other, [0, 1, 2])
    job_chunks.KNOWN.clear()  # another process goes on
    computed: list[int] = []
    follow = time_history.follow

    def counted(window: time_history.Window, *args: Any) -> time_history.Part:
        computed.append(window.index)
        return follow(window, *args)

    monkeypatch.setattr(time_history, "follow", counted)
    solve(other, [5])  # those between are computed on the way
    assert computed == [3, 4, 5]
    other.chunks.remove(chunks[2].name)
    solve(other, range(len(chunks)))
    assert computed == [3, 4, 5, 2, *range(6, len(chunks))]
    assert joined(other, chunks) == once


@pytest.mark.needs("compiled kernels")
@pytest.mark.usefixtures("small_windows")
def test_a_lost_window_is_computed_again(store: Store, content: dict[str, Any]) -> None:
    keep(store, content)
    chunks = cut(store)
    solve(store, range(len(chunks)))
    store.chunks.remove(chunks[3].name)
    with pytest.raises(ChunkMissingError):
        joined(store, chunks)
    solve(store, [3])
    assert joined(store, chunks)


def test_a_short_motion_is_one_chunk(store: Store, content: dict[str, Any]) -> None:
    keep(store, content)
    (chunk,) = cut(store)
    assert not chunk.chained


MEASURE = """
import json, resource, sys
from vibroimpact_service.use_case import chunks as job_chunks
from vibroimpact_service.use_case import computation
from vibroimpact_service.documents import digest, requests
from vibroimpact_service.store import Store
from vibroimpact_schema.requests import TimeHistoryRequest
url, bodies = sys.argv[1], json.loads(sys.argv[2])
peaks, sizes = [], []
for place, body in enumerate(bodies):
    store = Store(url)
    name, result = str(place) * 64, str(place + 5) * 64
    request = TimeHistoryRequest.model_validate(body)
    store.requests.put(name, requests.stored_form("ann", digest.canonical(request)))
    chunks = job_chunks.split(url, "time-history", name, result)
    assert len(chunks) > 1
    job_chunks.solve(url, "time-history", name, result, range(len(chunks)))
    job_chunks.join(url, "time-history", name, result, chunks)
    peaks.append(1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    sizes.append(store.results.size(result))
print(json.dumps([peaks, sizes, len(chunks)]))
"""


@pytest.mark.timeout(280)
def test_memory_does_not_grow_with_the_length_of_the_motion(store: Store) -> None:
    """Ten times the length makes ten times the file, in the memory of the first run.

    The peak of a process never falls, so that the second of two runs adds what it needs more.
    """
    rng = np.random.default_rng(1)
    body = {
        "system": {"preset": "chain", "n": 20, "constraints": [{"dof": 5, "gap": 0.2}]},
        "initial": {
            "x": rng.uniform(-0.1, 0.1, 20).tolist(), "v": rng.standard_normal(20).tolist(),
        },
        "outputs": ["x", "v", "impacts", "energy"],
    }  # fmt: skip
    bodies = [
        {**body, "t_end": length, "t": {"num": int(length * 30) + 1}} for length in (1e3, 1e4)
    ]
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, store.url, json.dumps(bodies)],
        capture_output=True, text=True, check=False, timeout=1000,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    peaks, sizes, windows = json.loads(done.stdout)
    assert windows > 20
    assert sizes[1] > 9.5 * sizes[0]
    assert sizes[1] - sizes[0] > 80e6
    # The times themselves, 8 bytes each, are in memory; what is told of them is not.
    assert peaks[1] - peaks[0] < 0.2 * (sizes[1] - sizes[0])
