"""Canonical requests and names: equal for equal content only, exact to the last bit."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from vibroimpact_schema.requests import ImpactModesRequest
from vibroimpact_service.documents import digest

SYSTEM = {"preset": "chain", "n": 3, "constraints": [{"dof": 0, "gap": 0.2}]}


def canonical(**fields: object) -> bytes:
    content = {"system": SYSTEM, "frequency": {"values": [1.0]}, **fields}
    return digest.canonical(ImpactModesRequest.model_validate(content))


def test_order_of_names_and_written_defaults_do_not_matter() -> None:
    spelled = {"constraints": [{"restitution": 1, "gap": 0.2, "dof": 0}], "n": 3, "mass": 1}
    assert canonical() == canonical(
        system={**spelled, "preset": "chain", "stiffness": 1.0}, tolerance=None
    )


def test_whole_numbers_and_floats_are_the_same_number() -> None:
    assert canonical(frequency={"values": [1]}) == canonical(frequency={"values": [1.0]})


@given(st.floats(min_value=1e-300, max_value=1e300))
@settings(deadline=None)
def test_the_last_bit_of_a_number_matters(value: float) -> None:
    neighbour = math.nextafter(value, math.inf)
    first = canonical(frequency={"values": [value]})
    assert first == canonical(frequency={"values": [value]})
    assert first != canonical(frequency={"values": [neighbour]})


def test_every_part_of_a_name_matters_and_parts_do_not_run_together() -> None:
    names = {
        digest.name("me", "kind", "1", b"request"),
        digest.name("you", "kind", "1", b"request"),
        digest.name("me", "kind2", "1", b"request"),
        digest.name("me", "kind", "2", b"request"),
        digest.name("me", "kind", "1", b"request2"),
        digest.name("mek", "ind", "1", b"request"),
    }
    assert len(names) == 6
    assert all(len(name) == 64 for name in names)


def test_the_solvers_are_named_by_their_sources() -> None:
    version, _, fingerprint = digest.solver_name().partition("+")
    assert version == digest.SOLVER_VERSION
    assert len(fingerprint) == 16
    assert digest.solver_name() == digest.solver_name()
