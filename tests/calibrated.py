"""Synthetic rigs with noise: how often 95 % intervals contain what the rig was made with.

``python -m tests.calibrated 300 [seed]`` counts them, and how often a wrong model is rejected.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from vibroimpact_service.documents import planning, requests
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.store import Store
from vibroimpact_solvers.results import calibration

Document = dict[str, Any]


class Rig(NamedTuple):
    """A calibration, and the values with which its measurements were made."""

    request: Document
    truth: Mapping[str, float]


def solved(store: Store, kind: str, content: Document) -> Any:
    """Return the solver's result of a request."""
    request = requests.read("tests", KINDS[kind], content)
    planned = planning.plan(store, request.kind, request.document)
    return planned.kind.solver.solve(planned.problem, planned.plan)


def _between(walls: int, gap: float, restitution: float, ratio: float) -> Document:
    """Return a mass at a stop, or between two of which the second one is nearer."""
    limits = {"lower": 0.9 * gap if walls == 2 else None, "upper": gap}
    stop = {"dof": 0, "gap": limits, "restitution": restitution}
    damping = {"ratio": ratio}
    return {"M": [[1.0]], "K": [[1.0]], "damping": damping, "constraints": [stop]}


def bouncing(
    store: Store, random: np.random.Generator, *, stops: int = 1, accelerations: bool = False
) -> Rig:
    """Return a driven mass at a stop, or between two: gap, restitution and damping."""
    gap, restitution = random.uniform(0.3, 0.6), random.uniform(0.5, 0.9)
    ratio = random.uniform(0.02, 0.06)

    def base(walls: int) -> Document:
        # A second stop is where the first one alone is never reached without the other noticing.
        return {
            "system": _between(walls, gap, restitution, ratio),
            "initial": {"x": [0.0], "v": [1.2]},
            "t_end": 15.0,
            "load": [{"dof": 0, "amplitude": 0.4, "frequency": 1.3}],
        }  # fmt: skip

    t = np.linspace(0.5, 15.0, 150 if accelerations else 30)
    outputs = ["impacts", "a" if accelerations else "x"]
    motion = solved(store, "time-history", {**base(stops), "outputs": outputs, "t": t.tolist()})
    truth = {
        "system.constraints.0.gap.upper": gap,
        "system.constraints.0.restitution": restitution,
        "system.damping.ratio": ratio,
    }
    data = [
        _noisy(random, "impacts.time", np.sort(motion.impact_time), 2e-3),
        {**_noisy(random, outputs[1], getattr(motion, outputs[1]), 5e-3), "t": t.tolist()},
    ]
    if accelerations:
        # Near impacts an accelerometer shows the blows, which the model does not have.
        near = np.abs(t[:, np.newaxis] - motion.impact_time).min(axis=1, initial=np.inf) < 0.02
        data[1]["values"] = [
            [None] if off else row for row, off in zip(data[1]["values"], near, strict=True)
        ]
    return Rig(_request("time-history", base(1), truth, data, random), truth)


def accelerometer(store: Store, random: np.random.Generator, *, stops: int = 1) -> Rig:
    """Return the driven mass whose accelerations were measured between its impacts."""
    return bouncing(store, random, stops=stops, accelerations=True)


def chain(store: Store, random: np.random.Generator) -> Rig:
    """Return a chain of 2 to 5 masses that is let go: gap, restitution and a spring."""
    n = int(random.integers(2, 6))
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[0, 0] = random.uniform(1.8, 2.5)
    gap, restitution = random.uniform(0.1, 0.3), random.uniform(0.6, 0.95)
    v = np.zeros(n)
    v[-1] = 1.0
    stop = {"dof": n - 1, "gap": gap, "restitution": restitution}
    base = {
        "system": {
            "M": {"scalar": 1.0, "n": n}, "K": K.tolist(), "C": (0.05 * K).tolist(),
            "constraints": [stop],
        },
        "initial": {"x": [0.0] * n, "v": v.tolist()},
        "t_end": 8.0,
        "dofs": [0],
    }  # fmt: skip
    t = np.linspace(0.4, 8.0, 20)
    motion = solved(store, "time-history", {**base, "outputs": ["impacts", "x"], "t": t.tolist()})
    truth = {
        "system.constraints.0.gap": gap,
        "system.constraints.0.restitution": restitution,
        "system.K.0.0": float(K[0, 0]),
    }
    data = [
        _noisy(random, "impacts.time", motion.impact_time, 1e-3),
        {**_noisy(random, "x", motion.x, 2e-3), "t": t.tolist()},
    ]
    return Rig(_request("time-history", base, truth, data, random), truth)


def structure(store: Store, random: np.random.Generator) -> Rig:
    """Return a structure whose frequencies were measured: two springs."""
    K = [[random.uniform(2.0, 4.0), -1.0, 0.0], [-1.0, 3.0, -1.0], [0.0, -1.0, 0.0]]
    K[2][2] = random.uniform(2.0, 4.0)
    base = {"system": {"M": {"diagonal": [1.0, 2.0, 1.5]}, "K": K, "constraints": []}, "count": 3}
    Omega = solved(store, "natural-frequencies", base).Omega
    truth = {"system.K.0.0": K[0][0], "system.K.2.2": K[2][2]}
    data = [_noisy(random, "Omega", Omega, 2e-3)]
    return Rig(_request("natural-frequencies", base, truth, data, random), truth)


def impact_mode(store: Store, random: np.random.Generator) -> Rig:
    """Return a structure whose impact modes were measured: gap and factor of the stiffness."""
    gap, factor = random.uniform(0.1, 0.3), random.uniform(0.9, 1.1)
    K = np.array([[3.0, -1.0], [-1.0, 2.0]])

    def base(stiffness: Any) -> Document:
        stop = {"dof": 0, "gap": gap}
        system = {"M": {"diagonal": [1.0, 2.0]}, "K": stiffness.tolist(), "constraints": [stop]}
        return {"system": system, "frequency": {"start": 2.1, "stop": 2.6, "num": 6}}

    momentum = solved(store, "impact-modes", {**base(factor * K), "outputs": ["impulse"]}).momentum
    truth = {"system.constraints.0.gap": gap, "system.K.scale": factor}
    data = [_noisy(random, "momentum", momentum, 2e-3)]
    return Rig(_request("impact-modes", base(K), truth, data, random), truth)


def sweep(store: Store, random: np.random.Generator, *, stops: int = 1) -> Rig:
    """Return a driven mass whose amplitudes were measured while the frequency of its drive rose.

    Where two motions are stable the record has the larger one, where no motion with at most one
    impact in a period is, nothing.
    """
    gap, restitution = random.uniform(0.6, 0.9), random.uniform(0.5, 0.7)
    ratio = random.uniform(0.04, 0.06)

    def base(walls: int) -> Document:
        # The second stop is in the way of the larger motions alone.
        return {
            "system": _between(walls, gap, restitution, ratio),
            "load": [{"dof": 0, "amplitude": 0.2}],
            "frequency": {"values": np.linspace(0.7, 1.3, 16).tolist()},
            **({"sequence": [{"constraint": 0, "side": "lower"}]} if walls == 2 else {}),
        }  # fmt: skip

    outputs = ["extremes", "exists", "stability"]
    motions = solved(store, "periodic-motions", {**base(stops), "outputs": outputs})
    stable = motions.solution_exists & (motions.solution_stability < 1.0)
    rows = []
    for k in range(16):
        places = np.flatnonzero(stable & (motions.solution_frequency_index == k))
        rows.append(motions.solution_x_min[places].min(axis=0, initial=np.inf))
    data = [_noisy(random, "solution.x_min", np.stack(rows), 3e-3)]
    data[0]["values"] = [[x if np.isfinite(x) else None for x in row] for row in data[0]["values"]]
    truth = {
        "system.constraints.0.gap.upper": gap,
        "system.constraints.0.restitution": restitution,
        "system.damping.ratio": ratio,
    }
    return Rig(_request("periodic-motions", base(1), truth, data, random), truth)


RIGS = (structure, impact_mode, bouncing, accelerometer, chain, sweep)


def _noisy(random: np.random.Generator, output: str, exact: Any, sigma: float) -> Document:
    """Return measurements with normal noise."""
    values = exact + sigma * random.standard_normal(exact.shape)
    return {"output": output, "values": values.tolist(), "sigma": sigma}


def _request(
    kind: str,
    base: Document,
    truth: Mapping[str, float],
    data: list[Document],
    random: np.random.Generator,
) -> Document:
    """Return the calibration, which starts up to a tenth off."""
    unknowns = [
        {
            "path": path,
            "start": value * random.uniform(0.9, 1.1),
            "lower": 0.2 * value,
            "upper": 1.0 if path.endswith("restitution") else 3.0 * value,
        }
        for path, value in truth.items()
    ]
    for unknown in unknowns:
        unknown["start"] = min(unknown["start"], unknown["upper"])
    return {"kind": kind, "base": base, "unknowns": unknowns, "data": data, "starts": 3}


def contained(result: calibration.Result, rig: Rig) -> Iterator[bool]:
    """Yield whether the interval of each unknown contains the true value."""
    assert result.interval is not None
    for (low, high), value in zip(result.interval, rig.truth.values(), strict=True):
        yield bool(low <= value <= high)


def main(count: int, seed: int) -> None:
    """Print how many intervals contain the truth, and how many wrong models are rejected."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        store = Store(folder)
        for make in RIGS:
            inside: list[bool] = []
            fits = 0
            for k in range(count):
                random = np.random.default_rng([seed, k])
                rig = make(store, random)
                result = solved(store, "calibration", rig.request)
                inside += contained(result, rig)
                fits += bool(result.model_fits)
            share = 100.0 * np.mean(inside)
            print(f"{make.__name__}: {len(inside)} intervals, {share:.1f} % contain the truth; "
                  f"{fits} of {count} models fit", flush=True)  # fmt: skip
        for wrong in (bouncing, accelerometer, sweep):
            rejected = 0
            for k in range(count):
                rig = wrong(store, np.random.default_rng([seed + 1, k]), stops=2)
                request = {**rig.request, "outputs": ["model_fits"]}
                rejected += solved(store, "calibration", request).model_fits is False
            print(f"{wrong.__name__}: two stops, one assumed: {rejected} of {count} rejected",
                  flush=True)  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
