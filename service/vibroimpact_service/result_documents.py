"""The documents of results, made from the declared fields of the solvers' result classes."""

from __future__ import annotations

from typing import Any, Final, Literal

from pydantic import BaseModel, Field, create_model

from vibroimpact_schema.results import Result
from vibroimpact_schema.values import Document, Index
from vibroimpact_solvers.arrays import Field as Declared
from vibroimpact_solvers.arrays import Group, Quantity, declared


def document(kind: str, result: type[Any]) -> type[Result]:
    """Return the document of a kind's results, such as ImpactModesResult.

    It follows from the solver's class, whose fields are declared (`vibroimpact_solvers.arrays`).
    """
    fields = (field for field in declared(result).values() if field.path not in Result.model_fields)
    title = "".join(word.capitalize() for word in kind.split("-"))
    entries = _entries(tuple(result.GROUPS.items()), tuple(fields), "", title)
    head: dict[str, Any] = {"kind": (Literal[kind], ...)}
    return create_model(
        f"{title}Result",
        __base__=Result,
        __doc__=result.__doc__,
        __module__=__name__,
        **head,
        **entries,
    )


Groups = tuple[tuple[str, Group], ...]
"""Groups of fields by their paths, such as ``"error"`` and ``"error/impact"``."""


def _entries(
    groups: Groups, fields: tuple[Declared, ...], inside: str, kind: str, *, whole: bool = False
) -> dict[str, Any]:
    """Return types and defaults of what a document of a kind holds whose path is `inside`."""
    parts: dict[str, list[Declared]] = {}
    for field in fields:
        parts.setdefault(field.path[len(inside) :].partition("/")[0], []).append(field)
    known, entries = dict(groups), dict[str, Any]()
    for name, those in parts.items():
        group = known.get(inside + name)
        if group is not None and those[0].path != inside + name:
            within = tuple(pair for pair in groups if pair[0].startswith(f"{inside}{name}/"))
            entries[name] = _group(group, within, f"{inside}{name}/", tuple(those), kind)
        else:
            (field,) = those
            absent = not whole or field.quantity.sometimes
            entries[name] = _entry(field, field.optional and absent)
    return entries


def _group(
    group: Group, groups: Groups, inside: str, fields: tuple[Declared, ...], kind: str
) -> tuple[Any, Any]:
    """Return type and default of a group: a document, or a list of documents.

    Where none of its fields is always there, it is absent as a whole.
    """
    optional = all(field.optional for field in fields)
    whole = optional and group.together
    # Kinds that have the same group share its document, and their name; it has no other.
    key = group, groups, inside, fields, whole
    if key not in _documents:
        taken = {made.__name__ for made in _documents.values()}
        name = f"{kind}{group.name}" if group.name in taken else group.name
        _documents[key] = create_model(
            name,
            __base__=Document,
            __doc__=group.about,
            __module__=__name__,
            **_entries(groups, fields, inside, kind, whole=whole),
        )
    inner: Any = _documents[key]
    if fields[0].quantity.record:
        inner = list[inner]
    return (inner | None, None) if optional else (inner, ...)


_documents: Final[dict[tuple[Any, ...], type[BaseModel]]] = {}
"""Documents of groups, by all that they depend on."""


def _entry(field: Declared, optional: bool) -> tuple[Any, Any]:
    """Return type and description of a field of a document."""
    kind: Any = _element(field)
    # Texts along an axis are a list by themselves.
    for _ in field.quantity.dims[field.quantity.record :] if kind != list[str] else ():
        kind = list[kind]
    text = description(field.quantity)
    if optional:
        return kind | None, Field(None, description=text)
    return kind, Field(description=text)


def _element(field: Declared) -> Any:
    quantity, kind = field.quantity, field.scalar
    if quantity.flags and kind is int:
        kind = Literal[quantity.flags]
    elif quantity.integers:
        kind = Literal[quantity.integers]
    elif kind is int and quantity.integers is None:
        kind = Index
    return kind | None if quantity.missing else kind


def description(quantity: Quantity) -> str:
    """Return a sentence about a field: name, dimensions, unit, and what else is to be known."""
    dims = f" [{', '.join(quantity.dims)}]" if quantity.dims and not quantity.record else ""
    text = quantity.long_name[0].upper() + quantity.long_name[1:] + dims
    if unit := formula(quantity.unit):
        text += f", {unit}"
    notes = [quantity.note, f"null: {quantity.missing}" if quantity.missing else ""]
    return "; ".join([text, *filter(None, notes)]) + "."


_POWERS: Final = str.maketrans({"-": "", "1": "", "2": "²", "3": "³", "4": "⁴"})


def formula(unit: str) -> str:
    """Return a unit such as "mass length2 time-2" as it is written: mass length² / time²."""
    above: list[str] = []
    below: list[str] = []
    for factor in unit.split():
        root = "√" if factor.endswith("0.5") else ""
        (below if "-" in factor else above).append(
            root + factor.removesuffix("0.5").translate(_POWERS)
        )
    if not below:
        return " ".join(above)
    return f"{' '.join(above) or '1'}{' / ' if above else '/'}{' '.join(below)}"
