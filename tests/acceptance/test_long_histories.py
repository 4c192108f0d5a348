"""Long time histories of a real service: progress by time, cancelled, resumed, served in parts."""

from __future__ import annotations

import io
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

HDF5 = {"Accept": "application/x-hdf5"}


def long(t_end: float, seed: int = 1, n: int = 40) -> dict[str, Any]:
    """Return a request that is cut into windows."""
    rng = np.random.default_rng(seed)
    return {
        "system": {"preset": "chain", "n": n, "constraints": [{"dof": 5, "gap": 0.2}]},
        "initial": {
            "x": rng.uniform(-0.1, 0.1, n).tolist(), "v": rng.standard_normal(n).tolist(),
        },
        "t_end": t_end,
        "t": {"num": int(5 * t_end) + 1},
        "dofs": [5, 20],
        "outputs": ["x", "impacts", "energy"],
    }  # fmt: skip


def slow(seed: int) -> dict[str, Any]:
    """Return a request that takes some seconds: of many windows, whose results are small."""
    return long(400_000.0, seed, n=400) | {"t": {"num": 1001}}


def submit(service: Any, content: dict[str, Any]) -> dict[str, Any]:
    answer = service.http.post("/v1/jobs", json={"kind": "time-history", "request": content})
    assert answer.status_code == 201, answer.text
    document: dict[str, Any] = answer.json()
    return document


def until(service: Any, job: str, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    end = time.monotonic() + 120
    while time.monotonic() < end:
        document: dict[str, Any] = service.http.get(f"/v1/jobs/{job}?wait=2").json()
        if condition(document) or document["final"]:
            return document
    raise AssertionError(f"the job stays where it is: {document}")


def is_final(document: dict[str, Any]) -> bool:
    return bool(document["final"])


@pytest.mark.timeout(300)
def test_a_long_history_is_a_job_in_windows(service: Any) -> None:
    content = long(100_000.0)
    plan = service.http.post("/v1/plan/time-history", json=content).json()
    motion = next(step for step in plan["steps"] if step["stage"] == "flight")
    assert not plan["inline"]
    assert f"in {motion['count']} windows of time" in motion["reason"]
    assert motion["count"] > 5
    job = submit(service, content)
    seen = until(service, job["id"], lambda job: job["progress"]["done"] > 0)
    assert seen["progress"]["total"] == motion["count"]
    done = until(service, job["id"], is_final)
    assert done["state"] == "succeeded", done
    where = f"/v1/jobs/{job['id']}/result"
    whole = service.http.get(where, headers=HDF5)
    with xarray.open_dataset(io.BytesIO(whole.content), engine="h5netcdf") as data:
        assert data.x.shape == (500_001, 2)
        assert np.isfinite(data.x.values).all()
        np.testing.assert_allclose(data.energy, data.energy[0], rtol=1e-12)
        assert np.abs(data.x.sel(dof=5).values).max() <= 0.2 + 1e-14
    part = service.http.get(
        whole.headers["content-location"], headers={**HDF5, "Range": "bytes=1000-1999"}
    )
    assert part.status_code == 206
    assert part.content == whole.content[1000:2000]


def test_a_long_history_is_cancelled_at_once(service: Any) -> None:
    job = submit(service, slow(seed=2))
    until(service, job["id"], lambda job: job["progress"]["done"] > 0)
    service.http.delete(f"/v1/jobs/{job['id']}")
    cancelled = until(service, job["id"], is_final)
    assert cancelled["state"] == "cancelled"
    assert cancelled["progress"]["done"] < cancelled["progress"]["total"]


@pytest.mark.timeout(300)
def test_a_restart_goes_on_at_the_window_that_was_reached(
    start: Callable[..., Any], tmp_path: Path
) -> None:
    content = slow(seed=3)
    first = start(tmp_path)
    first.wait_ready()
    job = submit(first, content)
    seen = until(first, job["id"], lambda job: job["progress"]["done"] > 2)
    progress = seen["progress"]
    assert 2 < progress["done"] < progress["total"], "the motion is too short for this test"
    assert not seen["final"]
    first.stop()
    second = start(tmp_path)
    second.wait_ready()
    done = until(second, job["id"], is_final)
    assert done["state"] == "succeeded", done
    assert done["attempts"] == 2
    assert done["progress"]["kept"] >= progress["done"]
    second.stop()
