"""Sweeps over HTTP and through the client, as jobs on real workers."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

import vibroimpact as vi

BASE = vi.impact_modes_request(
    vi.chain(13, [vi.constraint(5, 0.2)]), (0.6, 2.4, 120), outputs=["impulse", "exists"]
)
GAPS = "system.constraints.0.gap"
STIFFNESS = "system.stiffness"


@pytest.fixture(scope="module")
def service(start: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> Any:
    return start(tmp_path_factory.mktemp("sweeps"))


@pytest.fixture(scope="module")
def client(service: Any) -> Iterator[vi.Client]:
    with vi.Client(service.url) as opened:
        yield opened


def axes(first: float, last: float) -> dict[str, Any]:
    return {
        GAPS: {"start": 0.1, "stop": 0.3, "step": 0.05},
        STIFFNESS: {"start": first, "stop": last, "step": 0.05},
    }


def test_a_job_gives_what_single_requests_give(client: vi.Client) -> None:
    job = client.submit("sweep", vi.sweep_request("impact-modes", BASE, axes(0.5, 1.0)))
    result = job.wait(120, progress=True).result()
    assert result.kind == "sweep"
    assert result.impulse.shape == (5, 11, 120, 1)
    assert set(np.unique(result.status)) == {"ok"}
    structure = vi.chain(13, [vi.constraint(5, 0.15)], stiffness=0.7)
    alone = client.impact_modes(structure, (0.6, 2.4, 120), outputs=["impulse", "exists"])
    at = result.to_xarray().sel(gap=0.15, stiffness=0.7)
    np.testing.assert_array_equal(at.impulse.values, alone.impulse)
    np.testing.assert_array_equal(at.exists.values == 1, alone.exists)


def test_a_shifted_sweep_uses_what_is_there(client: vi.Client) -> None:
    first = client.submit("sweep", vi.sweep_request("impact-modes", BASE, axes(1.0, 2.0)))
    whole = first.wait(120).result().to_xarray()
    second = client.submit("sweep", vi.sweep_request("impact-modes", BASE, axes(1.5, 2.5)))
    shifted = second.wait(120).result().to_xarray()
    common = {"stiffness": [1.5, 1.75, 2.0]}
    np.testing.assert_array_equal(
        whole.sel(common).impulse.values, shifted.sel(common).impulse.values
    )
    assert second.refresh().document["progress"]["done"] > 0


def test_the_client_draws_maps(client: vi.Client, tmp_path: Path) -> None:
    result = client.sweep("impact-modes", BASE, axes(0.5, 1.0), progress=True)
    ax = result.plot(at={"gap": 0.2})
    assert ax.get_ylabel() == "stiffness"
    ax.figure.savefig(tmp_path / "map.png")


def test_impacts_of_one_history_are_cut_out(client: vi.Client) -> None:
    def structure(gap: float) -> dict[str, Any]:
        return vi.oscillator([vi.constraint(0, gap, 0.8)], Omega0=1.0, zeta=0.02)

    initial = ([0.0], [2.0])
    base = vi.time_history_request(structure(1.0), initial, 20.0, outputs=["impacts"])
    gaps = [0.25, 0.5, 5.0]
    result = client.sweep("time-history", base, {GAPS: gaps, "t_end": [10.0, 20.0]})
    assert result.impact_count.shape == (3, 2)
    for gap in gaps:
        alone = client.time_history(structure(gap), initial, 20.0, outputs=["impacts"])
        rows = result.rows("impacts", gap=gap, t_end=20.0)
        np.testing.assert_array_equal(rows.time, alone.impacts.time)
        np.testing.assert_array_equal(rows.velocity, alone.impacts.velocity)
    with pytest.raises(ValueError, match="every axis: gap, t_end"):
        result.rows("impacts", gap=0.5)


def test_a_continued_job_goes_up_and_down_as_a_loop_of_requests(client: vi.Client) -> None:
    def structure(restitution: float) -> dict[str, Any]:
        return vi.oscillator([vi.constraint(0, 0.5, restitution)], Omega0=1.0, zeta=0.05)

    def load(amplitude: float, phase: float) -> list[Any]:
        return [vi.harmonic(0, amplitude, 1.3, phase)]

    t_end, more = 15.0, {"t": [15.0], "outputs": ["x", "v", "impacts"]}
    base = vi.time_history_request(
        structure(0.8), ([0.0], [0.0]), t_end, load=load(0.1, 0.0), **more
    )
    up = [0.1, 0.3, 0.5]
    amplitudes = [*up, *reversed(up[:-1])]
    axes = {"load.0.amplitude": amplitudes, "system.constraints.0.restitution": [0.6, 0.8]}
    request = vi.sweep_request("time-history", base, axes, continued=True)
    result = client.submit("sweep", request).wait(120).result()
    assert set(np.unique(result.status)) == {"ok"}
    for j, restitution in enumerate((0.6, 0.8)):
        state: Any = ([0.0], [0.0])
        phase = 0.0
        for i, amplitude in enumerate(amplitudes):
            loads = load(amplitude, phase)
            alone = client.time_history(structure(restitution), state, t_end, load=loads, **more)
            np.testing.assert_array_equal(result.x[i, j], alone.x)
            assert result.impact_count[i, j] == alone.count.impacts
            state, phase = (
                (alone.x[-1], alone.v[-1]),
                math.remainder(phase + 1.3 * t_end, 2 * math.pi),
            )
    # The same amplitude on the way up and down: not the same motion.
    assert (result.x[0] != result.x[4]).all()
    refused = vi.sweep_request("impact-modes", BASE, {GAPS: [0.1, 0.2]}, continued=True)
    with pytest.raises(vi.ServerError, match="only sweeps of attractors and time-history"):
        client.compute("sweep", refused)


def test_both_encodings_over_http_are_the_same(service: Any) -> None:
    request = vi.sweep_request("impact-modes", BASE, {GAPS: [0.1, 0.2]})
    answer = service.http.post("/v1/compute/sweep", json=request)
    assert answer.status_code == 200
    accept = {"Accept": "application/x-hdf5"}
    file = service.http.post("/v1/compute/sweep", json=request, headers=accept)
    with xarray.open_dataset(io.BytesIO(file.content), engine="h5netcdf") as data:
        assert np.array(answer.json()["impulse"]).tobytes() == data.impulse.values.tobytes()
        assert data.impulse.dims == ("gap", "Omega", "constraint")


@pytest.mark.parametrize(
    ("axis", "status", "pointer"),
    [
        ({"path": "system.constraints.0.gaps", "values": [1]}, 422, "/axes/0/path"),
        ({"path": GAPS, "values": [0.1, -1]}, 422, "/axes/0/values/1"),
        ({"path": GAPS, "start": 1, "stop": 2, "num": 10**7}, 413, "/axes"),
        ({"path": GAPS, "start": 2, "stop": 1, "step": 0.5}, 422, "/axes/0/step"),
        ({"path": GAPS}, 422, "/axes/0/start"),
    ],
)
def test_wrong_axes_are_pointed_at(
    service: Any, axis: dict[str, Any], status: int, pointer: str
) -> None:
    request = {"kind": "impact-modes", "base": BASE, "axes": [axis]}
    answer = service.http.post("/v1/compute/sweep", json=request)
    assert answer.status_code == status
    assert answer.json()["errors"][0]["pointer"] == pointer


def test_a_kind_that_there_is_not(service: Any) -> None:
    request = {"kind": "sweep", "base": BASE, "axes": [{"path": GAPS, "values": [1]}]}
    answer = service.http.post("/v1/plan/sweep", json=request)
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["pointer"] == "/kind"
