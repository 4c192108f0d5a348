"""A result as stored bytes and as JSON.

Dimensions, units and names travel with the arrays, so that any later version can write a stored
result in either representation.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import orjson

from vibroimpact_service.results import container
from vibroimpact_service.results.container import Array
from vibroimpact_service.results.rows import RowFiles
from vibroimpact_solvers.arrays import Described, Quantity, declared

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Content:
    """The content of a result, ready to be stored or sent.

    Parameters
    ----------
    arrays : mapping
        Field of the result -> values.
    meanings : mapping
        Field of the result -> its declaration.
    plain : mapping
        The numbers and texts, such as the error statement.
    head : mapping
        Kind, digest, request, plan, provenance and units.
    free : bool
        Whether the dimensions are those of this result alone, not of its kind.
    """

    arrays: Mapping[str, Array]
    meanings: Mapping[str, Quantity]
    plain: Mapping[str, Any]
    head: Mapping[str, Any]
    free: bool = False

    @property
    def nbytes(self) -> int:
        """Size of the arrays."""
        return sum(values.nbytes for values in self.arrays.values())

    def path(self, name: str) -> str:
        """Return the place of a field in documents and files."""
        return self.meanings[name].path or name if name in self.meanings else name


def describe(result: Any, head: Mapping[str, Any]) -> Content:
    """Return the content of a result, without the fields that are None."""
    if isinstance(result, Described):
        return Content(result.arrays, result.meanings, result.plain, head, free=True)
    fields = declared(type(result))
    arrays, plain = {}, {}
    for field in dataclasses.fields(result):
        value = getattr(result, field.name)
        if value is None:
            continue
        if isinstance(value, np.ndarray):
            arrays[field.name] = np.asarray(value, order="C")
        else:
            plain[field.name] = value
    meanings = {n: fields[n].quantity for n in (*arrays, *plain) if n in fields}
    return Content(arrays, meanings, plain, head)


def to_result(content: Content, result: type[Result]) -> Result:
    """Return the result, of a class such as a solver's `Result`, that has this content."""
    if issubclass(result, Described):
        return result(content.arrays, content.meanings, content.plain)
    absent = dict.fromkeys((f.name for f in dataclasses.fields(result)), None)  # type: ignore[arg-type]
    return result(**{**absent, **content.arrays, **content.plain})


# -- stored --------------------------------------------------------------------------------


def pack(content: Content) -> bytes:
    """Return the bytes in which a result is stored."""
    meta = _meta(content.head, content.plain, content.meanings)
    return container.pack(content.arrays, {**meta, "free": True} if content.free else meta)


def pack_rows(
    result: type[Any], rows: RowFiles, plain: Mapping[str, Any], head: Mapping[str, Any], path: Path
) -> None:
    """Write the bytes that `pack` returns to a file, of a result whose arrays are in files.

    Parameters
    ----------
    result : type
        Class of the result.
    rows : RowFiles
        Its arrays, by the names of its fields.
    plain, head : mapping
        As in `Content`, None for fields without a value.
    path : Path
    """
    fields = declared(result)
    arrays = {name: rows.arrays[name] for name in fields if name in rows.arrays}
    plain = {name: plain[name] for name in fields if plain.get(name) is not None}
    meanings = {name: fields[name].quantity for name in (*arrays, *plain)}
    with path.open("wb") as file:
        container.write(file, arrays, _meta(head, plain, meanings))


def _meta(
    head: Mapping[str, Any], plain: Mapping[str, Any], meanings: Mapping[str, Quantity]
) -> dict[str, Any]:
    described = {name: _as_dict(meaning) for name, meaning in meanings.items()}
    return {"head": head, "plain": plain, "meanings": described}


_OF_DOCUMENTS: Final = {"note", "missing", "error", "integers"}
"""What only the documents say of a quantity; the rest is stored, and files are written from it."""
_STORED: Final = tuple(
    field.name for field in dataclasses.fields(Quantity) if field.name not in _OF_DOCUMENTS
)


@lru_cache(maxsize=1024)
def _as_dict(meaning: Quantity) -> dict[str, Any]:
    return {name: getattr(meaning, name) for name in _STORED}


def unpack(data: bytes) -> Content:
    """Return the content of a stored result.

    Raises
    ------
    DamagedContainerError
        Where the bytes are not what `pack` returned.
    """
    return _content(*container.unpack(data))


def unpack_file(path: Path, offset: int) -> Content:
    """Return the content of a result stored in a file, reading each array when it is used."""
    return _content(*container.open_file(path, offset))


def _content(arrays: dict[str, Array], meta: dict[str, Any]) -> Content:
    meanings = {
        name: Quantity(
            **{**meaning, "dims": tuple(meaning["dims"]), "flags": tuple(meaning["flags"])}
        )
        for name, meaning in meta["meanings"].items()
    }
    free = meta.get("free", False)
    if not free:
        # Results of 0.1.0 come without the declarations of their numbers and texts.
        for name in meta["plain"]:
            undeclared = Quantity((), "1", name, path=name.replace("_", "/", 1))
            meanings.setdefault(name, undeclared)
    return Content(arrays, meanings, meta["plain"], meta["head"], free)


# -- JSON ----------------------------------------------------------------------------------


def to_json(content: Content, _: str = "") -> bytes:
    """Return the result document; floats as their shortest text, which reads back to the bit."""
    head = content.head
    document: dict[str, Any] = {"kind": head["kind"], "digest": head["digest"]}
    for name in ("neglected", "cautions"):  # before the numbers, where readers see them
        if name in content.plain:
            document[name] = content.plain[name]
    tables: dict[str, dict[str, Any]] = {}
    for name, values in content.arrays.items():
        meaning = content.meanings[name]
        if meaning.record:
            table, _, column = meaning.path.partition("/")
            tables.setdefault(table, {})[column] = _json_values(values, meaning)
        else:
            _place(document, content.path(name), _json_values(values, meaning))
    for table, columns in tables.items():
        rows = zip(*columns.values(), strict=True)
        document[table] = [dict(zip(columns, row, strict=True)) for row in rows]
    for name, value in content.plain.items():
        _place(document, content.path(name), value)
    if content.free:
        document["dimensions"] = {name: m.dims for name, m in content.meanings.items()}
    document["plan"] = head["plan"]
    document["provenance"] = head["provenance"]
    return orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY)


def _json_values(values: Array, meaning: Quantity) -> Any:
    if values.ndim == 0:
        return values.item()
    if meaning.flags and values.dtype != np.bool_:
        return np.array(meaning.flags, dtype=object)[values].tolist()
    return values


def _place(document: dict[str, Any], path: str, value: Any) -> None:
    *groups, name = path.split("/")
    for group in groups:
        document = document.setdefault(group, {})
    document[name] = value
