"""Calibrations find what rigs were made with, say what data does not tell, refuse what is wrong."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
import scipy.stats
from starlette.testclient import TestClient

from tests import calibrated
from vibroimpact_service.documents import planning, requests
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.store import Store
from vibroimpact_solvers.calibration.model import Evaluation, Model

pytestmark = pytest.mark.needs("compiled kernels")
Document = dict[str, Any]
DIFFERENTIATED = [rig for rig in calibrated.RIGS if rig is not calibrated.sweep]


def solved(store: Store, request: Document) -> Any:
    return calibrated.solved(store, "calibration", request)


@pytest.mark.parametrize("make", calibrated.RIGS, ids=lambda make: make.__name__)
def test_the_truth_lies_where_the_covariance_says(store: Store, make: Any) -> None:
    rig = make(store, np.random.default_rng([5, 1]))
    result = solved(store, rig.request)
    off = result.value - np.array(list(rig.truth.values()))
    # Of as many normal numbers as unknowns: once in 10,000 seeds it lies beyond.
    beyond = float(off @ np.linalg.solve(result.covariance, off))
    assert beyond < scipy.stats.chi2.isf(1e-4, off.size)
    assert result.p > 1e-4
    assert result.converged
    assert (result.interval[:, 0] < result.value).all()
    assert (result.value < result.interval[:, 1]).all()


@pytest.mark.parametrize("make", DIFFERENTIATED, ids=lambda make: make.__name__)
def test_the_jacobian_is_that_of_differences(store: Store, make: Any) -> None:
    request = make(store, np.random.default_rng([6, 2])).request
    model = Model(_problem(store, request), differences=False)
    x = model.problem.start

    def residuals(point: Any) -> Any:
        outcome = model.evaluate(point, rates=False)
        assert isinstance(outcome, Evaluation)
        return outcome.residuals

    exact = model.evaluate(x, rates=True)
    assert isinstance(exact, Evaluation)
    assert exact.jacobian is not None
    for place in range(x.size):
        h = 1e-5 * x[place] * np.eye(x.size)[place]
        difference = (residuals(x + h) - residuals(x - h)) / (2.0 * h[place])
        scale = np.abs(difference).max()
        assert np.abs(exact.jacobian[:, place] - difference).max() < 1e-6 * scale


def _problem(store: Store, request: Document) -> Any:
    read = requests.read("tests", KINDS["calibration"], request)
    return planning.plan(store, read.kind, read.document).problem


STRUCTURE = {"M": [[1.0, 0.0], [0.0, 2.0]], "K": [[3.0, -1.0], [-1.0, 2.0]], "constraints": []}
FREQUENCIES: Document = {
    "kind": "natural-frequencies",
    "base": {"system": STRUCTURE, "count": 2},
    "unknowns": [{"path": "system.K.scale", "start": 1.1, "lower": 0.5, "upper": 2.0}],
    "data": [{"output": "Omega", "values": [0.9, 1.8], "sigma": 0.01}],
}


def test_one_factor_is_what_its_formula_gives(store: Store) -> None:
    """Frequencies go with the root of the factor: the least squares are those of one number."""
    result = solved(store, FREQUENCIES)
    M, K = np.diag([1.0, 2.0]), np.array(STRUCTURE["K"])
    omega = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real)
    omega.sort()
    measured = np.array([0.9, 1.8])
    root = float(omega @ measured / (omega @ omega))
    assert result.value[0] == pytest.approx(root**2, rel=1e-12)
    deviation = 2.0 * root * 0.01 / np.linalg.norm(omega)
    assert result.covariance[0, 0] == pytest.approx(deviation**2, rel=1e-12)
    chi2 = float((((root * omega - measured) / 0.01) ** 2).sum())
    assert result.chi2 == pytest.approx(chi2, rel=1e-11)
    assert abs(result.chi2 - chi2) <= result.error_chi2 + 1e-12 * chi2
    # The profile of one unknown is chi2 itself, a parabola in the root of the factor.
    half = np.sqrt(scipy.stats.chi2.ppf(0.95, 1)) * 0.01 / np.linalg.norm(omega)
    exact = np.array([root - half, root + half]) ** 2
    assert (np.abs(result.interval[0] - exact) <= result.error_interval[0] + 1e-12).all()
    assert result.interval[0] == pytest.approx(exact, rel=1e-6)


def test_frequencies_do_not_tell_masses_from_stiffnesses(store: Store) -> None:
    unknowns = [*FREQUENCIES["unknowns"], {"path": "system.M.scale", "start": 1.0}]
    result = solved(store, {**FREQUENCIES, "unknowns": unknowns})
    (text,) = result.undetermined
    assert "system.K.scale" in text
    assert "system.M.scale" in text
    assert result.direction_vector[0] == pytest.approx([np.sqrt(0.5)] * 2, rel=0.05)
    assert np.isinf(result.direction_deviation[0])
    assert np.isnan(result.covariance).all()
    assert result.degrees_of_freedom == 1


def test_a_prior_tells_what_the_data_does_not(store: Store) -> None:
    prior = {"mean": 1.0, "sigma": 0.02}
    unknowns = [*FREQUENCIES["unknowns"], {"path": "system.M.scale", "start": 1.0, "prior": prior}]
    result = solved(store, {**FREQUENCIES, "unknowns": unknowns})
    assert result.undetermined == []
    assert result.value[1] == pytest.approx(1.0, rel=1e-9)
    assert result.covariance[1, 1] == pytest.approx(0.02**2, rel=1e-9)


def test_gap_and_amplitude_grow_together(store: Store) -> None:
    """Times of impacts stay the same where the gap, the load and the start grow alike."""
    stop = {"dof": 0, "gap": {"lower": None, "upper": 0.4}, "restitution": 0.8}
    base = {
        "system": {"M": [[1.0]], "K": [[1.0]], "C": [[0.1]], "constraints": [stop]},
        "initial": {"x": [0.0], "v": [0.0]},
        "t_end": 20.0,
        "load": [{"dof": 0, "amplitude": 0.5, "frequency": 1.3}],
    }
    times = calibrated.solved(store, "time-history", base).impact_time
    assert times.size > 3
    request = {
        "kind": "time-history",
        "base": base,
        "unknowns": [
            {"path": "system.constraints.0.gap.upper", "start": 0.4, "lower": 0.2, "upper": 0.8},
            {"path": "load.0.amplitude", "start": 0.5, "lower": 0.2, "upper": 1.0},
        ],
        "data": [{"output": "impacts.time", "values": times.tolist(), "sigma": 1e-3}],
        "outputs": ["undetermined"],
        "starts": 1,
    }
    result = solved(store, request)
    (text,) = result.undetermined
    assert "gap" in text
    assert "amplitude" in text
    assert result.interval is None
    assert result.residual is None


@pytest.mark.parametrize("make", [calibrated.bouncing, calibrated.accelerometer, calibrated.sweep])
def test_a_wrong_model_is_rejected(store: Store, make: Any) -> None:
    """The rig has two stops, the model one."""
    rig = make(store, np.random.default_rng(7), stops=2)
    result = solved(store, {**rig.request, "outputs": ["chi2", "model_fits"]})
    assert result.model_fits is False
    assert result.p < 1e-6


def test_amplitudes_are_those_of_the_nearest_stable_motion(store: Store) -> None:
    """Where two motions are stable, the larger one tells the gap, the smaller one does not."""
    stop = {"dof": 0, "gap": {"lower": None, "upper": 0.8}, "restitution": 0.6}
    base = {
        "system": {"M": [[1.0]], "K": [[1.0]], "damping": {"ratio": 0.05}, "constraints": [stop]},
        "load": [{"dof": 0, "amplitude": 0.2}],
        "frequency": {"values": [1.2, 1.6]},
    }
    outputs = ["extremes", "exists", "stability"]
    motions = calibrated.solved(store, "periodic-motions", {**base, "outputs": outputs})
    both = motions.solution_exists & (motions.solution_stability < 1.0)
    at_first = np.flatnonzero(both & (motions.solution_frequency_index == 0))
    small, large = sorted(motions.solution_x_min[at_first, 0], reverse=True)
    path = "system.constraints.0.gap.upper"
    request = {
        "kind": "periodic-motions",
        "base": base,
        "unknowns": [{"path": path, "start": 0.78, "lower": 0.7, "upper": 0.9}],
        "starts": 1,
        "outputs": ["undetermined", "residual"],
    }
    data = {"output": "solution.x_min", "values": [[large], [None]], "sigma": 1e-3}
    fit = solved(store, {**request, "data": [data]})
    assert fit.value[0] == pytest.approx(0.8, abs=1e-6)
    assert fit.undetermined == []
    fit = solved(store, {**request, "data": [{**data, "values": [[small], [None]]}]})
    assert [path in text for text in fit.undetermined] == [True]
    assert np.abs(fit.residual).max() < 1e-9


def test_a_record_of_motions_that_the_model_does_not_have_is_said(store: Store) -> None:
    rig = calibrated.sweep(store, np.random.default_rng([5, 1]))
    values = [[-0.5 if x is None else x] for (x,) in rig.request["data"][0]["values"]]
    assert len(values) > sum(x is not None for (x,) in rig.request["data"][0]["values"])
    data = [{**rig.request["data"][0], "values": values}]
    few = {"data": data, "starts": 1, "outputs": ["model_fits"]}
    result = solved(store, {**rig.request, **few})
    assert result.model_fits is False
    assert any("stable, admissible motion" in text for text in result.cautions)


def test_accelerations_tell_what_is_relative_to_the_mass(store: Store) -> None:
    """Load, spring and mass grow alike: an accelerometer alone does not tell their size."""
    base = {
        "system": {"M": [[1.0]], "K": [[1.0]], "damping": {"ratio": 0.05}, "constraints": []},
        "initial": {"x": [0.0], "v": [0.0]},
        "t_end": 20.0,
        "load": [{"dof": 0, "amplitude": 0.5, "frequency": 1.3}],
    }
    t = np.linspace(0.1, 20.0, 200).tolist()
    exact = calibrated.solved(store, "time-history", {**base, "outputs": ["a"], "t": t}).a
    request = {
        "kind": "time-history",
        "base": base,
        "unknowns": [
            {"path": "system.M.scale", "start": 1.1, "lower": 0.5, "upper": 2.0},
            {"path": "system.K.scale", "start": 0.9, "lower": 0.5, "upper": 2.0},
            {"path": "load.0.amplitude", "start": 0.6, "lower": 0.2, "upper": 1.0},
        ],
        "data": [{"output": "a", "values": exact.tolist(), "sigma": 0.01, "t": t}],
        "outputs": ["undetermined"],
        "starts": 1,
    }
    result = solved(store, request)
    (text,) = result.undetermined
    assert all(name in text for name in ("system.M.scale", "system.K.scale", "amplitude"))


def test_stops_of_finite_stiffness_are_fitted_by_differences(store: Store) -> None:
    def base(stiffness: float) -> Document:
        law = {"type": "linear", "stiffness": stiffness, "damping": 0.3}
        stop = {"dof": 0, "gap": {"lower": None, "upper": 0.3}, "law": law}
        return {
            "system": {"M": [[1.0]], "K": [[1.0]], "constraints": [stop]},
            "initial": {"x": [0.0], "v": [1.0]},
            "t_end": 6.0,
        }

    t = np.linspace(0.2, 6.0, 25)
    exact = calibrated.solved(
        store, "time-history", {**base(12.0), "outputs": ["x"], "t": t.tolist()}
    ).x
    noise = np.random.default_rng(1).standard_normal(exact.shape)
    request = {
        "kind": "time-history",
        "base": base(10.0),
        "unknowns": [
            {"path": "system.constraints.0.law.stiffness", "start": 10.0, "lower": 5.0},
            {"path": "system.constraints.0.gap.upper", "start": 0.32},
        ],
        "data": [
            {"output": "x", "values": (exact + 1e-3 * noise).tolist(), "sigma": 1e-3,
             "t": t.tolist()},
        ],
        "starts": 1,
    }  # fmt: skip
    read = requests.read("tests", KINDS["calibration"], request)
    planned = planning.plan(store, read.kind, read.document)
    assert any("central differences" in step.method for step in planned.plan.steps)
    result = planned.kind.solver.solve(planned.problem, planned.plan)
    off = (result.value - [12.0, 0.3]) / np.sqrt(np.diag(result.covariance))
    assert np.abs(off).max() < 4.0
    assert result.model_fits
    assert result.count_differences > 0


def test_an_unknown_at_its_bound(store: Store) -> None:
    unknown = {"path": "system.K.scale", "start": 1.5, "lower": 1.45, "upper": 2.0}
    result = solved(store, {**FREQUENCIES, "unknowns": [unknown]})
    assert result.value[0] == 1.45
    assert np.isnan(result.covariance).all()
    assert result.interval[0, 0] == 1.45
    assert result.cautions


def test_the_same_request_has_the_same_answer(store: Store) -> None:
    request = calibrated.structure(store, np.random.default_rng(2)).request
    one, two = solved(store, request), solved(store, copy.deepcopy(request))
    assert one.value.tobytes() == two.value.tobytes()
    assert one.start_initial.tobytes() == two.start_initial.tobytes()


def put(path: str, value: Any) -> Document:
    """Return the example with another value at a path."""
    request: Any = copy.deepcopy(FREQUENCIES)
    here: Any = request
    *outer, last = path.split("/")
    for part in outer:
        here = here[int(part)] if part.isdigit() else here[part]
    if isinstance(here, list):
        here[int(last)] = value
    else:
        here[last] = value
    return request


@pytest.mark.parametrize(
    ("path", "value", "pointer"),
    [
        ("unknowns/0/path", "system.K.9.9", "/unknowns/0/path"),
        ("unknowns/0/path", "system.C.scale", "/unknowns/0/path"),
        ("unknowns/0/path", "count", "/unknowns/0/path"),
        ("unknowns/0/lower", 2.0, "/unknowns/0/upper"),
        ("unknowns/0/start", 3.0, "/unknowns/0/start"),
        ("unknowns/0/prior", {"mean": 1.0, "sigma": 0.0}, "/unknowns/0/prior/sigma"),
        ("data/0/sigma", 0.0, "/data/0/sigma"),
        ("data/0/sigma", -1.0, "/data/0/sigma"),
        ("data/0/sigma", [0.1], "/data/0/sigma"),
        ("data/0/values", [0.9, 1.8, 2.0], "/data/0/values"),
        ("data/0/values", [[0.9], [1.8]], "/data/0/values"),
        ("data/0/values", [None, None], "/data/0/values"),
        ("data/0/values", [[0.9], [1.8, 2.0]], "/data/0/values"),
        ("data/0/output", "x", "/data/0/output"),
        ("data/0/t", [0.0, 1.0], "/data/0/t"),
        ("kind", "attractors", "/kind"),
        ("base/derivatives", ["system.K.scale"], "/base"),
        ("base/stop", 3.0, "/base"),
        ("base/system", {"preset": "chain", "n": 2, "mass": 1, "stiffness": 1, "constraints": []},
         "/unknowns/0/path"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_refused_by_its_place(
    http: TestClient, path: str, value: Any, pointer: str
) -> None:
    answer = http.post("/v1/compute/calibration", json=put(path, value))
    assert answer.status_code == 422, answer.text
    pointers = [error["pointer"] for error in answer.json()["errors"]]
    assert any(each.startswith(pointer) for each in pointers), answer.text


def test_over_http_in_every_encoding(http: TestClient) -> None:
    answer = http.post("/v1/compute/calibration", json=FREQUENCIES)
    assert answer.status_code == 200, answer.text
    document = answer.json()
    KINDS["calibration"].result.model_validate_json(answer.content)
    assert sum(r**2 for r in document["residual"]) == pytest.approx(document["chi2"], rel=1e-12)
    for media_type in ("application/x-hdf5", "text/csv"):
        headers = {"Accept": media_type}
        other = http.post("/v1/compute/calibration", json=FREQUENCIES, headers=headers)
        assert other.status_code == 200, other.text
    plan = http.post("/v1/plan/calibration", json=FREQUENCIES).json()
    assert [step["stage"] for step in plan["steps"]][-2:] == ["fit", "profile"]
