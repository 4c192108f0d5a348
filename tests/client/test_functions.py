"""Functions for optimisers, and derivatives of results by their names."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.optimize

import vibroimpact as vi
from vibroimpact.derivatives import place_of

GAP, STIFF = "system.constraints.0.gap", "system.K.0.0"
REQUEST: dict[str, Any] = {
    "system": {
        "M": [[1.0, 0.0], [0.0, 1.0]],
        "K": [[2.0, -1.0], [-1.0, 2.0]],
        "constraints": [{"dof": 0, "gap": 0.3}],
    },
    "frequency": {"values": [2.0, 2.5]},
    "outputs": ["impulse", "energy"],
}


class Counted:
    """Computes in this process, and counts."""

    def __init__(self) -> None:
        self.calls, self._local = 0, vi.Local()

    def __call__(self, kind: Any, request: Any) -> vi.Result:
        self.calls += 1
        return self._local.compute(kind, request)


def test_the_jacobian_is_that_of_the_values() -> None:
    compute = Counted()
    f = vi.function(
        "impact-modes", REQUEST, [STIFF, GAP, "system.K.scale", "system.K.0.1"],
        ["momentum", "energy"], compute=compute,
    )  # fmt: skip
    assert f.start.tolist() == [2.0, 0.3, 1.0, -1.0]
    values, jacobian = f(f.start), f.jacobian(f.start)
    assert values.shape == (4,)
    assert jacobian.shape == (4, 4)
    assert compute.calls == 1
    point = np.array([2.1, 0.25, 1.2, -0.9])
    jacobian = f.jacobian(point)
    for column in range(4):
        step = np.zeros(4)
        step[column] = 1e-6
        difference = (f(point + step) - f(point - step)) / 2e-6
        assert jacobian[:, column] == pytest.approx(difference, rel=1e-7, abs=1e-9)
    assert REQUEST["system"]["K"][0][0] == 2.0  # what was given stays


def test_an_optimiser_finds_gap_and_stiffness() -> None:
    f = vi.function("impact-modes", REQUEST, [GAP, STIFF], ["momentum"])
    measured = f([0.24, 2.3])
    found = scipy.optimize.least_squares(lambda x: f(x) - measured, f.start, jac=f.jacobian)
    assert found.x == pytest.approx([0.24, 2.3], rel=1e-8)


def test_natural_frequencies_as_a_function() -> None:
    chain = vi.chain(4, [], mass=1.0, stiffness=1.0)
    request = {"system": chain, "outputs": ["Omega"]}
    f = vi.function("natural-frequencies", request, ["system.stiffness", "system.mass"], ["Omega"])
    Omega = f(f.start)
    assert f.jacobian(f.start) == pytest.approx(np.outer(Omega, [0.5, -0.5]), rel=1e-13)


MOTION: dict[str, Any] = {
    "system": {
        "M": [[1.0, 0.0], [0.0, 2.0]],
        "K": [[2.0, -1.0], [-1.0, 2.0]],
        "constraints": [{"dof": 0, "gap": 0.3, "restitution": 0.8}],
        "damping": {"ratio": 0.03},
    },
    "initial": {"x": [0.0, 0.0], "v": [1.0, 0.3]},
    "t_end": 6.0,
    "t": {"values": [1.0, 5.5]},
    "load": [{"dof": 1, "amplitude": 0.4, "frequency": 1.7, "phase": 0.2}],
    "outputs": ["x", "v", "energy", "impacts"],
}
INPUTS = [
    GAP, "system.constraints.0.restitution", "system.K.scale", "system.damping.ratio",
    "initial.v.0", "load.0.amplitude", "load.0.frequency", "load.0.phase",
]  # fmt: skip


def test_the_jacobian_of_a_motion_with_impacts() -> None:
    """Of a structure whose damping ratio stays, so that C goes with the root of K."""
    names = ["x", "v", "energy", "impacts.time", "impacts.velocity", "impacts.impulse"]
    f = vi.function("time-history", MOTION, INPUTS, names)
    jacobian = f.jacobian(f.start)
    assert f.result(f.start).count.impacts > 2
    for column in range(len(INPUTS)):
        step = np.zeros(len(INPUTS))
        step[column] = 1e-6
        difference = (f(f.start + step) - f(f.start - step)) / 2e-6
        assert jacobian[:, column] == pytest.approx(difference, rel=1e-6, abs=1e-6), INPUTS[column]


def test_derivatives_of_a_motion_by_names(tmp_path: Path) -> None:
    result = vi.Local().compute("time-history", MOTION | {"derivatives": INPUTS})
    assert isinstance(result, vi.TimeHistory)
    by_gap = result.derivative("x", "gap")
    assert by_gap.shape == (2, 2)
    times = result.derivative("impacts.time", "gap")
    assert times.shape == result.impacts.time.shape
    assert result.derivative["unit"].tolist()[:2] == ["length", "1"]
    assert result.derivative.reason.tolist() == ["ok", "ok"]
    assert (result.error.derivative.x < 1e-11).all()
    assert (result.error.derivative.impacts.time < 1e-11).all()
    stored = vi.TimeHistory(result.to_hdf5(tmp_path / "motion.h5"))
    assert stored.derivative("impacts.time", "gap").tolist() == times.tolist()
    data = result.to_xarray("derivative")
    assert data["x"].sel(parameter=GAP).values.tolist() == by_gap.tolist()
    with pytest.raises(ValueError, match=r"no derivative of 'contacts\.start'; there are x, v"):
        result.derivative("contacts.start", "gap")


@pytest.mark.parametrize(
    ("inputs", "outputs", "fault"),
    [
        ([], ["momentum"], "needs inputs and outputs"),
        ([GAP, GAP], ["momentum"], "twice"),
        (["system.constraints.1.gap"], ["momentum"], "no number"),
        (["system.constraints.0"], ["momentum"], "is no number"),
        (["frequency"], ["momentum"], "is no number"),
    ],
)
def test_wrong_functions(inputs: list[str], outputs: list[str], fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        vi.function("impact-modes", REQUEST, inputs, outputs)


@pytest.mark.parametrize(
    ("request_document", "fault"),
    [
        (REQUEST | {"system": {"preset": "chain", "n": 2}}, "has no matrix C: the structure is a"),
        (REQUEST | {"system": REQUEST["system"] | {"C": None}}, "the request has no matrix C$"),
        (REQUEST | {"system": "0" * 64}, "the request has no matrix C$"),
        ({}, "the request has no matrix C$"),
    ],
)
def test_factors_of_matrices_that_are_not_there(
    request_document: dict[str, Any], fault: str
) -> None:
    with pytest.raises(ValueError, match=fault):
        vi.function("impact-modes", request_document, ["system.C.scale"], ["momentum"])


def test_wrong_points_and_outputs() -> None:
    f = vi.function("impact-modes", REQUEST, [GAP], ["exists"])
    with pytest.raises(ValueError, match="shape"):
        f([0.1, 0.2])
    with pytest.raises(ValueError, match="no derivative of 'exists'"):
        f.jacobian([0.3])


def test_derivatives_by_names(tmp_path: Path) -> None:
    """In this process, in a file and as a document; ends of paths that name one parameter."""
    result = vi.Local().impact_modes(
        REQUEST["system"], [2.0], outputs=["impulse"], derivatives=[GAP, "frequency", STIFF]
    )
    momentum = result.derivative("momentum", "gap")
    assert momentum == pytest.approx(result.momentum / 0.3, rel=1e-13)
    assert result.derivative("momentum", GAP).tolist() == momentum.tolist()
    assert result.error.derivative["momentum"].shape == (1, 1, 3)
    assert result.derivative["unit"].tolist() == ["length", "time-1", "mass time-2"]
    stored = vi.ImpactModes(result.to_hdf5(tmp_path / "result.h5"))
    assert stored.derivative("momentum", "gap").tolist() == momentum.tolist()
    assert stored.parameter.tolist() == [GAP, "frequency", STIFF]
    data = result.to_xarray("derivative")
    assert data["momentum"].sel(parameter=GAP).values.tolist() == momentum.tolist()
    assert result.to_dict()["derivative"]["parameter"] == [GAP, "frequency", STIFF]
    with pytest.raises(ValueError, match="there is no derivative of 'shape'; there are impulse"):
        result.derivative("shape", "gap")
    with pytest.raises(ValueError, match="no parameter 'mass'"):
        result.derivative("momentum", "mass")
    with pytest.raises(ValueError, match="more than one parameter 'gap'"):
        place_of("gap", [GAP, "system.constraints.1.gap"])


def test_jax_is_asked_for_where_it_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jax", None)
    f = vi.function("impact-modes", REQUEST, [GAP], ["momentum"])
    with pytest.raises(ImportError):
        f.jax()
