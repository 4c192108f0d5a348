"""Problems of documents that do not fit their model, in words that never quote the input."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from vibroimpact_schema.problems import Fault
from vibroimpact_service.problems import INVALID, ProblemError, pointer

_MOST_FAULTS: Final = 20
_LONGEST_NAME: Final = 64
_UNKNOWN: Final = {
    "derivatives": "this kind has no derivatives: natural frequencies, impact modes and time "
    "histories have them"
}
"""What is said of fields that only some kinds have."""
_SELECTING: Final = ("kind", "law", "preset")
"""Fields whose values select one of several models."""


def problem_of(error: ValidationError, document: Any, *prefix: str) -> ProblemError:
    """Return the problem of a document that does not fit its model.

    Parameters
    ----------
    error : ValidationError
        pydantic's error.
    document : object
        The validated content; only its structure is used, to tell the parts of an error's
        path that lie in it from those that name a branch of a union.
    prefix : str
        Path from the body to the document.
    """
    errors = [
        item
        for item in error.errors(include_url=False, include_input=False)
        # Another field is wrong, so that the default of one that was not sent is not known.
        if item["type"] != "default_factory_not_called"
    ]
    faults = [
        Fault(
            pointer=pointer((*prefix, *_place(item["loc"], document), *_tag(item))),
            code=_CODES.get(item["type"], item["type"]),
            message=_UNKNOWN.get(str(item["loc"][-1]), "there is no such field")
            if item["type"] == "extra_forbidden"
            else sentence(item["type"], item["msg"], item.get("ctx", {})),
        )
        for item in errors[:_MOST_FAULTS]
    ]
    first = faults[0]
    detail = f"{first.pointer}: {first.message}" if first.pointer else first.message
    if len(errors) > 1:
        others = len(errors) - 1
        detail += f" (and {others} more error{'s' if others > 1 else ''}, see errors)"
    return ProblemError(INVALID, detail, faults)


_CODES: Final = {
    "missing": "missing",
    "extra_forbidden": "unknown_field",
    "finite_number": "not_finite",
    "float_type": "wrong_type",
    "int_type": "wrong_type",
    "bool_type": "wrong_type",
    "string_type": "wrong_type",
    "string_unicode": "wrong_type",
    "list_type": "wrong_type",
    "dict_type": "wrong_type",
    "model_type": "wrong_type",
    "greater_than": "out_of_range",
    "greater_than_equal": "out_of_range",
    "less_than": "out_of_range",
    "less_than_equal": "out_of_range",
    "too_short": "too_short",
    "too_long": "too_long",
    "string_too_long": "too_long",
    "string_pattern_mismatch": "wrong_format",
    "literal_error": "unknown_choice",
    "union_tag_invalid": "unknown_choice",
    "union_tag_not_found": "missing",
}


def sentence(kind: str, message: str, context: Mapping[str, Any]) -> str:
    """Return pydantic's message, or one of ours where its own quotes the input or is obscure."""
    if kind == "union_tag_invalid":
        return f"must be one of {context['expected_tags']}"
    if kind == "extra_forbidden":
        return "there is no such field"
    if kind == "missing":
        return "this field is required"
    if kind == "model_type":
        return "must be an object"
    if kind == "too_short":
        least = context["min_length"]
        return "must not be empty" if least == 1 else f"needs at least {least} items"
    if kind == "string_pattern_mismatch" and context["pattern"].startswith("^https://"):
        return "must be an address that begins with https://"
    return message.replace("Input should be", "must be")


def _place(path: Sequence[str | int], document: Any) -> list[str | int]:
    """Return the parts of an error's path that lie in the document."""
    here, place = document, []
    for part in path:
        inside = (isinstance(here, dict) and part in here) or (
            isinstance(here, list) and isinstance(part, int) and part < len(here)
        )
        if inside:
            here = here[part]
        elif part == "[key]" or _is_branch(part, here):
            continue
        place.append(part if isinstance(part, int) else _shown(part))
    return place


def _is_branch(part: str | int, here: Any) -> bool:
    """Whether a part of an error's path names a branch of a union."""
    if isinstance(here, dict) and part in [here.get(name) for name in _SELECTING]:
        return True
    return isinstance(part, str) and part.startswith("@")


def _tag(item: ErrorDetails) -> tuple[str, ...]:
    """Return the field that should select one of several kinds of documents."""
    if item["type"] not in {"union_tag_invalid", "union_tag_not_found"}:
        return ()
    return (item["ctx"]["discriminator"].strip("'"),)


def _shown(name: str) -> str:
    """Return a field name as it may be shown: short and printable."""
    cut = name if len(name) <= _LONGEST_NAME else name[:_LONGEST_NAME] + "…"
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in cut)
