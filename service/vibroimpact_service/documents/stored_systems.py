"""Systems stored by content under ``sys_<digest>``, and references to them in requests."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import orjson
from pydantic import TypeAdapter

from vibroimpact_schema.service import StoredSystem
from vibroimpact_schema.systems import AnySystem, System, SystemReference
from vibroimpact_service import problems
from vibroimpact_service.documents import digest, limits, parse
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_solvers.errors import ModelError

JSON: Final = "application/json"
MEDIA_TYPES: Final = (JSON, "application/x-matrix-market", "application/x-npy")
"""Media types in which systems are accepted."""
SYSTEM: Final[TypeAdapter[AnySystem | SystemReference]] = TypeAdapter(System)


def put(
    store: Store, settings: Settings, owner: str, media_type: str, body: bytes
) -> tuple[StoredSystem, bool]:
    """Store the system in a body; return it, and whether it is new.

    Raises
    ------
    ProblemError
        400, 413 or 422 with the field that is wrong.
    """
    # The numerical libraries and the readers of files load at the first system.
    from vibroimpact_service.documents import decode, upload

    if media_type == JSON:
        document = parse.union(SYSTEM, parse.json(body))
    else:
        document = upload.system(media_type, body, settings)
    if isinstance(document, SystemReference):
        _check_owner(owner, document.id)
        document = resolve(store, document)
    limits.check_system(document, settings)
    try:
        system = decode.system(document)
    except ModelError as error:
        raise problems.of(error) from None
    data = digest.canonical(document)
    name = f"sys_{digest.name(owner, 'system', '', data)}"
    new = not store.systems.has(name)
    if new:
        store.systems.put(name, data)
    return StoredSystem(id=name, n=system.n, constraints=len(system.constraints)), new


def resolve(store: Store, reference: SystemReference, *where: str) -> AnySystem:
    """Return the stored system of a reference, with the reference's constraints if it has any.

    `where` is the path from the body to the reference.

    Raises
    ------
    ProblemError
        422 where no system of that name is stored.
    """
    data = store.systems.get(reference.id)
    if data is None:
        raise _unknown(*where)
    system: AnySystem = parse.union(SYSTEM, orjson.loads(data))
    if reference.constraints is not None:
        return system.model_copy(update={"constraints": reference.constraints})
    return system


def check_owner(owner: str, canonical: bytes, content: Any, *place: str | int) -> None:
    """Refuse a request that refers to somebody else's system, as if it did not exist.

    Parameters
    ----------
    owner : str
    canonical : bytes
        Canonical form of the request; it shows quickly that most requests refer to none.
    content : object
        JSON content of the request.
    *place : str or int
        Path from the body to `content`.

    Raises
    ------
    ProblemError
        422 with the place of the name.
    """
    if b'"sys_' in canonical:
        _check_parts(owner, content, place)


def _check_parts(owner: str, content: Any, place: tuple[str | int, ...]) -> None:
    if isinstance(content, dict):
        name = content.get("id")
        if isinstance(name, str) and name.startswith("sys_"):
            _check_owner(owner, name, *place)
        parts: Iterable[tuple[str | int, Any]] = content.items()
    elif isinstance(content, list):
        parts = enumerate(content)
    else:
        return
    for key, part in parts:
        if isinstance(part, dict | list):
            _check_parts(owner, part, (*place, key))


def _check_owner(owner: str, name: str, *place: str | int) -> None:
    if not digest.owned(owner, name):
        raise _unknown(*place)


def _unknown(*place: str | int) -> problems.ProblemError:
    where = problems.pointer((*place, "id"))
    return problems.invalid(where, "unknown_system", "there is no such system")
