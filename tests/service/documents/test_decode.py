"""Documents become the solvers' problems, exactly and with faults under their own pointers."""

from __future__ import annotations

import gc
import math
import weakref
from collections.abc import Iterator
from decimal import Decimal
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from vibroimpact_schema import grids, requests, systems
from vibroimpact_service.documents import decode, grid_values
from vibroimpact_solvers import presets, spectrum, time_history
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, System

SYSTEM: TypeAdapter[Any] = TypeAdapter(systems.System)
GRID: TypeAdapter[Any] = TypeAdapter(grids.FrequencyGrid)
STOP = {"dof": 0, "gap": 0.2}


def system(**document: Any) -> System:
    return decode.system(SYSTEM.validate_python({"constraints": [STOP], **document}))


def matrices(of: System) -> tuple[np.ndarray, np.ndarray]:
    return of.M.to_dense(), of.K.to_dense()


def test_every_form_of_a_matrix_means_the_same() -> None:
    expected = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
    entries = [(i, j) for i in range(3) for j in range(3) if expected[i, j]]
    forms = [
        expected.tolist(),
        {"bands": {"0": [2, 2, 2], "1": [-1, -1]}},
        {
            "shape": [3, 3],
            "row": [i for i, _ in entries],
            "col": [j for _, j in entries],
            "data": [expected[e] for e in entries],
        },
    ]
    for form in forms:
        M, K = matrices(system(M={"scalar": 2.0, "n": 3}, K=form))
        np.testing.assert_array_equal(K, expected)
        np.testing.assert_array_equal(M, 2.0 * np.eye(3))
    _, K = matrices(system(M={"scalar": 1, "n": 2}, K={"diagonal": [3, 4]}))
    np.testing.assert_array_equal(K, np.diag([3.0, 4.0]))


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        (
            {"preset": "chain", "n": 4, "mass": 2, "stiffness": 3},
            presets.chain(4, [], 2.0, 3.0),
        ),
        (
            {"preset": "oscillator", "Omega0": 1.5, "zeta": 0.1},
            presets.oscillator([], 1.5, 0.1),
        ),
        (
            {"preset": "two_mass", "Omega0": 2, "coupling": 0.5, "zeta": 0.1},
            presets.two_mass([], 2.0, 0.5, 0.1),
        ),
        ({"preset": "double_pendulum", "mu": 2}, presets.double_pendulum([], 2.0)),
        (
            {"preset": "absorber", "Omega0": 2, "ratio": 0.1, "tuning": 0.9},
            presets.absorber([], 2.0, 0.1, 0.9),
        ),
        (
            {"preset": "beam", "elements": 3, "length": 2, "EI": 5, "rhoA": 0.8},
            presets.beam([], 3, 2.0, 5.0, 0.8),
        ),
        ({"preset": "bouncing_ball", "g": 9.81}, presets.bouncing_ball([], 9.81)),
    ],
)
def test_presets(document: dict[str, Any], expected: System) -> None:
    found = system(**document)
    for one, other in zip(matrices(found), matrices(expected), strict=True):
        np.testing.assert_array_equal(one, other)
    assert (found.C is None) == (expected.C is None)
    if found.C is not None and expected.C is not None:
        np.testing.assert_array_equal(found.C.to_dense(), expected.C.to_dense())
    assert (found.force is None) == (expected.force is None)


def test_constraints() -> None:
    found = system(
        preset="chain",
        n=5,
        constraints=[
            {"dof": 3, "gap": 0.5, "restitution": 0.8},
            {"direction": {"dofs": [3, 4], "weights": [1, -1]}, "gap": {"upper": 0.1}},
            {"dof": 1, "gap": {"lower": 0.3, "upper": -0.1}},
        ],
    ).constraints
    assert found == (
        Constraint((3,), (1.0,), 0.5, 0.5, 0.8),
        Constraint((3, 4), (1.0, -1.0), None, 0.1, 1.0),
        Constraint((1,), (1.0,), 0.3, -0.1, 1.0),
    )


@pytest.mark.parametrize(
    ("document", "pointer"),
    [
        ({"preset": "oscillator", "Omega0": 1e300}, ("Omega0",)),
        ({"preset": "two_mass", "Omega0": 1e300}, ("Omega0",)),
        ({"preset": "absorber", "Omega0": 1, "tuning": 1e200}, ("tuning",)),
        ({"preset": "absorber", "Omega0": 1, "ratio": 1e300}, ("ratio",)),
        ({"preset": "beam", "elements": 2, "length": 1e-300}, ("length",)),
        ({"preset": "beam", "elements": 2, "EI": 1e300}, ("EI",)),
        ({"preset": "beam", "elements": 2, "rhoA": 1e300}, ("rhoA",)),
        ({"M": [[1, 0], [0, 1]], "K": [[1, 2], [3, 1]]}, ("K",)),
        ({"M": [[1, 0], [0, 1]], "K": [[1, 2, 3], [2, 1, 3]]}, ("K",)),
        ({"M": [[1, 0], [0, 1]], "K": [[1, 2], [2]]}, ("K",)),
        ({"M": [[1, 2], [2, 1]], "K": [[1, 0], [0, 1]]}, ("M",)),
        ({"M": {"scalar": 1, "n": 2}, "K": {"scalar": 1, "n": 3}}, ("K",)),
        ({"M": {"scalar": 1, "n": 2}, "K": {"bands": {"1": [1]}}}, ("K", "bands")),
        ({"M": {"scalar": 1, "n": 2}, "K": {"bands": {"0": [1, 1], "1": []}}}, ("K", "bands", "1")),
        (
            {
                "M": {"scalar": 1, "n": 2},
                "K": {"shape": [2, 2], "row": [2], "col": [0], "data": [1]},
            },
            ("K", "row"),
        ),
        (
            {
                "M": {"scalar": 1, "n": 1},
                "K": {"scalar": 1, "n": 1},
                "C": {"diagonal": [1, 2]},
            },
            ("C",),
        ),
        ({"M": [[1]], "K": [[1]], "force": [1, 2]}, ("force",)),
        (
            {"preset": "chain", "n": 3, "constraints": [STOP, {"dof": 3, "gap": 1}]},
            ("constraints", 1, "dof"),
        ),
        ({"preset": "chain", "n": 3, "constraints": [STOP, STOP]}, ("constraints", 1)),
        (
            {
                "preset": "chain",
                "n": 3,
                "constraints": [STOP, {"dof": 1, "gap": {"lower": 1, "upper": -1}}],
            },
            ("constraints", 1, "gap"),
        ),
    ],
)
def test_faults_of_the_model_point_into_the_document(
    document: dict[str, Any], pointer: tuple[str | int, ...]
) -> None:
    with pytest.raises(ModelError) as caught:
        system(**document)
    assert caught.value.pointer == pointer


def test_equal_documents_share_one_system() -> None:
    chain = {"preset": "chain", "n": 7}
    assert system(**chain) is system(**chain)
    assert system(**chain) is not system(**chain, mass=2)


def test_given_frequencies_are_kept_to_the_bit() -> None:
    values = [0.1, math.pi / 3, 1.0954804955123456]
    Omega, omega = grid_values.frequencies(GRID.validate_python({"values": values}))
    assert Omega.tolist() == values
    np.testing.assert_allclose(omega, Omega * 2 / np.pi, rtol=1e-15)
    Omega, omega = grid_values.frequencies(
        GRID.validate_python({"values": values, "unit": "omega"})
    )
    assert omega.tolist() == values
    np.testing.assert_allclose(Omega, omega * np.pi / 2, rtol=1e-15)


def test_grids_meet_their_ends() -> None:
    Omega, _ = grid_values.frequencies(GRID.validate_python({"start": 0.6, "stop": 2.4, "num": 7}))
    assert (Omega[0], Omega[-1], Omega.size) == (0.6, 2.4, 7)
    Omega, _ = grid_values.frequencies(
        GRID.validate_python({"start": 1.0, "stop": 2.0, "step": 0.1})
    )
    assert (Omega[0], Omega[-1], Omega.size) == (1.0, 2.0, 11)
    Omega, _ = grid_values.frequencies(
        GRID.validate_python({"start": 1.0, "stop": 1.95, "step": 0.1})
    )
    assert Omega.size == 10
    assert Omega[-1] == 1.9


@pytest.mark.parametrize(
    ("start", "step", "count"),
    [("0.6", "0.1", 30), ("1e-7", "3e-9", 1000), ("12345.5", "0.0001", 5000), ("2", "1", 9)],
)
def test_steps_are_the_decimals_that_are_meant(start: str, step: str, count: int) -> None:
    exact = [float(Decimal(start) + i * Decimal(step)) for i in range(count)]
    stop = float(Decimal(start) + (count - 1) * Decimal(step))
    grid = {"start": float(start), "stop": stop, "step": float(step)}
    Omega, _ = grid_values.frequencies(GRID.validate_python(grid))
    assert Omega.tolist() == exact


def test_steps_of_many_digits_are_taken_as_they_are() -> None:
    grid = {"start": 1 / 3, "stop": 1.0, "step": 1 / 7}
    Omega, _ = grid_values.frequencies(GRID.validate_python(grid))
    np.testing.assert_allclose(Omega, 1 / 3 + np.arange(5) / 7, rtol=1e-15)


def test_impact_modes() -> None:
    document = {
        "system": {"preset": "chain", "n": 5, "constraints": [STOP, {"dof": 3, "gap": 0.1}]},
        "frequency": {"values": [2.5]},
        "active": [1],
        "dofs": [4, 0],
        "tau": [0, 1],
        "outputs": ["shape", "waveform"],
        "tolerance": 1e-9,
    }
    request = requests.ImpactModesRequest.model_validate(document)
    problem = decode.impact_modes(request, decode.system(request.system))
    assert problem.active == (1,)
    assert problem.outputs == {"shape", "waveform"}
    assert problem.output_dofs.tolist() == [4, 0]
    assert problem.times.tolist() == [0, 1]
    assert problem.tolerance == 1e-9


@pytest.mark.parametrize(
    ("time", "unit", "given", "Omega"),
    [
        (None, "Hz", 50.0, 100.0 * np.pi),
        ("s", "rpm", 3000.0, 100.0 * np.pi),
        ("ms", "Hz", 50.0, 0.1 * np.pi),
        ("min", "rpm", 50.0, 100.0 * np.pi),
    ],
)
def test_frequencies_in_hertz_and_revolutions(
    time: str | None, unit: str, given: float, Omega: float
) -> None:
    units = {} if time is None else {"units": {"length": "mm", "mass": "kg", "time": time}}
    of = system(M={"diagonal": [1.0]}, K={"diagonal": [1.0]}, **units)
    grid = GRID.validate_python({"values": [given], "unit": unit})
    computed, omega = grid_values.frequencies(grid, of.units)
    assert computed[0] == pytest.approx(Omega, rel=1e-15)
    assert omega[0] == pytest.approx(2.0 / np.pi * Omega, rel=1e-15)


def test_hertz_needs_a_unit_of_time() -> None:
    of = system(
        M={"diagonal": [1.0]},
        K={"diagonal": [1.0]},
        units={"length": "m", "mass": "kg", "time": "fortnight"},
    )
    with pytest.raises(ModelError, match="fortnight"):
        grid_values.frequencies(GRID.validate_python({"values": [1.0], "unit": "Hz"}), of.units)


@pytest.mark.parametrize(
    "times",
    [
        [0.0, 0.5, 1.0],
        {"values": [0.0, 0.5, 1.0]},
        {"num": 3},
        {"stop": 1.0, "num": 3},
        {"start": 0.0, "stop": 1.0, "step": 0.5},
    ],
)
def test_times_in_every_form(times: Any) -> None:
    body = {"initial": {"x": [0.0], "v": [0.0]}, "t_end": 1.0, "t": times}
    document = {"preset": "oscillator", "Omega0": 1.0, "constraints": [STOP]}
    request = requests.TimeHistoryRequest.model_validate({"system": document, **body})
    problem = decode.time_history(request, decode.system(request.system))
    np.testing.assert_array_equal(problem.t, [0.0, 0.5, 1.0])


def test_dependent_constraints_are_named() -> None:
    def along(*pair: float) -> dict[str, Any]:
        return {"direction": {"dofs": [0, 1], "weights": list(pair)}, "gap": 1.0}

    limiters = [{"dof": 2, "gap": 1.0}, along(1.0, 0.0), along(1.0, 1.0), along(2.0, 3.0)]
    document = {"M": {"scalar": 1.0, "n": 3}, "K": {"diagonal": [1.0, 2.0, 3.0]}}
    body = {"system": {**document, "constraints": limiters}, "frequency": {"values": [1.0]}}
    request = requests.ImpactModesRequest.model_validate(body)
    with pytest.raises(ModelError, match=r"constraint 3 is .* constraints 1, 2: ") as caught:
        decode.impact_modes(request, decode.system(request.system))
    assert caught.value.code == "dependent_constraints"


def test_stops_without_mass_are_named() -> None:
    with pytest.raises(ModelError, match=r"dof 0 has no mass: .* give the stop a mass") as caught:
        system(M={"diagonal": [0.0, 1.0, 0.0]}, K={"diagonal": [1.0, 1.0, 1.0]})
    assert caught.value.pointer == ("constraints", 0)


def test_degrees_of_freedom_without_mass_are_accepted() -> None:
    accepted = system(M={"diagonal": [1.0, 1.0, 0.0]}, K={"diagonal": [1.0, 1.0, 1.0]})
    assert accepted.massless.tolist() == [2]


def motion(*load: dict[str, Any]) -> Any:
    body = {
        "system": {"M": {"diagonal": [2.0, 1.0]}, "K": [[2, -1], [-1, 2]], "constraints": [STOP]},
        "initial": {"x": [0, 0], "v": [0, 0]}, "t_end": 1.0, "load": list(load),
    }  # fmt: skip
    request = requests.TimeHistoryRequest.model_validate(body)
    return decode.time_history(request, decode.system(request.system))


def test_samples_and_moving_bases() -> None:
    first, second, third = motion(
        {"dof": 1, "force": [0, 1, 4], "interval": 0.5},
        {"direction": {"dofs": [1, 0], "weights": [3, -1]}, "force": [1, 2], "t": [-1, 2]},
        {"base": [1, 1], "acceleration": [0, 9.5], "interval": 1},
    ).load
    assert first.direction.tolist() == [0.0, 1.0]
    assert first.t.tolist() == [0.0, 0.5, 1.0]
    assert first.values.tolist() == [0.0, 1.0, 4.0]
    assert second.direction.tolist() == [-1.0, 3.0]
    assert second.t.tolist() == [-1.0, 2.0]
    assert third.direction.tolist() == [-2.0, -1.0]  # -M r
    assert third.values.tolist() == [0.0, 9.5]


@pytest.mark.parametrize(
    ("load", "pointer"),
    [
        ({"dof": 2, "force": [0, 1], "interval": 1}, ("load", 0, "dof")),
        ({"base": [1], "acceleration": [0, 1], "interval": 1}, ("load", 0, "base")),
        ({"dof": 0, "force": [0, 1], "interval": 0.5}, ("load", 0, "interval")),
        (
            {"direction": {"dofs": [0], "weights": [1, 2]}, "force": [0, 1], "interval": 1},
            ("load", 0, "direction"),
        ),
    ],
)
def test_faults_of_samples(load: dict[str, Any], pointer: tuple[Any, ...]) -> None:
    with pytest.raises(ModelError) as caught:
        motion(load)
    assert caught.value.pointer == pointer


@pytest.mark.parametrize(
    "load",
    [
        {"dof": 0, "force": [0, 1]},
        {"dof": 0, "force": [0, 1], "interval": 1, "t": [0, 1]},
        {"force": [0, 1], "interval": 1},
        {"dof": 0, "force": [0], "interval": 1},
        {"dof": 0, "acceleration": [0, 1], "interval": 1},
    ],
)
def test_forms_of_samples(load: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"load"):
        motion(load)


@pytest.fixture
def known() -> Iterator[Any]:
    """Let a test fill the systems that are kept, and change how much they may take."""
    decode.KNOWN.clear()
    yield decode.KNOWN
    decode.KNOWN.resize(2**28)
    decode.KNOWN.clear()


def test_systems_are_kept_as_long_as_their_memory_allows(known: Any) -> None:
    each = 2 * 8 * 100**2  # full M and K
    known.resize(2 * each)
    rows = np.ones((100, 100)) + 100.0 * np.eye(100)
    kept = [system(M=(k * rows).tolist(), K=rows.tolist()) for k in (1.0, 2.0, 3.0)]
    assert known.nbytes == 2 * each
    assert system(M=(3.0 * rows).tolist(), K=rows.tolist()) is kept[2]
    assert system(M=rows.tolist(), K=rows.tolist()) is not kept[0]


@pytest.mark.parametrize("ratio", [None, 0.02])
def test_systems_with_other_limiters_share_their_structure(known: Any, ratio: float | None) -> None:
    def stopped(gap: float, stiffness: float = 1.0) -> System:
        damping = {} if ratio is None else {"damping": {"ratio": ratio}}
        stop = {**STOP, "gap": gap}
        dashpot = {"dofs": [0], "weights": [1.0], "c": 0.1}
        content = {"M": [[1.0]], "K": [[stiffness]], "constraints": [stop], "dashpots": [dashpot]}
        return decode.system(SYSTEM.validate_python(content | damping))

    one, other, stiff = stopped(0.5), stopped(0.7), stopped(0.7, 2.0)
    assert one.body is other.body
    assert stiff.body is not one.body
    assert [each.constraints[0].upper for each in (one, other, stiff)] == [0.5, 0.7, 0.7]
    known.clear()
    again = stopped(0.7)
    assert again.constraints == other.constraints
    assert again.C is not None
    assert other.C is not None
    assert (again.C.to_dense() == other.C.to_dense()).all()
    with pytest.raises(ModelError, match="is none of 0 to 0") as error:
        decode.system(
            SYSTEM.validate_python(
                {"M": [[1.0]], "K": [[2.0]], "constraints": [{**STOP, "dof": 1}]}
            )
        )
    assert error.value.pointer[:2] == ("constraints", 0)


def test_what_histories_prepare_for_a_system_counts_and_its_document_is_not_kept(
    known: Any,
) -> None:
    rows = np.ones((70, 70)) + 70.0 * np.eye(70)
    document = SYSTEM.validate_python(
        {"M": rows.tolist(), "K": (2.0 * rows).tolist(), "constraints": [STOP]}
    )
    found, sent = decode.system(document), weakref.ref(document)
    before = known.nbytes
    time_history.structure.Structure.of(found, spectrum.choose(found), 1.0).configuration()
    assert known.nbytes > before + 2 * 8 * 70**2
    del document
    gc.collect()
    assert sent() is None
