"""The numbers of the book chapter, over HTTP, in both encodings."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from vibroimpact_solvers import impact_modes
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.presets import chain, double_pendulum, oscillator, two_mass

REFERENCE = Path(__file__).parents[1] / "reference" / "impact_modes.json"
ENTRIES = {e["name"]: e for e in json.loads(REFERENCE.read_text(encoding="utf-8"))["entries"]}
OUTPUTS = ["impulse", "exists", "reason", "shape", "waveform", "energy"]


def stop(dof: int, gap: float) -> dict[str, float]:
    return {"dof": dof, "gap": gap}


SYSTEMS: dict[str, tuple[dict[str, Any], System]] = {
    "sdof_bilateral": (
        {"preset": "oscillator", "Omega0": 1, "constraints": [stop(0, 1)]},
        oscillator([Constraint.at(0, 1.0)], 1.0),
    ),
    "mdof_one_constraint": (
        {"M": {"scalar": 1, "n": 2}, "K": [[2, -1], [-1, 2]], "constraints": [stop(0, 0.2)]},
        two_mass([Constraint.at(0, 0.2)], 1.0),
    ),
    "double_pendulum": (
        {"preset": "double_pendulum", "mu": 2, "constraints": [stop(0, 0.1)]},
        double_pendulum([Constraint.at(0, 0.1)], 2.0),
    ),
    "chain_one": (
        {"preset": "chain", "n": 13, "constraints": [stop(5, 0.2)]},
        chain(13, [Constraint.at(5, 0.2)]),
    ),
    "chain_two": (
        {"preset": "chain", "n": 12, "constraints": [stop(4, 0.2), stop(8, 0.2)]},
        chain(12, [Constraint.at(4, 0.2), Constraint.at(8, 0.2)]),
    ),
}


def answers(service: Any, request: Mapping[str, Any]) -> tuple[dict[str, Any], h5py.File]:
    """Return the answer in both encodings."""
    address = "/v1/compute/impact-modes"
    document = service.http.post(address, json=request)
    assert document.status_code == 200, document.text
    file = service.http.post(address, json=request, headers={"Accept": "application/x-hdf5"})
    return document.json(), h5py.File(io.BytesIO(file.content))


def check_same_bits(service: Any, entry: Mapping[str, Any], **request: Any) -> dict[str, Any]:
    """Compare JSON, HDF5 and the library, and return the first."""
    document, system = SYSTEMS[entry["system"]]
    content = {"system": document, "tau": [1.0], "outputs": OUTPUTS, **request}
    answer, file = answers(service, content)
    frequency = np.array(content["frequency"]["values"])
    unit = content["frequency"].get("unit", "Omega")
    problem = impact_modes.Problem(
        system,
        frequency if unit == "omega" else frequency * (2.0 / np.pi),
        outputs=frozenset(OUTPUTS),
        tau=np.array(content["tau"]),
        Omega=frequency if unit == "Omega" else None,
    )
    library = impact_modes.solve(problem, impact_modes.plan(problem))
    with file:
        for name in ("impulse", "shape", "waveform", "energy"):
            bits = getattr(library, name).tobytes()
            assert np.array(answer[name]).tobytes() == bits, name
            assert file[name][...].tobytes() == bits, name
        assert np.array(answer["frequency"][unit]).tobytes() == frequency.tobytes()
        assert file[f"frequency/{unit}"][...].tobytes() == frequency.tobytes()
    return answer


def families() -> Iterator[Any]:
    for name, keys, place in (
        ("13", ("p1",), None),
        ("17", ("p1",), "p1_at_Omega"),
        ("24", ("p6",), "p6_at_Omega"),
        ("33", ("p5", "p9"), None),
    ):
        values = ENTRIES[name]["values"]
        yield pytest.param(ENTRIES[name], keys, values[place] if place else values, id=name)


@pytest.mark.parametrize(("entry", "keys", "values"), list(families()))
def test_families(
    service: Any, entry: dict[str, Any], keys: tuple[str, ...], values: dict[str, Any]
) -> None:
    answer = check_same_bits(service, entry, frequency={"values": [float(text) for text in values]})
    expected = np.array([[float(value[key]) for key in keys] for value in values.values()])
    error = np.abs(np.array(answer["impulse"]) - expected).max(axis=1)
    assert (error <= 1e-12 * np.abs(expected).max(axis=1)).all()


@pytest.mark.parametrize("name", ["15", "16", "18", "19", "26", "27", "28", "29", "30", "34"])
def test_solutions(service: Any, name: str) -> None:
    entry = ENTRIES[name]
    values = entry["values"]
    tau = [float(text) for text in values["X_at_tau"]]
    frequency = {"values": [float(entry["parameters"]["omega"])], "unit": "omega"}
    answer = check_same_bits(service, entry, frequency=frequency, tau=tau)
    np.testing.assert_allclose(
        answer["impulse"][0], [float(text) for text in values["p"]], rtol=1e-12
    )
    x = np.array([[float(text) for text in row] for row in values["X_at_tau"].values()])
    scale = np.abs(x).max()
    np.testing.assert_allclose(answer["waveform"][0], x, rtol=1e-12, atol=1e-12 * scale)
    assert answer["energy"][0] == pytest.approx(float(values["total_energy"]), rel=1e-12)
    assert answer["exists"][0] is values["real_motion"]


def test_the_oscillator(service: Any) -> None:
    values = ENTRIES["01"]["values"]
    frequency = {"values": [float(values["omega"])], "unit": "omega"}
    answer = check_same_bits(service, ENTRIES["01"], frequency=frequency)
    assert answer["impulse"][0][0] == pytest.approx(float(values["p"]), rel=1e-12)
    assert answer["energy"][0] == pytest.approx(float(values["E"]), rel=1e-12)


@pytest.mark.parametrize("omega", ["5", "50", "1000"])
def test_the_high_frequency_limit(service: Any, omega: str) -> None:
    values = ENTRIES["35"]["values"][omega]
    frequency = {"values": [float(omega)], "unit": "omega"}
    answer = check_same_bits(service, ENTRIES["35"], frequency=frequency)
    assert answer["impulse"][0][0] == pytest.approx(float(values["p5"]), rel=1e-12)
    expected = [float(text) for text in values["x_tau1_n=3..11"]]
    np.testing.assert_allclose(answer["shape"][0][2:11], expected, rtol=1e-12)


def test_ratios_of_the_double_pendulum(service: Any) -> None:
    ratios = ENTRIES["20"]["values"]["ratio_at_omega"]
    frequency = {"values": [float(text) for text in ratios], "unit": "omega"}
    answer = check_same_bits(service, ENTRIES["18"], frequency=frequency)
    shape = np.array(answer["shape"])
    expected = [float(text) for text in ratios.values()]
    np.testing.assert_allclose(shape[:, 1] / shape[:, 0], expected, rtol=1e-12)
