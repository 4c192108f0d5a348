"""Paths of derivatives: what they stand for, and which are refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from vibroimpact_service.documents import decode, digest, requests
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_solvers import impact_modes
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.matrices import SymmetricMatrix

STOPS = [
    {"direction": {"dofs": [0, 2], "weights": [1.0, -0.5]}, "gap": {"lower": 0.2, "upper": 0.3}}
]
FORMS: dict[str, Any] = {
    "dense": ([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]], "0.1", [(0, 1), (1, 0)]),
    "bands": ({"bands": {"0": [2.0] * 3, "1": [-1.0] * 2}}, "bands.1.1", [(1, 2), (2, 1)]),
    "diagonal": ({"diagonal": [2.0, 3.0, 4.0]}, "diagonal.1", [(1, 1)]),
    "scalar": ({"scalar": 2.0, "n": 3}, "scalar", [(0, 0), (1, 1), (2, 2)]),
    "coordinates": (
        {"shape": [3, 3], "row": [0, 1, 2, 0, 1], "col": [0, 1, 2, 1, 0], "data": [2.0] * 5},
        "data.3",
        [(0, 1), (1, 0)],
    ),
}  # fmt: skip


def problem(derivatives: Any, **system: Any) -> impact_modes.Problem:
    structure = {"M": {"scalar": 1.0, "n": 3}, "K": FORMS["dense"][0], "constraints": STOPS}
    content = {
        "system": structure | system,
        "frequency": {"values": [2.0, 3.0], "unit": "Hz"},
        "derivatives": derivatives,
    }
    kind = KINDS["impact-modes"]
    document = requests.read("me", kind, content).document
    made: impact_modes.Problem = decode.problem(kind, document, decode.system(document.system))
    return made


@pytest.mark.parametrize("form", FORMS)
def test_numbers_of_matrices(form: str) -> None:
    matrix, path, entries = FORMS[form]
    (parameter,) = problem([f"system.K.{path}"], K=matrix).parameters
    expected = np.zeros((3, 3))
    expected[tuple(zip(*entries, strict=True))] = 1.0
    assert isinstance(parameter.K.entries, SymmetricMatrix)
    assert np.array_equal(parameter.K.entries.to_dense(), expected)
    assert parameter.unit == "mass time-2"


def test_stops_loads_and_frequencies() -> None:
    of = problem(
        [
            "system.constraints.0.gap.lower",
            "system.constraints.0.direction.weights.1",
            "system.force.2",
            "frequency",
            "frequency.values.1",
            "system.M.scale",
            "system.constraints.0.restitution",
        ],
        force=[0.0, 0.0, 0.1],
    )
    lower, weight, force, frequency, one, mass, restitution = of.parameters
    assert lower.walls((0,))[0].tolist() == [1.0]
    assert weight.directions(3, (0,)).tolist() == [[0.0, 0.0, 1.0]]
    assert force.force is not None
    assert force.force.tolist() == [0.0, 0.0, 1.0]
    assert frequency.frequency == 1.0
    assert np.array_equal(one.frequency, [0.0, 2.0 * np.pi])
    assert mass.M.factor == 1.0
    assert restitution.stops[0].restitution == 1.0
    result = impact_modes.solve(of, impact_modes.plan(of))
    assert result.derivative_impulse is not None
    assert (result.derivative_impulse[..., 6] == 0.0).all()
    assert result.parameter_unit is not None
    assert result.parameter_unit[:2] == ["length", "1"]


PRESETS: dict[str, dict[str, Any]] = {
    "chain": {"n": 3, "mass": 1.5, "stiffness": 2.5},
    "oscillator": {"Omega0": 1.5, "zeta": 0.1},
    "two_mass": {"Omega0": 1.5, "coupling": 0.5, "zeta": 0.1},
    "double_pendulum": {"mu": 1.5},
    "bouncing_ball": {"g": 9.0},
}


@pytest.mark.parametrize(
    ("preset", "name"), [(p, n) for p, numbers in PRESETS.items() for n in numbers if n != "n"]
)
def test_parameters_of_presets(preset: str, name: str) -> None:
    """Their rates are those of the structure that the preset makes."""

    def structure(step: float) -> Any:
        numbers = dict(PRESETS[preset])
        numbers[name] += step
        return {"preset": preset, "constraints": [{"dof": 0, "gap": 0.3}], **numbers}

    kind = KINDS["natural-frequencies"]
    content = {"system": structure(0.0), "derivatives": [f"system.{name}"]}
    document = requests.read("me", kind, content).document
    system = decode.system(document.system)
    (parameter,) = decode.problem(kind, document, system).parameters
    ends = []
    for step in (-1e-5, 1e-5):
        changed = requests.read("me", kind, {"system": structure(step)}).document
        ends.append(decode.system(changed.system))
    for matrix in ("M", "K", "C"):
        if getattr(system, matrix) is None:
            continue
        below, above = (getattr(end, matrix).to_dense() for end in ends)
        rate = getattr(parameter, matrix).whole(getattr(system, matrix)).to_dense()
        assert rate == pytest.approx((above - below) / 2e-5, rel=1e-8, abs=1e-9)
    if parameter.force is not None:
        rate = (ends[1].force - ends[0].force) / 2e-5
        assert parameter.force == pytest.approx(rate, rel=1e-9)


@pytest.mark.parametrize(
    ("path", "code"),
    [
        ("system.K.9.9", "unknown_path"),
        ("system.constraints.0", "not_a_number"),
        ("system.constraints.0.gap", "not_a_number"),
        ("frequency.unit", "not_a_number"),
        ("system.constraints.0.direction.dofs.0", "no_derivative"),
        ("system.C.scale", "unknown_path"),
        ("tau", "not_a_number"),
        ("system.M.n", "shapes_differ"),
    ],
)
def test_wrong_paths(path: str, code: str) -> None:
    with pytest.raises(ModelError) as caught:
        problem(["frequency", path])
    assert caught.value.code == code
    assert caught.value.pointer == ("derivatives", 1)


@pytest.mark.parametrize("derivatives", [[], "frequency", [1.0], ["a..b"], [None], {}, [""]])
def test_wrong_lists(derivatives: Any) -> None:
    with pytest.raises(ProblemError) as caught:
        problem(derivatives)
    assert caught.value.errors[0].pointer.startswith("/derivatives")


def test_kinds_and_sweeps_without_derivatives_say_so() -> None:
    system = {"preset": "oscillator", "Omega0": 1.0, "constraints": [{"dof": 0, "gap": 1.0}]}
    content: dict[str, Any] = {"system": system, "derivatives": ["frequency"]}
    with pytest.raises(ProblemError, match="this kind has no derivatives"):
        requests.read("me", KINDS["resonances"], content)
    base = content | {"frequency": {"values": [2.0]}}
    axis = {"path": "system.Omega0", "values": [1.0, 2.0]}
    sweep = {"kind": "impact-modes", "base": base, "axes": [axis]}
    with pytest.raises(ProblemError, match="sweeps have no derivatives"):
        requests.read("me", KINDS["sweep"], sweep)


def test_requests_without_derivatives_have_the_canonical_form_that_they_had() -> None:
    content = {
        "system": {"preset": "oscillator", "Omega0": 1.0, "constraints": [{"dof": 0, "gap": 1.0}]},
        "frequency": {"values": [2.0]},
    }
    read = requests.read("me", KINDS["impact-modes"], content)
    assert b"derivatives" not in read.canonical
    assert digest.canonical(read.document) == read.canonical
    named = requests.read("me", KINDS["impact-modes"], content | {"derivatives": ["frequency"]})
    assert named.digest != read.digest
