"""Names by content: the canonical form of a request and the digest of its result."""

from __future__ import annotations

import hashlib
import importlib.util
from functools import cache, lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import orjson
from pydantic import BaseModel

SOLVER_VERSION: Final = version("vibroimpact")

_TAG: Final = 16
_SOURCES: Final = (
    "vibroimpact_solvers",
    "vibroimpact_service.documents.branch_paths",
    "vibroimpact_service.documents.damped",
    "vibroimpact_service.documents.decode",
    "vibroimpact_service.documents.derivative_motions",
    "vibroimpact_service.documents.derivative_paths",
    "vibroimpact_service.documents.grid_values",
    "vibroimpact_service.documents.initial_states",
    "vibroimpact_service.documents.loads",
    "vibroimpact_service.documents.sweep_axes",
    "vibroimpact_service.documents.sweep_names",
    "vibroimpact_service.documents.varying",
)
"""Packages and modules on which the numbers of results depend."""


def canonical(document: BaseModel) -> bytes:
    """Return the canonical bytes of a document: sorted keys, floats by their shortest exact text.

    Requests that differ in the last bit of one number have different canonical forms.
    """
    return dumps(document.model_dump(exclude_none=True))


def dumps(content: Any) -> bytes:
    """Return the canonical bytes of plain JSON content of finite numbers."""
    return orjson.dumps(content, option=orjson.OPT_SORT_KEYS)


@cache
def solver_name() -> str:
    """Return what makes results differ beside the request: version and sources of the solvers."""
    text = hashlib.sha256()
    for package in _SOURCES:
        spec = importlib.util.find_spec(package)
        assert spec is not None
        assert spec.origin is not None
        file = Path(spec.origin)
        for source in sorted(file.parent.rglob("*.py")) if file.stem == "__init__" else [file]:
            text.update(source.read_bytes())
    return f"{SOLVER_VERSION}+{text.hexdigest()[:16]}"


def name(owner: str, kind: str, version: str, request: bytes) -> str:
    """Return the name of a result: 64 hexadecimal digits, of which the last 16 name the owner.

    The owner is part of it: a hit in someone else's results would reveal their request. By
    the last digits `owned` tells, without a look at any record, whose a result is.
    """
    text = hashlib.sha256()
    for part in (owner.encode(), kind.encode(), version.encode(), request):
        text.update(len(part).to_bytes(8, "little"))
        text.update(part)
    return text.hexdigest()[:-_TAG] + _tag(owner)


def owned(owner: str, name: str) -> bool:
    """Whether something of that name belongs to an owner."""
    return name.endswith(_tag(owner))


@lru_cache(maxsize=1024)
def _tag(owner: str) -> str:
    return hashlib.sha256(b"owner:" + owner.encode()).hexdigest()[:_TAG]


def content(data: bytes) -> str:
    """Return the SHA-256 of some bytes, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()
