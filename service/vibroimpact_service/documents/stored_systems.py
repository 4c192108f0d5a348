"""Systems stored by content under ``sys_<digest>``, and references to them in requests."""

from __future__ import annotations

from typing import Any, Final

import orjson
from pydantic import TypeAdapter

from vibroimpact_schema.service import StoredSystem
from vibroimpact_schema.systems import AnySystem, System, SystemReference
from vibroimpact_service import problems
from vibroimpact_service.documents import digest, limits, parse
from vibroimpact_service.documents.series import FIELD
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store
from vibroimpact_solvers.errors import ModelError

JSON: Final = "application/json"
MULTIPART: Final = "multipart/form-data"
MEDIA_TYPES: Final = (JSON, "application/x-matrix-market", "application/x-npy", MULTIPART)
"""Media types in which systems are accepted."""
_MOST_NAMES: Final = 100
"""Names of unused matrices that an answer lists."""
SYSTEM: Final[TypeAdapter[AnySystem | SystemReference]] = TypeAdapter(System)


def put(
    store: Store, settings: Settings, owner: str, content_type: str, body: bytes
) -> tuple[StoredSystem, bool]:
    """Store the system in a body of a content type; return it, and whether it is new.

    Raises
    ------
    ProblemError
        400, 413 or 422 with the field that is wrong.
    """
    # The numerical libraries and the readers of files load at the first system.
    from vibroimpact_service.documents import decode, upload

    unused = list[str]()
    if content_type == JSON:
        document = parse.document(SYSTEM, parse.json(body))
    else:
        document, unused = upload.system(content_type, body, settings)
    if isinstance(document, SystemReference):
        check_owner(owner, document)
        document = resolve(store, document)
    limits.check_system(document, settings)
    try:
        system = decode.system(document)
    except ModelError as error:
        raise problems.of(error) from None
    data = digest.canonical(document)
    name = f"sys_{digest.name(owner, 'system', '', data)}"
    new = not store.systems.readable(name)
    if new:
        store.systems.put(name, data)
    stored = StoredSystem(
        id=name, n=system.n, constraints=len(system.constraints), unused=unused[:_MOST_NAMES]
    )
    return stored, new


def resolve(store: Store, reference: SystemReference, *where: str) -> AnySystem:
    """Return the stored system of a reference, with what the reference has of its own.

    `where` is the path from the body to the reference.

    Raises
    ------
    ProblemError
        422 where no system of that name is stored, or it has another damping beside.
    """
    data = store.systems.get(reference.id)
    if data is None:
        raise _unknown(*where)
    system = parse.document(SYSTEM, orjson.loads(data))
    assert not isinstance(system, SystemReference)
    own = {name: getattr(reference, name) for name in ("constraints", "damping", FIELD)}
    other = next((name for name in ("C", "zeta") if getattr(system, name, None)), None)
    if own["damping"] is not None and other is not None:
        raise problems.invalid(
            problems.pointer((*where, "damping")), "two_dampings", f"the stored system has {other}"
        )
    update: dict[str, Any] = {name: x for name, x in own.items() if x is not None}
    if "constraints" in update:
        update.setdefault(FIELD, None)  # it is that of the stored constraints
    return system.model_copy(update=update)


def check_owner(owner: str, reference: SystemReference, *where: str) -> None:
    """Refuse a reference to somebody else's system, as if it did not exist.

    Raises
    ------
    ProblemError
        422 with the place of the name; `where` is the path from the body to the reference.
    """
    if not digest.owned(owner, reference.id):
        raise _unknown(*where)


def _unknown(*where: str) -> problems.ProblemError:
    pointer = problems.pointer((*where, "id"))
    return problems.invalid(pointer, "unknown_system", "there is no such system")
