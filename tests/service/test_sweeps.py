"""A sweep equals the loop over single requests, to the last bit, in whatever pieces it is done."""

from __future__ import annotations

import copy
import io
import json
from typing import Any

import numpy as np
import pytest
import xarray
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vibroimpact_schema.plans import Steps
from vibroimpact_schema.requests import ImpactModesRequest
from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_service.documents import decode, digest, planning, requests, sweep_axes
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.results import encode, hdf5
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import chunks as job_chunks
from vibroimpact_service.use_case import computation
from vibroimpact_solvers import impact_modes, sweep

SWEEP = KINDS["sweep"]
OUTPUTS = ["impulse", "exists", "reason", "shape", "waveform", "energy", "harmonics"]


def single(base: dict[str, Any], values: dict[str, float]) -> impact_modes.Result:
    """Return the result of the request that a point stands for, written out."""
    content = copy.deepcopy(base)
    for path, value in values.items():
        *parents, last = [int(p) if p.isdigit() else p for p in path.split(".")]
        here = content
        for part in parents:
            here = here[part]
        here[last] = value
        if path.startswith("system.K."):
            i, j = map(int, path.split(".")[2:])
            content["system"]["K"][j][i] = value
    request = ImpactModesRequest.model_validate(content)
    problem = decode.impact_modes(request, decode.system(request.system))
    return impact_modes.solve(problem, impact_modes.plan(problem))


def swept(content: dict[str, Any]) -> tuple[sweep.Problem, sweep.Result]:
    request = SweepRequest.model_validate(content)
    problem = sweep_axes.problem(request, decode.system(request.system), lambda: None)
    return problem, sweep.solve(problem, sweep.plan(problem))


def some(low: float, high: float, most: int = 3) -> st.SearchStrategy[list[float]]:
    return st.lists(st.floats(low, high), min_size=1, max_size=most)


AXES = st.fixed_dictionaries(
    {},
    optional={
        "system.K.0.1": some(-1.5, 0.5),
        "system.K.1.1": some(1.6, 4.0),
        "system.M.diagonal.2": some(0.5, 2.0, 2),
        "system.force.0": some(0.001, 0.1, 2),
        "system.constraints.0.gap.lower": some(0.1, 0.5),
        "system.constraints.0.gap.upper": some(0.1, 0.5),
        "system.constraints.1.gap": some(0.1, 0.5),
        "system.constraints.1.restitution": some(0.0, 1.0),
        "frequency.values.0": some(0.3, 5.0),
        "frequency.values.2": some(0.3, 5.0),
        "tau.1": some(-1.0, 1.0, 2),
        "tolerance": some(1e-12, 1e-3, 2),
    },
).filter(lambda axes: 0 < len(axes) <= 4)


@given(AXES, st.sets(st.sampled_from(OUTPUTS), min_size=1), st.randoms())
@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow])
def test_a_sweep_equals_the_loop_over_single_requests(
    axes: dict[str, list[float]], outputs: set[str], random: Any
) -> None:
    base = {
        "system": {
            "M": {"diagonal": [1.0, 1.5, 1.0]},
            "K": [[2.0, -1.0, 0.0], [-1.0, 2.5, -1.0], [0.0, -1.0, 3.0]],
            "force": [0.05, 0.0, 0.0] if random.random() < 0.5 else [0.0, 0.0, 0.0],
            "constraints": [
                {"dof": 0, "gap": {"lower": 0.2, "upper": 0.2}},
                {"dof": 2, "gap": 0.3, "restitution": 1.0},
            ],
        },
        "frequency": {"values": [1.0, 2.0, 3.0]},
        "tau": [0.0, 0.5],
        "tolerance": 1e-6,
        "outputs": sorted(outputs),
    }
    order = list(axes)
    random.shuffle(order)
    content = {
        "kind": "impact-modes",
        "base": base,
        "axes": [
            {"path": path, "name": f"axis_{i}", "values": axes[path]}
            for i, path in enumerate(order)
        ],
    }
    problem, result = swept(content)
    for index in np.ndindex(problem.shape):
        values = {path: axes[path][k] for path, k in zip(order, index, strict=True)}
        alone = single(base, values)
        for name, array in result.arrays.items():
            if name.startswith("axis_") or name == "status":
                continue
            expected = getattr(alone, name)
            if name == "impulse_lower" and expected is None:
                expected = alone.impulse
            dims = result.meanings[name].dims
            place = tuple(k for i, k in enumerate(index) if f"axis_{i}" in dims)
            assert array[place].tobytes() == expected.tobytes(), name


CONTENT: dict[str, Any] = {
    "kind": "impact-modes",
    "base": {
        "system": {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]},
        "frequency": {"start": 0.6, "stop": 2.4, "num": 60},
        "outputs": ["impulse", "exists", "reason", "shape"],
    },
    "axes": [
        {"path": "system.constraints.0.restitution", "values": [0.8, 1.0]},
        {"path": "system.constraints.0.gap", "start": 0.1, "stop": 0.4, "step": 0.05},
        {"path": "system.stiffness", "start": 0.5, "stop": 1.0, "step": 0.1},
    ],
}


def stiffnesses(start: float, stop: float) -> dict[str, Any]:
    content = copy.deepcopy(CONTENT)
    content["axes"][2] |= {"start": start, "stop": stop}
    return content


def keep(store: Store, content: dict[str, Any], owner: str) -> str:
    data = requests.stored_form(owner, digest.canonical(SweepRequest.model_validate(content)))
    name = digest.content(data)
    store.requests.put(name, data)
    return name


def run(store: Store, content: dict[str, Any], result: str, owner: str = "ann") -> tuple[int, int]:
    """Do a job; return how many pieces it had and how many of them were there already."""
    arguments = (store.url, "sweep", keep(store, content, owner), result)
    chunks = job_chunks.split(*arguments)
    there = store.chunks.sound([chunk.name for chunk in chunks])
    missing = [i for i, chunk in enumerate(chunks) if chunk.name not in there]
    assert all(chunk.lasting for chunk in chunks)
    job_chunks.solve(*arguments, missing)
    job_chunks.join(*arguments, chunks)
    return len(chunks), len(there)


def arrays(store: Store, result: str) -> dict[str, Any]:
    return dict(encode.unpack(store.results.get(result) or b"").arrays)


class TestJobs:
    @pytest.mark.parametrize("seconds", [1e-4, 1e-2, 0.05])
    def test_in_pieces_equals_in_one_go(
        self, store: Store, monkeypatch: pytest.MonkeyPatch, seconds: float
    ) -> None:
        monkeypatch.setattr(job_chunks, "CHUNK_SECONDS", seconds)
        pieces, _ = run(store, CONTENT, "ab" * 32)
        assert pieces > 1
        request = SweepRequest.model_validate(CONTENT)
        computation.put(
            store,
            computation.compute(planning.plan(store, SWEEP, request), "cd" * 32, b"{}"),
            durable=False,
        )
        joined, once = arrays(store, "ab" * 32), arrays(store, "cd" * 32)
        assert list(joined) == list(once)
        for name, values in once.items():
            assert joined[name].tobytes() == values.tobytes(), name
            assert joined[name].shape == values.shape

    def test_longer_and_shifted_ones_use_the_pieces_that_are_there(
        self, store: Store, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(job_chunks, "CHUNK_SECONDS", 1e-4)
        first, kept = run(store, stiffnesses(0.5, 1.0), "00" * 32)
        assert kept == 0
        assert run(store, stiffnesses(0.5, 1.5), "01" * 32) == (first * 11 // 6, first)
        assert run(store, stiffnesses(0.8, 1.3), "02" * 32) == (first, first)
        whole, shifted = arrays(store, "01" * 32), arrays(store, "02" * 32)
        np.testing.assert_array_equal(shifted["impulse"], whole["impulse"][:, :, 3:9])

    def test_pieces_of_somebody_else_are_not_used(self, store: Store) -> None:
        run(store, CONTENT, "00" * 32)
        _, kept = run(store, CONTENT, "01" * 32, "bob")
        assert kept == 0

    def test_other_outputs_have_other_pieces(self, store: Store) -> None:
        run(store, CONTENT, "00" * 32)
        _, kept = run(store, CONTENT | {"outputs": ["impulse"]}, "01" * 32)
        assert kept == 0


def representation(content: dict[str, Any], store: Store) -> encode.Content:
    request = SweepRequest.model_validate(content)
    planned = planning.plan(store, SWEEP, request)
    computation.put(
        store, computation.compute(planned, "ee" * 32, digest.canonical(request)), durable=False
    )
    return encode.unpack(store.results.get("ee" * 32) or b"")


class TestEncodings:
    def test_json_names_axes_and_dimensions(self, store: Store) -> None:
        found = json.loads(encode.to_json(representation(CONTENT, store)))
        assert list(found["axes"]) == ["restitution", "gap", "stiffness"]
        assert found["axes"]["gap"] == [0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4]
        assert found["of"] == "impact-modes"
        grid = ["restitution", "gap", "stiffness"]
        assert found["dimensions"]["shape"] == [*grid, "frequency", "dof"]
        assert np.array(found["shape"]).shape == (2, 7, 6, 60, 13)
        assert np.array(found["frequency"]["Omega"]).shape == (60,)
        assert set(np.unique(found["status"])) == {"ok"}
        assert SWEEP.result.model_validate_json(json.dumps(found))

    def test_xarray_opens_hdf5_with_named_axes_and_units(self, store: Store) -> None:
        content = copy.deepcopy(CONTENT)
        content["base"]["system"]["units"] = {"length": "m", "mass": "kg", "time": "s"}
        file = io.BytesIO(hdf5.to_hdf5(representation(content, store)))
        with xarray.open_dataset(file, engine="h5netcdf") as data:
            assert data["impulse"].dims == (
                "restitution",
                "gap",
                "stiffness",
                "Omega",
                "constraint",
            )
            assert data["gap"].attrs["units"] == "m"
            assert data["stiffness"].attrs["units"] == "N/m"
            assert data["gap"].attrs["long_name"] == "gap, system.constraints.0.gap"
            assert data.attrs["of"] == "impact-modes"
            at = data["impulse"].sel(restitution=0.8, gap=0.2, stiffness=1.0)
            alone = single(content["base"], {})
            np.testing.assert_array_equal(at.values, alone.impulse)

    def test_frequencies_that_vary_are_coordinates_with_axes(self, store: Store) -> None:
        content = copy.deepcopy(CONTENT)
        content["axes"] = [{"path": "frequency.start", "values": [0.6, 0.8]}]
        file = io.BytesIO(hdf5.to_hdf5(representation(content, store)))
        with xarray.open_dataset(file, engine="h5netcdf") as data:
            assert data["impulse"].dims == ("frequency_start", "frequency_index", "constraint")
            assert data["Omega"].dims == ("frequency_start", "frequency_index")
            assert set(data["impulse"].coords) >= {"Omega", "omega"}
            np.testing.assert_array_equal(data["Omega"][:, 0], [0.6, 0.8])


def test_the_plan_counts_and_says_what_is_not_done(store: Store) -> None:
    plan = planning.plan(store, SWEEP, SweepRequest.model_validate(CONTENT)).plan
    document = Steps(**planning.steps(plan))
    assert {step.stage: step.count for step in document.steps} == {
        "spectrum": 6,
        "response": 6 * 60,
        "impulse": 6 * 7 * 60,
        "existence": 6 * 7 * 60,
        "shape": 6 * 7 * 60,
    }
    skips = {skip.what: skip.why for skip in document.skips}
    sentence = "impact modes are motions without energy loss: one result holds for all 2 values"
    assert skips["computing again along restitution"] == sentence
