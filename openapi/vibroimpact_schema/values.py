"""The plain values that documents are made of: finite numbers, indices, lists that fail fast."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A finite number; text, true and false are not numbers."""

Positive = Annotated[Number, Field(gt=0)]
NonNegative = Annotated[Number, Field(ge=0)]

LARGEST_INTEGER = 2**53 - 1
"""The largest integer that every JSON reader keeps exact."""

Index = Annotated[int, Field(strict=True, ge=0, le=LARGEST_INTEGER)]
"""Index of a degree of freedom or of a constraint, counted from 0."""

Count = Annotated[int, Field(strict=True, ge=1, le=LARGEST_INTEGER)]

# A list of a million wrong entries is one error, not a million.
Numbers = Annotated[list[Number], Field(fail_fast=True)]
Positives = Annotated[list[Positive], Field(fail_fast=True)]
Indices = Annotated[list[Index], Field(fail_fast=True)]

Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class Document(BaseModel):
    """Base of all documents: no unknown fields, no conversions, no inf or nan, no changes."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        hide_input_in_errors=True,
        validate_default=False,
    )


def form(value: Any, keys: Mapping[str, str], otherwise: str | None = None) -> str | None:
    """Return the tag of the form of a document, raw or validated, in a union of several forms.

    Pydantic names tags in the path of an error, where they are not part of the document; their
    sign @ makes them tell-tale.

    Parameters
    ----------
    value
        The document, or anything else: None is returned then.
    keys : mapping
        Key that only one form has -> the tag of this form.
    otherwise : str, optional
        Tag of the form that has none of these keys.
    """
    if isinstance(value, Document):
        present: Collection[str] = type(value).model_fields
    elif isinstance(value, dict):
        present = value
    else:
        return None
    for key, tag in keys.items():
        if key in present:
            return tag
    return otherwise
