"""Unknowns and measurements of calibrations, as documents have them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vibroimpact.arguments import number
from vibroimpact.plain import plain
from vibroimpact_schema.imaginary import real


def unknowns(given: Any) -> list[dict[str, Any]]:
    """Return the documents of unknowns.

    Parameters
    ----------
    given : mapping or sequence of dict
        Path -> start, (start, lower, upper) or a dictionary without the path; or the documents.

    Raises
    ------
    ValueError
        Where a tuple has another length.
    """
    if not isinstance(given, Mapping):
        return [dict(plain(each)) for each in given]
    return [{"path": path, **_unknown(path, each)} for path, each in given.items()]


def _unknown(path: str, given: Any) -> dict[str, Any]:
    if isinstance(given, Mapping):
        return dict(plain(given))
    if not isinstance(given, Sequence | np.ndarray):
        return {"start": number(path, given)}
    if len(given) != 3:
        raise ValueError(f"{path}: give its start, or start, lower and upper, not {given!r}")
    names = ("start", "lower", "upper")
    return {
        name: number(f"{path} ({name})", value)
        for name, value in zip(names, given, strict=True)
        if value is not None
    }


def measured(given: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the documents of measurements; nan stands for what was not measured.

    Parameters
    ----------
    given : sequence of dict
        Each with output, values, sigma and, of histories, t; values are arrays or lists.
    """
    documents = []
    for each in given:
        document = dict(each)
        if "values" in document:
            document["values"] = _with_nulls(document["values"])
        documents.append(dict(plain(document)))
    return documents


def _with_nulls(given: Any) -> Any:
    """Return values as nested lists with None for nan."""
    values = np.asarray(real("values", given), dtype=np.float64)
    nested = values.astype(object)
    nested[np.isnan(values)] = None
    return nested.tolist()
