"""The rows of all tables as compressed lines of JSON, the same for every database.

The first line of each table is an object that names it and its columns; each of its rows is an
array.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import IO, Any, Final

import sqlalchemy as sa
import zstandard
from sqlalchemy.engine import Connection

from vibroimpact_service.access import records, shared_results
from vibroimpact_service.jobs import tables
from vibroimpact_service.store import private

NAMES: Final = [
    *(name for name in tables.metadata.tables if name != tables.processes.name),
    *(name for name in records.metadata.tables if name != shared_results.shares.name),
    shared_results.shares.name,
]
"""Tables that are part of a backup; that of running processes is none."""
_ROWS: Final = 1000


class RowsDamagedError(ValueError):
    """A file of rows does not have the form that `write` gives it."""


def write(connection: Connection, path: Path) -> dict[str, int]:
    """Write the rows of all tables that a database has to a new file.

    Parameters
    ----------
    connection : Connection
        In a transaction that sees one state of the database.
    path : Path

    Returns
    -------
    dict
        Name of a table -> number of its rows.
    """
    counts = {}
    with (
        open(path, "wb", opener=private.opener) as file,
        zstandard.ZstdCompressor().stream_writer(file) as lines,
    ):
        for table in _present(connection):
            columns = list(table.columns)
            binary = [c.name for c in columns if isinstance(c.type, sa.LargeBinary)]
            head = {"table": table.name, "columns": [c.name for c in columns], "binary": binary}
            lines.write(_line(head))
            counts[table.name] = 0
            query = sa.select(table).order_by(*table.primary_key.columns)
            for row in connection.execute(query, execution_options={"yield_per": _ROWS}):
                lines.write(_line([_text(value) for value in row]))
                counts[table.name] += 1
    return counts


def read(connection: Connection, path: Path) -> dict[str, int]:
    """Insert the rows of a file into the tables of a database, which are empty; count as `write`.

    Raises
    ------
    RowsDamagedError
        Where the file does not have the right form.
    """
    counts = {}
    present = {table.name: table for table in _present(connection)}
    for name, columns, rows in _tables(path):
        if name not in present:
            raise RowsDamagedError(f"there is no table {name}")
        counts[name] = 0
        while some := list(islice(rows, _ROWS)):
            values = [dict(zip(columns, row, strict=True)) for row in some]
            connection.execute(present[name].insert(), values)
            counts[name] += len(some)
        if connection.dialect.name == "postgresql" and "seq" in columns:
            # Numbers that were given do not move the sequence from which new ones are taken.
            connection.execute(
                sa.text(
                    f"SELECT setval(pg_get_serial_sequence('{name}', 'seq'), max(seq)) FROM {name}"
                )
            )
    return counts


def _present(connection: Connection) -> list[sa.Table]:
    """Return the tables as a database has them: of whichever revision it is."""
    there = set(sa.inspect(connection).get_table_names())
    present = []
    for name in NAMES:
        if name in there:
            table = sa.Table(name, sa.MetaData(), autoload_with=connection)
            for column in table.columns:
                if isinstance(column.type, sa.JSON):
                    column.type = sa.JSON(none_as_null=True)
            present.append(table)
    return present


def _tables(path: Path) -> Iterator[tuple[str, Sequence[str], Iterator[list[Any]]]]:
    """Yield the tables of a file; the rows of one must be taken before the next."""
    with path.open("rb") as file, zstandard.ZstdDecompressor().stream_reader(file) as reader:
        documents = _documents(reader)
        head = next(documents, None)
        while head is not None:
            following: list[dict[str, Any]] = []
            yield head["table"], head["columns"], _rows(documents, head, following)
            head = following[0] if following else None


def _rows(
    documents: Iterator[Any], head: dict[str, Any], following: list[dict[str, Any]]
) -> Iterator[list[Any]]:
    """Yield the rows below a head, up to the next one, which is put into a list."""
    binary = [name in head["binary"] for name in head["columns"]]
    for document in documents:
        if isinstance(document, dict):
            following.append(document)
            return
        yield [
            base64.b64decode(value) if is_bytes and value is not None else value
            for value, is_bytes in zip(document, binary, strict=True)
        ]


def _documents(reader: IO[bytes]) -> Iterator[Any]:
    rest = b""
    try:
        while piece := reader.read(2**20):
            *lines, rest = (rest + piece).split(b"\n")
            yield from map(json.loads, lines)
    except (zstandard.ZstdError, json.JSONDecodeError) as error:
        raise RowsDamagedError(str(error)) from error
    if rest:
        raise RowsDamagedError("it ends within a line")


def _line(content: Any) -> bytes:
    # Python's own module writes every float so that it is read again as the same number.
    return json.dumps(content, separators=(",", ":")).encode() + b"\n"


def _text(value: Any) -> Any:
    return base64.b64encode(value).decode() if isinstance(value, bytes | memoryview) else value
