"""Systems stored by content, and references to them."""

from __future__ import annotations

from typing import Any

import orjson
import pytest

from vibroimpact_schema.systems import SystemReference
from vibroimpact_service.documents import digest, stored_systems
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store


def test_stored_systems_stand_for_themselves(store: Store, chain: dict[str, Any]) -> None:
    document = stored_systems.SYSTEM.validate_python(chain)
    name = "sys_" + "0" * 64
    store.systems.put(name, digest.canonical(document))
    assert stored_systems.resolve(store, SystemReference(id=name)) == document
    moved = stored_systems.SYSTEM.validate_python(
        {"id": name, "constraints": [{"dof": 1, "gap": 3}]}
    )
    assert isinstance(moved, SystemReference)
    found = stored_systems.resolve(store, moved)
    assert found.constraints == moved.constraints
    with pytest.raises(ProblemError) as caught:
        stored_systems.resolve(store, SystemReference(id="sys_" + "1" * 64), "system")
    assert caught.value.errors[0].pointer == "/system/id"


def test_a_reference_may_have_a_damping_of_its_own(store: Store) -> None:
    eye = {"diagonal": [1.0, 1.0]}

    def stored(name: str, content: dict[str, Any]) -> str:
        document = stored_systems.SYSTEM.validate_python({**content, "constraints": []})
        store.systems.put(name, digest.canonical(document))
        return name

    plain = stored("sys_" + "2" * 64, {"M": eye, "K": eye, "damping": {"ratio": 0.01}})
    more = SystemReference.model_validate({"id": plain, "damping": {"ratio": 0.02}})
    system = stored_systems.resolve(store, more)
    assert system.model_dump(exclude_none=True)["damping"] == {"ratio": 0.02}
    kept = stored_systems.resolve(store, SystemReference(id=plain))
    assert kept.model_dump(exclude_none=True)["damping"] == {"ratio": 0.01}
    damped = stored("sys_" + "3" * 64, {"M": eye, "K": eye, "C": eye})
    preset = stored("sys_" + "4" * 64, {"preset": "oscillator", "Omega0": 1.0, "zeta": 0.1})
    for name in (damped, preset):
        twice = more.model_copy(update={"id": name})
        with pytest.raises(ProblemError) as caught:
            stored_systems.resolve(store, twice, "system")
        assert caught.value.errors[0].pointer == "/system/damping"
        assert caught.value.errors[0].code == "two_dampings"


def test_systems_are_stored_by_content(
    settings: Settings, store: Store, chain: dict[str, Any]
) -> None:
    def put(owner: str, content: dict[str, Any]) -> Any:
        body = orjson.dumps(content)
        return stored_systems.put(store, settings, owner, stored_systems.JSON, body)

    first, new = put("me", chain)
    again, still_new = put("me", {**chain, "mass": 1.0})
    assert (new, still_new) == (True, False)
    assert first == again
    assert (first.n, first.constraints) == (13, 1)
    other, _ = put("you", chain)
    assert other.id != first.id
    assert orjson.loads(store.systems.get(first.id) or b"")["preset"] == "chain"
    moved = {"id": first.id, "constraints": [{"dof": 0, "gap": 1}]}
    copy, _ = put("me", moved)
    assert copy.id not in (first.id, other.id)


def test_nobody_takes_over_the_system_of_somebody_else(
    settings: Settings, store: Store, chain: dict[str, Any]
) -> None:
    mine, _ = stored_systems.put(store, settings, "me", stored_systems.JSON, orjson.dumps(chain))
    body = orjson.dumps({"id": mine.id, "constraints": [{"dof": 0, "gap": 1}]})
    with pytest.raises(ProblemError) as caught:
        stored_systems.put(store, settings, "you", stored_systems.JSON, body)
    assert caught.value.errors[0].pointer == "/id"
    assert caught.value.errors[0].code == "unknown_system"
    assert [entry.name for entry in store.systems.entries()] == [mine.id]
