"""What a result says in a few lines: the range of each output, and the largest of its errors."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibroimpact.result_file import ResultFile
from vibroimpact.tables import Table

_LARGEST = 4_000_000
"""Values up to which an output is read to be summarised."""
_MOST_WORDS = 4


def summary(result: ResultFile) -> str:
    """Return a line for each output of a result, with units, and what holds of the whole.

    Parameters
    ----------
    result : ResultFile
        Any result.
    """
    errors = result.error if "error" in result else {}
    lines = [f"{result.kind}, result {result.digest[:12]}"]
    names = [*result.axis_names(), *result.outputs()]
    lines += [_line(name, result, errors.get(name)) for name in names]
    lines += [
        f"  {name}: {rows} rows{_of_table(name, result, rows)}"
        for name, rows in result.row_counts().items()
    ]
    statement = errors.get("statement")
    lines += [f"  caution: {sentence}" for sentence in (*result.neglected, *result.cautions)]
    return "\n".join([*lines, *([f"  errors: {statement}"] if statement else [])])


def _line(name: str, result: ResultFile, error: Any) -> str:
    shape = result.size_of(name)
    unit = result.unit(name)
    size = " × ".join(map(str, shape)) or "1"
    head = f"  {name} ({size}{'' if unit == '1' else f', {unit}'})"
    if np.prod(shape) > _LARGEST:
        return head
    values = np.asarray(getattr(result, name))
    told = _told(values)
    worst = _worst(error)
    return f"{head}: {told}{'' if worst is None else f'; errors up to {worst:.2g}'}"


def _of_table(name: str, result: ResultFile, rows: int) -> str:
    """Return how many rows of a table are admissible and why others are not, or widths of bands."""
    if not 0 < rows <= _LARGEST:
        return ""
    table: Table = getattr(result, name)
    if "exists" in table:
        others = np.asarray(table.reason)[~table.exists] if "reason" in table else np.array([])
        why = f"; {_told(others)}" if others.size else ""
        return f", {int(np.count_nonzero(table.exists))} admissible{why}"
    if name in {"bands", "rejected"}:
        widths = table.stop - table.start
        unit = result.unit(f"{name}/start")
        head = f", together {np.nansum(widths):.4g}{'' if unit == '1' else f' {unit}'} wide"
        return f"{head}, the widest {np.nanmax(widths):.4g}"
    return ""


def _told(values: np.ndarray[Any, Any]) -> str:
    """Return a number, a range, or how many there are of each word."""
    if values.dtype == np.bool_:
        return f"{int(values.sum())} of {values.size} true"
    if values.dtype.kind not in "iuf":
        words, counts = np.unique(values.astype(str), return_counts=True)
        order = np.argsort(-counts)[:_MOST_WORDS]
        more = len(words) - len(order)
        said = ", ".join(f"{counts[i]} {words[i]}" for i in order)
        return said + (f" and {more} others" if more else "")
    finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values.ravel()
    if not finite.size:
        return "no value"
    low, high = finite.min(), finite.max()
    said = f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"
    left = values.size - finite.size
    return said + (f", {left} without a value" if left else "")


def _worst(error: Any) -> float | None:
    """Return the largest error that is known."""
    values = np.asarray(error if isinstance(error, np.ndarray | float | int) else np.nan)
    finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values.ravel()
    return float(finite.max()) if finite.size else None
