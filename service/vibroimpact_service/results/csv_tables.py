"""Tables of a result as CSV (RFC 4180): what has the same first dimensions stands in one row."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from vibroimpact_service import problems
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.results.container import Array
from vibroimpact_service.results.encode import Content

TABLE: Final = (
    "Of answers as text/csv: a group of columns such as impacts, a dimension such as frequency, or "
    "several with commas between; absent: the first dimension."
)
"""What the table of a request means, for the contract."""


def to_csv(content: Content, table: str) -> bytes:
    """Return a table of a result, with the names of its columns in the first line.

    Columns are named by their places in documents, with points, and without the name of the
    table; those of arrays with further axes have their indices in brackets. Numbers read back to
    the bit, what is not a number is empty, and codes are words.

    Parameters
    ----------
    content : Content
    table : str
        A group of columns, such as ``impacts``; a dimension, such as ``frequency``, or several
        with commas between, whose rows are all combinations; empty: the first dimension, of
        sweeps the axes.

    Raises
    ------
    ProblemError
        400 where there is no such table.
    """
    dims = _dims(content, table)
    sizes = _sizes(content, dims)
    names, columns = [], []
    for name, values in (*_indices(content, dims, sizes), *_columns(content, dims, table)):
        names.append(name)
        columns.append(values)
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(names)
    writer.writerows(zip(*columns, strict=True))
    return text.getvalue().encode()


def _dims(content: Content, table: str) -> tuple[str, ...]:
    """Return the dimensions of the rows of a table."""
    of_arrays = [content.meanings[name].dims for name in content.arrays]
    of_arrays = [dims for dims in of_arrays if dims]
    if not table:
        axes = [name for name in content.arrays if content.path(name).startswith("axes/")]
        return tuple(content.meanings[name].dims[0] for name in axes) or of_arrays[0][:1]
    wanted = tuple(part.strip() for part in table.split(","))
    if any(dims[: len(wanted)] == wanted for dims in of_arrays):
        return wanted
    for name in content.arrays:
        if content.path(name).startswith(f"{table}/") and content.meanings[name].dims:
            return content.meanings[name].dims[:1]
    groups = {content.path(name).partition("/")[0] for name in content.arrays}
    there = ", ".join(sorted(groups | {dims[0] for dims in of_arrays} - {"error"}))
    raise ProblemError(problems.BAD_REQUEST, f"There is no table {table!r}: ask for {there}.")


def _sizes(content: Content, dims: tuple[str, ...]) -> tuple[int, ...]:
    shapes = (
        values.shape
        for name, values in content.arrays.items()
        if content.meanings[name].dims[: len(dims)] == dims
    )
    return next(shapes)[: len(dims)]


def _indices(
    content: Content, dims: tuple[str, ...], sizes: tuple[int, ...]
) -> Iterator[tuple[str, list[Any]]]:
    """Yield what tells the rows apart: coordinates of several dimensions, or places along them."""
    for axis, dim in enumerate(dims):
        of_dim = [
            name
            for name in content.arrays
            if content.meanings[name].coordinate and content.meanings[name].dims == (dim,)
        ]
        if len(dims) == 1 and of_dim:
            continue  # it is a column anyway
        shape = [size if each == axis else 1 for each, size in enumerate(sizes)]
        along = content.arrays[of_dim[0]] if of_dim else np.arange(sizes[axis])
        name = content.path(of_dim[0]).replace("/", ".") if of_dim else dim
        yield name, np.broadcast_to(along.reshape(shape), sizes).ravel().tolist()


def _columns(
    content: Content, dims: tuple[str, ...], table: str
) -> Iterator[tuple[str, list[Any]]]:
    for name, values in content.arrays.items():
        meaning = content.meanings[name]
        if meaning.dims[: len(dims)] != dims:
            continue
        rows = int(np.prod(values.shape[: len(dims)]))
        parts = [part for part in content.path(name).split("/") if part != table]
        label = ".".join(parts)
        rest = values.shape[len(dims) :]
        each = values.reshape(rows, -1)
        for place in range(each.shape[1]):
            index = ",".join(map(str, np.unravel_index(place, rest))) if rest else ""
            words = meaning.flags if values.dtype != np.bool_ else ()
            yield f"{label}[{index}]" if rest else label, _cells(each[:, place], words)


def _cells(values: Array, words: tuple[str, ...]) -> list[Any]:
    """Return a column as it is written."""
    if words:
        return [words[code] for code in values.tolist()]
    if values.dtype == np.bool_:
        return ["true" if value else "false" for value in values.tolist()]
    if values.dtype.kind == "f":
        return ["" if value != value else repr(value) for value in values.tolist()]
    return list(values.tolist())
