"""Documents of systems: what they take, what they refuse, and where they say it is wrong."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from vibroimpact_schema import systems

SYSTEM: TypeAdapter[Any] = TypeAdapter(systems.System)
STOP = {"dof": 0, "gap": 0.2}
CHAIN = {"preset": "chain", "n": 3, "constraints": [STOP]}


def fault(document: Any) -> tuple[str, tuple[Any, ...]]:
    """Return the type and the place, without names of branches, of the first fault."""
    with pytest.raises(ValidationError) as caught:
        SYSTEM.validate_python(document)
    first = caught.value.errors()[0]
    place = (part for part in first["loc"] if part not in {"chain", "double_pendulum"})
    return first["type"], tuple(part for part in place if not str(part).startswith("@"))


def with_K(K: Any) -> dict[str, Any]:
    return {"M": {"scalar": 1, "n": 2}, "K": K, "constraints": [STOP]}


@pytest.mark.parametrize(
    ("K", "form"),
    [
        ([[2, -1], [-1, 2.5]], list),
        ({"diagonal": [2, 1]}, systems.DiagonalMatrix),
        ({"bands": {"0": [2, 2], "1": [-1]}}, systems.BandedMatrix),
        ({"shape": [2, 2], "row": [0], "col": [0], "data": [1]}, systems.CoordinateMatrix),
        ({"scalar": 2, "n": 2}, systems.ScalarMatrix),
    ],
)
def test_every_form_of_a_matrix_survives_the_round_trip(K: Any, form: type) -> None:
    system = SYSTEM.validate_python(with_K(K))
    assert isinstance(system.K, form)
    again = SYSTEM.validate_python(SYSTEM.dump_python(system))
    assert again == system


@pytest.mark.parametrize(
    ("parameters", "form"),
    [
        ({"preset": "chain", "n": 13}, systems.Chain),
        ({"preset": "oscillator", "Omega0": 1}, systems.Oscillator),
        ({"preset": "two_mass", "Omega0": 1, "coupling": 1, "zeta": 0}, systems.TwoMass),
        ({"preset": "double_pendulum", "mu": 2}, systems.DoublePendulum),
        ({"preset": "bouncing_ball", "g": 9.81}, systems.BouncingBall),
        ({"preset": "absorber", "Omega0": 1, "tuning": 0}, systems.Absorber),
        ({"preset": "beam", "elements": 4, "EI": 100}, systems.Beam),
        ({"id": "sys_" + "0" * 64}, systems.SystemReference),
    ],
)
def test_presets_and_references(parameters: dict[str, Any], form: type) -> None:
    assert isinstance(SYSTEM.validate_python({**parameters, "constraints": [STOP]}), form)


@pytest.mark.parametrize(
    ("document", "kind", "place"),
    [
        ({**CHAIN, "color": "red"}, "extra_forbidden", ("color",)),
        ({**CHAIN, "n": 0}, "greater_than_equal", ("n",)),
        ({**CHAIN, "n": 3.0}, "int_type", ("n",)),
        ({**CHAIN, "n": True}, "int_type", ("n",)),
        ({**CHAIN, "n": 10**400}, "less_than_equal", ("n",)),
        ({**CHAIN, "mass": 0}, "greater_than", ("mass",)),
        ({**CHAIN, "stiffness": float("nan")}, "finite_number", ("stiffness",)),
        ({**CHAIN, "preset": "spring"}, "union_tag_invalid", ()),
        ({"preset": "double_pendulum", "mu": 1, "constraints": []}, "greater_than", ("mu",)),
        ({"id": "sys_1"}, "string_pattern_mismatch", ("id",)),
        ([], "system_form", ()),
        ("chain", "system_form", ()),
        (with_K([[1, float("inf")]]), "finite_number", ("K", 0, 1)),
        (with_K([[1, "1"]]), "float_type", ("K", 0, 1)),
        (with_K([[1, True]]), "float_type", ("K", 0, 1)),
        (with_K([[1, 10**400]]), "float_type", ("K", 0, 1)),
        (with_K([]), "too_short", ("K",)),
        (with_K({}), "matrix_form", ("K",)),
        (with_K(5), "matrix_form", ("K",)),
        (with_K({"bands": {}}), "too_short", ("K", "bands")),
        (with_K({"shape": [2], "row": [], "col": [], "data": []}), "too_short", ("K", "shape")),
        ({"M": [[1]], "constraints": []}, "missing", ("K",)),
    ],
)
def test_faults_name_their_place(document: Any, kind: str, place: tuple[Any, ...]) -> None:
    assert fault(document) == (kind, place)


@pytest.mark.parametrize(
    ("constraint", "kind", "place"),
    [
        ({"dof": 0, "gap": 0}, "greater_than", ("gap",)),
        ({"dof": 0, "gap": -0.2}, "greater_than", ("gap",)),
        ({"dof": 0, "gap": "wide"}, "gap_form", ("gap",)),
        ({"dof": 0, "gap": {"lower": "0"}}, "float_type", ("gap", "lower")),
        ({"dof": 0}, "missing", ("gap",)),
        ({"dof": -1, "gap": 1}, "greater_than_equal", ("dof",)),
        ({"dof": 0, "gap": 1, "restitution": 1.01}, "less_than_equal", ("restitution",)),
        ({"gap": 1}, "dof_or_direction", ()),
        (
            {"dof": 0, "direction": {"dofs": [0], "weights": [1]}, "gap": 1},
            "dof_or_direction",
            (),
        ),
        ({"direction": {"dofs": [], "weights": []}, "gap": 1}, "too_short", ("direction", "dofs")),
    ],
)
def test_constraints_are_checked(
    constraint: dict[str, Any], kind: str, place: tuple[Any, ...]
) -> None:
    found = fault({**CHAIN, "constraints": [STOP, constraint]})
    assert found == (kind, ("constraints", 1, *place))


def test_preloaded_and_one_sided_gaps_are_accepted() -> None:
    for gap in ({"lower": None, "upper": -0.1}, {"lower": 0.3, "upper": -0.1}, {"upper": 0}):
        system = SYSTEM.validate_python({**CHAIN, "constraints": [{"dof": 0, "gap": gap}]})
        assert isinstance(system.constraints[0].gap, systems.Limits)


def test_a_million_wrong_entries_are_one_fault() -> None:
    with pytest.raises(ValidationError) as caught:
        SYSTEM.validate_python(with_K([["x"] * 1000] * 1000))
    assert caught.value.error_count() == 1
