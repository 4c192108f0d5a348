"""Every number that is computed has an absolute error that broadcasts to it, ``error.<output>``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

import numpy as np
import pytest
from starlette.testclient import TestClient

from vibroimpact_schema import examples
from vibroimpact_service.app import create_app
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.settings import Settings
from vibroimpact_solvers.arrays import Field, declared

EXACT = {
    "frequency/Omega": "of the request",
    "frequency/omega": "of the request, in another unit",
    "tau": "of the request",
    "t": "of the request",
    "Omega": "of the request",
    "solution/Omega": "of the request",
    "solution/parameter": "the value at which the motion is computed",
    "points/Omega": "of the request, or the parameter, which has an error",
    "witness": "any time that shows that a limit is passed",
    "solution/witness": "any time that shows that a limit is passed",
    "rejected/witness": "any time that shows that a limit is passed",
    "unresolved/start": "ends of a range about which nothing is stated",
    "unresolved/stop": "ends of a range about which nothing is stated",
    "attractor/fraction_low": "end of an interval that states how well the fraction is known",
    "attractor/fraction_high": "end of an interval that states how well the fraction is known",
    "bands/edge_error": "an error",
    "rejected/edge_error": "an error",
    "derivative/distance": "to first order, where a derivative begins to exist",
    "points/error": "an error",
    "impacts/condition": "an error, of the state",
    "measurements/measured": "of the request",
    "measurements/sigma": "of the request",
    "starts/initial": "chosen",
    "starts/value": "where a search ended; that of the best fit has an error",
    "starts/chi2": "where a search ended; that of the best fit has an error",
}
"""Numbers without an error, and why; `resonances` computes its ``Omega``."""
COMPUTED = {("resonances", "Omega")}


STATED = tuple(name for name in KINDS if name != "sweep")


def measured() -> Iterator[tuple[str, Field]]:
    """Yield what is measured: indices, counts, codes and words are not."""
    for name in STATED:
        for field in declared(KINDS[name].solver.Result).values():
            exact = field.path in EXACT and (name, field.path) not in COMPUTED
            if field.scalar is float and not exact and not field.path.startswith("error/"):
                yield name, field


@pytest.mark.parametrize(
    ("kind", "field"), [pytest.param(k, f, id=f"{k}-{f.path}") for k, f in measured()]
)
def test_every_output_declares_its_error(kind: str, field: Field) -> None:
    fields = {one.path: one for one in declared(KINDS[kind].solver.Result).values()}
    assert field.quantity.error == f"error/{field.path}"
    error = fields[field.quantity.error]
    assert error.scalar is float
    assert error.quantity.unit == field.quantity.unit


def test_what_needs_no_error_is_there() -> None:
    paths = {
        f.path
        for k in KINDS.values()
        if k.name != "sweep"
        for f in declared(k.solver.Result).values()
    }
    assert set(EXACT) <= paths


def requests(kind: str) -> Iterator[dict[str, Any]]:
    """Yield the examples of a kind, with all outputs."""
    for example in examples.requests(kind).values():
        request = {**example["request"]}
        if kind == "branches":
            yield {**request, "base": whole("periodic-motions", request["base"])}
        elif kind == "attractors":
            yield from ({**whole(kind, request), "section": of} for of in ("phase", "impacts"))
        elif kind == "calibration":
            yield request
        elif kind == "sweep":
            base = whole(request["kind"], request["base"])
            yield {**request, "base": base, "outputs": base["outputs"]}
        else:
            yield whole(kind, request)
    yield from MORE.get(kind, ())


def whole(kind: str, request: dict[str, Any]) -> dict[str, Any]:
    """Return a request of everything that its kind computes."""
    annotation: Any = KINDS[kind].request.model_fields["outputs"].annotation
    outputs = list(get_args(get_args(annotation)[0]))
    if "limiter" in request:
        outputs = [name for name in outputs if name not in {"impacts", "contacts", "a"}]
    if "a" in outputs and (request.get("digits") or request.get("method", "exact") != "exact"):
        outputs.remove("a")
    if kind == "natural-frequencies" and "directions" not in request:
        outputs.remove("effective_mass")
    stops = request.get("system", {}).get("constraints", ())
    if "force" in outputs and all("law" not in stop for stop in stops):
        outputs.remove("force")  # of rigid stops there are impulses alone
    timed = {"tau": [0.0, 0.25, 0.5]} if kind in {"impact-modes", "periodic-motions"} else {}
    return {**timed, **request, "outputs": outputs}


LOSSY = {"preset": "oscillator", "Omega0": 1, "constraints": [{"dof": 0, "gap": 1}]}
HISTORY = {"initial": {"x": [0], "v": [5]}, "t_end": 4, "t": {"num": 3}}
ALL = ["x", "v", "energy", "impacts", "contacts"]
MORE: dict[str, list[dict[str, Any]]] = {
    "impact-modes": [
        {
            "system": {
                "M": [[4, 1], [1, 1]],
                "K": {"diagonal": [4, 1]},
                "constraints": [{"dof": 0, "gap": {"lower": 0.1, "upper": 0.2}}],
            },
            "frequency": {"values": [0.9, 1.0, 3.0]},
            "tau": [0.0, 0.25],
            "outputs": ["impulse", "shape", "waveform", "energy", "stability", "harmonics"],
            "derivatives": ["system.constraints.0.gap.upper", "system.K.scale", "frequency"],
        }
    ],
    "natural-frequencies": [
        {
            "system": {
                "M": [[4, 1], [1, 1]],
                "K": {"diagonal": [4, 1]},
                "constraints": [{"dof": 0, "gap": 0.1}],
            },
            "count": 1,
            "directions": [[1, 1]],
            "outputs": [
                "Omega", "shape", "participation", "effective_mass", "residual_flexibility",
            ],
            "derivatives": ["system.K.diagonal.0", "system.M.scale"],
        }
    ],
    "time-history": [
        {
            # Beyond its horizon nothing is known of a chaotic motion.
            "system": {
                "preset": "chain", "n": 4,
                "constraints": [{"dof": 1, "gap": 0.2}, {"dof": 3, "gap": 0.2}],
            },
            "initial": {"x": [0.05, -0.02, 0.08, 0.01], "v": [1.2, -0.7, 0.4, 0.9]},
            "t_end": 80, "t": {"num": 9}, "outputs": ALL,
        },
        {"system": LOSSY, **HISTORY, "outputs": [*ALL, "a"], "derivatives": ["system.Omega0"]},
    ],
    "ensemble": [
        {
            "system": {
                "preset": "oscillator", "Omega0": 1,
                "constraints": [
                    {
                        "dof": 0, "gap": 0.5,
                        "law": {"type": "linear", "stiffness": 20, "damping": 0.1},
                    }
                ],
            },
            "initial": {"x": [[0.0], [0.1]], "v": [[1.0], [2.0]]},
            "t_end": 4, "t": {"num": 3}, "outputs": ["x", "v", "a", "energy", "contacts", "force"],
        }
    ],
    "periodic-motions": [
        {
            "system": {
                "preset": "oscillator", "Omega0": 1, "zeta": 0.02,
                "constraints": [
                    {
                        "dof": 0, "gap": {"lower": None, "upper": -1},
                        "law": {"type": "linear", "stiffness": 1, "damping": 1},
                    }
                ],
            },
            "load": [{"dof": 0, "amplitude": 0.5}],
            "frequency": {"values": [1.1, 1.5]},
        }
    ],
    "slow-flow": [
        {
            "system": {
                "preset": "two_mass", "Omega0": 1, "coupling": 0.05, "zeta": 0.01,
                "constraints": [{"dof": 0, "gap": 1}],
            },
            "model": "two_oscillator",
            "variant": variant,
            "initial": {"gamma": 0.2, "phi": 0.0, "A": -0.003, "B": 0.0},
            "t": {"stop": 20, "num": 9},
            "outputs": ["state", "x", "v", "impulse", "error"],
        }
        for variant in ("averaged", "exact", "soft_wall")
    ],
    "attractors": [
        {
            "system": {
                "preset": "oscillator", "Omega0": 1, "zeta": 0.1,
                "constraints": [
                    {
                        "dof": 0, "gap": {"lower": None, "upper": 0.1},
                        "law": {"type": "linear", "stiffness": 10, "damping": 0.1},
                    }
                ],
            },
            "load": [{"dof": 0, "amplitude": 1}], "frequency": [0.8],
            "initial": {"x": [[0]], "v": [[0]]}, "settle": 50, "observe": 100,
            "section": section, "outputs": ["section", "stability"],
        }
        for section in ("phase", "impacts")
    ],
    "sweep": [
        {
            "kind": "time-history",
            "base": {"system": LOSSY, **HISTORY},
            "axes": [{"path": "system.constraints.0.gap", "values": [1.0, 2.0]}],
            "outputs": ALL,
        }
    ],
}  # fmt: skip
"""Requests that show what no example does: unequal walls, motions without errors, tables."""


def at(document: Any, path: str, *, record: bool = False) -> Any:
    """Return what a document has at a path, nan for null; None where there is nothing."""
    table, _, column = path.partition("/")
    if record and isinstance(document.get(table), list):
        return np.array([row[column] for row in document[table]], dtype=np.float64)
    for part in path.split("/"):
        if not isinstance(document, dict) or part not in document:
            return None
        document = document[part]
    return None if document is None and "/" not in path else np.array(document, dtype=np.float64)


@pytest.mark.needs("compiled kernels")
@pytest.mark.parametrize("kind", [*STATED, "sweep"])
def test_errors_are_absolute_and_broadcast(settings: Settings, queue: Any, kind: str) -> None:
    patient = settings.model_copy(update={"inline_seconds": 1e3, "inline_overrun_seconds": 1e3})
    compared: set[str] = set()
    with TestClient(create_app(patient, queue)) as http:
        for request in requests(kind):
            answer = http.post(f"/v1/compute/{kind}", json=request)
            assert answer.status_code == 200, answer.text
            of = request["kind"] if kind == "sweep" else kind
            compared |= check(of, answer.json())
    if kind != "sweep":
        paths = {field.path for name, field in measured() if name == kind}
        if kind == "branches":  # the examples have rigid stops
            paths = {path for path in paths if not path.startswith("contact/")}
        assert compared == paths


def check(kind: str, document: dict[str, Any]) -> set[str]:
    """Compare shapes of outputs and errors; return the outputs that there are."""
    compared = set()
    for name, field in measured():
        value = at(document, field.path, record=field.quantity.record) if name == kind else None
        if value is None:
            continue
        error = at(document, field.quantity.error)
        assert error is not None, field.quantity.error
        assert np.broadcast_shapes(error.shape, value.shape) == value.shape, field.path
        assert not (error < 0.0).any(), field.path
        # What is known has a known error, with a few exceptions that are declared.
        fields = {one.path: one for one in declared(KINDS[kind].solver.Result).values()}
        unknown = fields[field.quantity.error].quantity.missing
        assert unknown or kind == "sweep" or np.isfinite(error).all(), field.path
        compared.add(field.path)
    return compared
