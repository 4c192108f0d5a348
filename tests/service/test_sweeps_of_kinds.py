"""Every kind that can be swept gives at each point what it gives alone, whole and in pieces."""

from __future__ import annotations

import copy
import io
import json
from typing import Any, NamedTuple

import numpy as np
import pytest
import xarray

from vibroimpact_schema.sweeps import SweepRequest
from vibroimpact_service.documents import digest, planning
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.results import encode, hdf5
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import chunks as job_chunks
from vibroimpact_service.use_case import computation
from vibroimpact_solvers import sweep
from vibroimpact_solvers.arrays import declared

CHAIN = {"preset": "chain", "n": 7, "constraints": [{"dof": 2, "gap": 0.2}]}
TIMED = {"seconds", "seconds_exact"}  # how long it took differs from time to time


class Case(NamedTuple):
    kind: str
    base: dict[str, Any]
    axes: dict[str, list[float]]


CASES = [
    Case(
        "natural-frequencies",
        {
            "system": CHAIN,
            "count": 3,
            "outputs": ["Omega", "shape", "participation", "residual_flexibility"],
        },
        {"system.stiffness": [1.0, 1.4], "system.constraints.0.gap": [0.1, 0.2]},
    ),
    Case(
        "impact-modes",
        {
            "system": CHAIN,
            "frequency": {"start": 1.0, "stop": 3.0, "num": 9},
            "outputs": ["impulse", "exists", "reason", "stability"],
        },
        {"system.constraints.0.restitution": [1.0, 0.7], "system.stiffness": [1.0, 1.4]},
    ),
    Case(
        "existence-bands",
        {
            "system": CHAIN,
            "frequency": {"start": 0.8, "stop": 3.0},
            "outputs": ["bands", "rejected"],
        },
        {
            "system.stiffness": [1.0, 1.5],
            "system.constraints.0.restitution": [1.0, 0.5],
            "frequency.start": [0.8, 1.5],
        },
    ),
    Case(
        "resonances",
        {"system": CHAIN},
        {"system.constraints.0.gap": [0.1, 0.2], "odd_max": [3, 9], "system.mass": [1.0, 2.0]},
    ),
    Case(
        "periodic-motions",
        {
            "system": {
                "preset": "oscillator",
                "Omega0": 1.0,
                "zeta": 0.05,
                "constraints": [
                    {"dof": 0, "gap": {"lower": None, "upper": 0.5}, "restitution": 0.8}
                ],
            },
            "load": [{"dof": 0, "amplitude": 0.4}],
            "frequency": {"values": [0.8, 1.2]},
        },
        {
            "system.constraints.0.gap.upper": [0.3, 0.5, 50.0],
            "load.0.amplitude": [0.4, 0.8],
        },
    ),
    Case(
        "attractors",
        {
            "system": {
                "preset": "oscillator",
                "Omega0": 1.0,
                "zeta": 0.05,
                "constraints": [
                    {"dof": 0, "gap": {"lower": None, "upper": 0.0}, "restitution": 0.8}
                ],
            },
            "load": [{"dof": 0, "amplitude": 1.0}],
            "frequency": {"values": [2.0]},
            "initial": {"x": [[-1.0], [0.0]], "v": [[0.0], [-1.0]]},
            "settle": 50,
            "observe": 50,
        },
        {
            "frequency.values.0": [2.0, 2.7, 2.8],
            "system.constraints.0.gap.upper": [0.0, 5.0],
        },
    ),
    Case(
        "time-history",
        {
            "system": {
                "preset": "oscillator",
                "Omega0": 1.0,
                "zeta": 0.02,
                "constraints": [{"dof": 0, "gap": 1.0, "restitution": 0.8}],
            },
            "initial": {"x": [0.0], "v": [2.0]},
            "t_end": 20.0,
            "t": {"num": 5},
            "outputs": ["x", "v", "impacts", "energy"],
        },
        {
            "system.constraints.0.gap": [0.5, 5.0],
            "system.constraints.0.restitution": [0.7, 0.9],
            "t_end": [10.0, 20.0],
        },
    ),
    Case(
        "slow-flow",
        {
            "system": {
                "preset": "oscillator",
                "Omega0": 1.0,
                "constraints": [{"dof": 0, "gap": 1.0, "restitution": 0.9}],
            },
            "model": "restitution",
            "variant": "exact",
            "initial": {"omega": 5.0},
            "t": {"start": 0.0, "stop": 5.0, "num": 6},
        },
        {"initial.omega": [4.0, 5.0], "system.constraints.0.restitution": [0.8, 0.9]},
    ),
]


def document(case: Case) -> dict[str, Any]:
    axes = [
        {"path": path, "name": f"axis_{i}", "values": values}
        for i, (path, values) in enumerate(case.axes.items())
    ]
    return {"kind": case.kind, "base": case.base, "axes": axes}


def solved(store: Store, case: Case) -> tuple[sweep.Problem, sweep.Result]:
    request = SweepRequest.model_validate(document(case))
    _, problem, plan, _ = planning.plan(store, KINDS["sweep"], request)
    return problem, sweep.solve(problem, plan)


def single(store: Store, case: Case, values: dict[str, float]) -> Any:
    """Return the result of the request that a point stands for, written out."""
    content = copy.deepcopy(case.base)
    for path, value in values.items():
        *parents, last = [int(p) if p.isdigit() else p for p in path.split(".")]
        here = content
        for part in parents:
            here = here[part]
        here[last] = value
    kind = KINDS[case.kind]
    _, problem, plan, _ = planning.plan(store, kind, kind.request.model_validate(content))
    return kind.solver.solve(problem, plan)


def test_all_kinds_are_here() -> None:
    assert [case.kind for case in CASES] == list(sweep.KINDS)
    assert set(sweep.KINDS) == set(KINDS) - {
        "sweep",
        "ensemble",
        "branches",
        "calibration",
    }  # an axis each of their own


@pytest.mark.parametrize("case", CASES, ids=[case.kind for case in CASES])
class TestEveryKind:
    @pytest.mark.needs("compiled kernels")
    def test_points_are_what_they_are_alone(self, store: Store, case: Case) -> None:
        problem, result = solved(store, case)
        compared = 0
        for index in np.ndindex(problem.shape):
            values = {path: case.axes[path][k] for path, k in zip(case.axes, index, strict=True)}
            alone = single(store, case, values)
            for name, field in declared(KINDS[case.kind].solver.Result).items():
                expected = getattr(alone, name)
                if expected is None or name in TIMED or field.scalar in (str, list[str]):
                    continue
                found = self.at(problem, result, name, index, field.quantity.dims)
                assert found.tobytes() == np.asarray(expected).tobytes(), name
                compared += 1
        assert compared >= 3 * np.prod(problem.shape)

    def at(
        self,
        problem: sweep.Problem,
        result: sweep.Result,
        name: str,
        index: tuple[int, ...],
        dims: tuple[str, ...],
    ) -> Any:
        array = result.arrays[name]
        if dims[:1] and dims[0] in problem.swept_kind.ragged:
            start = int(result.arrays[f"{dims[0]}_offset"][index])
            return array[start : start + int(result.arrays[f"{dims[0]}_count"][index])]
        axes = [axis.name for axis in problem.axes]
        grid = [dim for dim in result.meanings[name].dims if dim in axes]
        return array[tuple(index[axes.index(dim)] for dim in grid)]

    @pytest.mark.needs("compiled kernels")
    def test_pieces_give_the_whole(
        self, store: Store, case: Case, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(job_chunks, "CHUNK_SECONDS", 1e-9)
        data = digest.canonical(SweepRequest.model_validate(document(case)))
        name = digest.content(data)
        store.requests.put(name, data)
        chunks = job_chunks.split(store.url, "sweep", name, "ab" * 32)
        assert len(chunks) > 1
        job_chunks.solve(store.url, "sweep", name, "ab" * 32, range(len(chunks)))
        job_chunks.join(store.url, "sweep", name, "ab" * 32, chunks)
        joined = encode.unpack(store.results.get("ab" * 32) or b"").arrays
        _, whole = solved(store, case)
        assert list(joined) == list(whole.arrays)
        for key, values in whole.arrays.items():
            assert key in TIMED or joined[key].tobytes() == values.tobytes(), key

    @pytest.mark.needs("compiled kernels")
    def test_both_encodings_open(self, store: Store, case: Case) -> None:
        request = SweepRequest.model_validate(document(case))
        planned = planning.plan(store, KINDS["sweep"], request)
        computation.put(
            store, computation.compute(planned, "cd" * 32, digest.canonical(request)), durable=False
        )
        content = encode.unpack(store.results.get("cd" * 32) or b"")
        assert KINDS["sweep"].result.model_validate_json(encode.to_json(content))
        found = json.loads(encode.to_json(content))
        with xarray.open_dataset(io.BytesIO(hdf5.to_hdf5(content)), engine="h5netcdf") as data:
            assert set(data["status"].dims) == set(found["axes"])
            np.testing.assert_array_equal(data["status"].values, 0)


def test_impacts_of_all_histories_are_one_table(store: Store) -> None:
    case = next(case for case in CASES if case.kind == "time-history")
    request = SweepRequest.model_validate(document(case))
    planned = planning.plan(store, KINDS["sweep"], request)
    computation.put(
        store, computation.compute(planned, "cd" * 32, digest.canonical(request)), durable=False
    )
    content = encode.unpack(store.results.get("cd" * 32) or b"")
    found = json.loads(encode.to_json(content))
    counts = np.array(found["impact_count"])
    assert counts.shape == (2, 2, 2)
    assert (counts[1] == 0).all()  # the wide gap is never reached
    assert (counts[0] > 0).all()
    assert len(found["impacts"]["time"]) == len(found["impacts"]["side"]) == counts.sum()
    assert found["dimensions"]["impact_time"] == ["impact"]
    assert found["dimensions"]["t"] == ["axis_2", "time"]
    file = hdf5.to_hdf5(content)
    with xarray.open_dataset(io.BytesIO(file), engine="h5netcdf") as data:
        assert data["impact_count"].attrs["sample_dimension"] == "impact"
        np.testing.assert_array_equal(data["impact_count"].values, counts)
    with xarray.open_dataset(io.BytesIO(file), engine="h5netcdf", group="impacts") as table:
        assert table.sizes["impact"] == counts.sum()
