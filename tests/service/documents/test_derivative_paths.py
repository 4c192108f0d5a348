"""Paths of derivatives: what they stand for, and which are refused."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from vibroimpact_service.documents import decode, digest, requests
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.problems import ProblemError
from vibroimpact_solvers import impact_modes, time_history
from vibroimpact_solvers.derivatives import LoadRate
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


def motion(derivatives: list[str], load: Any = None, **system: Any) -> time_history.Problem:
    structure = {"M": [[1.0, 0.0], [0.0, 2.0]], "K": [[2.0, -1.0], [-1.0, 2.0]]}
    content = {
        "system": structure | {"constraints": [{"dof": 0, "gap": 1.0}]} | system,
        "initial": {"x": [0.1, 0.0], "v": [0.0, 0.5]},
        "t_end": 1.0,
        "load": load or [],
        "derivatives": derivatives,
    }
    kind = KINDS["time-history"]
    document = requests.read("me", kind, content).document
    made: time_history.Problem = decode.problem(kind, document, decode.system(document.system))
    return made


def test_initial_states_and_loads() -> None:
    load = [{"dof": 1, "amplitude": 2.0, "frequency": 3.0, "phase": 0.5}]
    paths = ["initial.x.1", "initial.v.0", *(f"load.0.{n}" for n in ("amplitude", "phase"))]
    x, v, amplitude, phase, frequency = motion([*paths, "load.0.frequency"], load).parameters
    assert x.x is not None
    assert x.x.tolist() == [0.0, 1.0]
    assert v.v is not None
    assert v.v.tolist() == [1.0, 0.0]
    c, s = np.cos(0.5), np.sin(0.5)
    assert amplitude.loads == (LoadRate(1, 3.0, c, s),)
    assert phase.loads == (LoadRate(1, 3.0, -2.0 * s, 2.0 * c),)
    assert frequency.loads == (LoadRate(1, 3.0, 0.0, 0.0, -2.0 * s, 2.0 * c),)
    assert [p.unit for p in (amplitude, phase)] == ["mass length time-2", "1"]


@pytest.mark.parametrize("base", ["acceleration", "velocity", "displacement"])
def test_vibrations_of_a_base(base: str) -> None:
    """The load ``-M r a`` goes with a power of the frequency; rates are those of its cosine."""

    def made(amplitude: float, frequency: float, phase: float) -> time_history.Problem:
        load = [{"base": base, "amplitude": amplitude, "frequency": frequency, "phase": phase}]
        names = [f"load.0.{name}" for name in ("amplitude", "frequency", "phase")]
        return motion(names, load, influence=[1.0, 1.0])

    def force(numbers: Any, t: float) -> Any:
        total = np.zeros(2)
        for term in made(*numbers).load:
            assert isinstance(term, time_history.Harmonic)
            total[term.dof] += term.amplitude * np.cos(term.frequency * t + term.phase)
        return total

    start, t = np.array([0.7, 1.3, 0.4]), 2.1
    for k, parameter in enumerate(made(*start).parameters):
        step = 1e-6 * np.eye(3)[k]
        expected = (force(start + step, t) - force(start - step, t)) / 2e-6
        rate = np.zeros(2)
        for load in parameter.loads:
            cosine = load.steady_cosine + t * load.cosine
            sine = load.steady_sine + t * load.sine
            w = load.frequency * t
            rate[load.dof] += cosine * np.cos(w) - sine * np.sin(w)
        assert rate == pytest.approx(expected, rel=1e-7, abs=1e-9)


LAWS: dict[str, tuple[dict[str, Any], list[str]]] = {
    "ratio": ({"ratio": 0.05}, ["ratio"]),
    "ratios": ({"ratio": [0.05, 0.1]}, ["ratio.0", "ratio.1"]),
    "rayleigh": ({"rayleigh": [0.1, 0.02]}, ["rayleigh.0", "rayleigh.1"]),
    "through": (
        {"rayleigh": {"ratios": [0.05, 0.06], "at": [1.0, 2.0]}},
        ["rayleigh.ratios.0", "rayleigh.ratios.1"],
    ),
    "structural": ({"structural": 0.05, "at": 1.5}, ["structural"]),
}


@pytest.mark.parametrize("law", LAWS)
def test_laws_of_damping(law: str) -> None:
    """Their numbers change C, and so do the matrices of which the law makes it."""
    document, paths = LAWS[law]
    paths = [f"system.damping.{path}" for path in paths]
    factors = ["system.M.scale", "system.K.scale"]
    entries = [] if law.startswith("ratio") else ["system.K.0.1", "system.M.1.1"]
    base = {"damping": document}
    of = motion([*paths, *factors, *entries], **base)
    for parameter in of.parameters:
        ends = [_changed(parameter.path, step, base) for step in (-1e-5, 1e-5)]
        rate = parameter.C.whole(of.system.C).to_dense()  # type: ignore[arg-type]
        expected = (ends[1] - ends[0]) / 2e-5
        assert rate == pytest.approx(expected, rel=1e-8, abs=1e-9), parameter.path


def _changed(path: str, step: float, base: dict[str, Any]) -> Any:
    """Return C with another number at a path."""
    structure: dict[str, Any] = {"M": [[1.0, 0.0], [0.0, 2.0]], "K": [[2.0, -1.0], [-1.0, 2.0]]}
    structure = copy.deepcopy(structure | base)
    _, *outer, last = path.split(".")
    if last == "scale":
        structure[outer[0]] = ((1.0 + step) * np.array(structure[outer[0]])).tolist()
    else:
        here: Any = structure
        for part in outer:
            here = here[int(part)] if isinstance(here, list) else here[part]
        here[int(last) if isinstance(here, list) else last] += step
        if outer[0] == "K":
            structure["K"][1][0] += step
    return motion(["initial.x.0"], **structure).system.C.to_dense()  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("path", "more", "message"),
    [
        ("system.K.0.0", {"damping": {"ratio": 0.1}}, "modes that change with it"),
        ("system.C.scale", {"damping": {"ratio": 0.1}}, "a law or dashpots"),
        ("system.damping.at", {"damping": {"structural": 0.1, "at": 1.0}}, "it is no number of"),
        ("t_end", {}, "it is no number of"),
        (
            "system.M.scale",
            {
                "influence": [1.0, 1.0],
                "load": [{"base": "velocity", "amplitude": 1, "frequency": 2}],
            },
            "the load of the base",
        ),
    ],
)
def test_numbers_without_derivatives_of_motions(
    path: str, more: dict[str, Any], message: str
) -> None:
    with pytest.raises(ModelError, match=message) as caught:
        motion(["initial.x.0", path], **more)
    assert caught.value.pointer == ("derivatives", 1)
    assert caught.value.code == "no_derivative"


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
