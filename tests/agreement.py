"""What a random set of requests gives: run once with compiled kernels, once with plain Python.

    NUMBA_DISABLE_JIT=1 python -m tests.agreement FILE --seed 7 --count 2

writes the arrays of all results. The requests are those that `vibroimpact warm` compiles all
kernels by, and random ones of each kind; `differences` compares two files.
"""

from __future__ import annotations

import argparse
import pickle
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroimpact_service.documents import planning, requests
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.store import Store
from vibroimpact_service.use_case import warming
from vibroimpact_solvers.arrays import Described, Field, declared

Arrays = dict[str, NDArray[Any]]

ROUNDINGS: Final = 1e-12
"""Relative difference of numbers of which no error is stated, such as bounds of errors."""


def random_requests(seed: int, count: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield random requests of one to four masses: `count` of each kind that has kernels."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        n = int(random.integers(1, 5))
        loads = random.uniform(-0.5, 0.5, (n, n))
        K = np.diag(random.uniform(0.5, 3.0, n)) + loads @ loads.T
        wall = {"dof": int(random.integers(n)), "gap": float(random.uniform(0.1, 0.6))}
        lossy = {**wall, "restitution": float(random.choice([0.0, 0.5, 0.8, 1.0]))}
        free = {"M": {"diagonal": random.uniform(0.5, 2.0, n).tolist()}, "K": K.tolist()}
        damped = {**free, "C": (0.05 * K).tolist(), "constraints": [lossy]}
        elastic = {**free, "constraints": [wall]}
        Omega = np.sort(random.uniform(0.4, 3.0, 5)).tolist()
        load = [{"dof": int(random.integers(n)), "amplitude": float(random.uniform(0.3, 1.5))}]
        state = {"x": (0.05 * random.standard_normal(n)).tolist()}
        state["v"] = random.standard_normal(n).tolist()
        yield (
            "impact-modes",
            {
                "system": elastic,
                "frequency": {"values": Omega},
                "tau": [0.0, 0.3],
                "outputs": ["impulse", "exists", "shape", "waveform", "energy", "stability"],
            },
        )
        yield "existence-bands", {"system": elastic, "frequency": {"start": 1.0, "stop": 1.3}}
        motion = {"system": damped, "load": load, "frequency": {"values": Omega[:2]}}
        yield "periodic-motions", {**motion, "outputs": ["exists", "stability"]}
        history = {"t_end": 12.0, "t": {"num": 7}, "outputs": ["x", "v", "energy", "impacts"]}
        driven = [{**load[0], "frequency": Omega[0]}]
        yield "time-history", {"system": damped, "initial": state, "load": driven, **history}
        soft = {"limiter": {"law": "power", "exponent": 5.0}, "outputs": ["x", "v"]}
        yield "time-history", {"system": elastic, "initial": state, **history, **soft}


def solved(kind: str, content: Mapping[str, Any], store: Store) -> Arrays:
    """Return the arrays of a result by their paths."""
    request = requests.read("agreement", KINDS[kind], content)
    planned = planning.plan(store, request.kind, request.document)
    result = planned.kind.solver.solve(planned.problem, planned.plan)
    if isinstance(result, Described):
        return {name: np.asarray(value) for name, value in result.arrays.items()}
    fields = declared(type(result)).values()
    values = ((field, getattr(result, field.name, None)) for field in fields)
    return {field.path: np.asarray(value) for field, value in values if value is not None}


def differences(kind: str, one: Arrays, other: Arrays) -> Iterator[str]:
    """Yield where two results differ by more than what both state as their errors.

    Numbers of which no error is stated may differ by some roundings. Indices, counts and verdicts
    must be the same.
    """
    if one.keys() != other.keys():
        yield f"{sorted(one.keys() ^ other.keys())} is in one of both"
        return
    errors = {field.path: field.quantity.error for field in _fields(kind)}
    for path in one:
        a, b = one[path], other[path]
        if a.shape != b.shape:
            yield f"{path}: {a.shape} and {b.shape}"
        elif a.dtype.kind != "f":
            if not np.array_equal(a, b):
                yield f"{path} is another one"
        elif not path.startswith("error/") and not path.endswith("error"):
            stated = one.get(errors.get(path, ""), None), other.get(errors.get(path, ""), None)
            known = [np.asarray(each, np.float64) for each in stated if each is not None]
            bound = np.abs(known[0]) + np.abs(known[1]) if known else ROUNDINGS * np.abs(a)
            bound = np.broadcast_to(np.where(np.isnan(bound), np.inf, bound), a.shape)
            with np.errstate(invalid="ignore"):  # of infinite numbers that are equal
                same = (a == b) | (np.isnan(a) & np.isnan(b)) | (np.abs(a - b) <= bound)
            if not same.all():
                worst = np.unravel_index(int(np.argmin(same)), a.shape)
                yield f"{path}: {a[worst]!r} and {b[worst]!r}, stated {bound[worst]!r}"


def _fields(kind: str) -> Iterator[Field]:
    if kind != "sweep":
        yield from declared(KINDS[kind].solver.Result).values()


def main() -> None:
    """Solve all requests and write the arrays."""
    parser = argparse.ArgumentParser(prog="python -m tests.agreement")
    parser.add_argument("file", type=Path)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--count", type=int, default=2)
    parser.add_argument("--all", action="store_true", help="problems that take half a minute, too")
    given = parser.parse_args()
    steps = [step for step in warming.STEPS if given.all or step != "existence-bands"]
    asked = [(warming.STEPS[step], each) for step in steps for each in warming.problems(step)]
    asked += random_requests(given.seed, given.count)
    with tempfile.TemporaryDirectory() as folder:
        store = Store(folder)
        results = [(kind, dict(content), solved(kind, content, store)) for kind, content in asked]
    given.file.write_bytes(pickle.dumps(results))


if __name__ == "__main__":
    main()
