"""Media types of results.

To add one:

1. Write a module of this room with the function that makes bytes of a `Content`.
2. Add its row to `ENCODERS`.

Routes, their contract, `Accept`, and the store of representations follow from the row.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from vibroimpact_schema import entries
from vibroimpact_service.results import csv_tables, encode
from vibroimpact_service.results.encode import Content

JSON: Final = "application/json"
HDF5: Final = "application/x-hdf5"
CSV: Final = "text/csv"
ARRAYS: Final = entries.MEDIA_TYPE


class Parameter(NamedTuple):
    """A parameter of the query that says what of a result is asked for.

    It stands behind the media type, as ``text/csv;table=impacts``.
    """

    name: str
    about: str
    """For the contract."""


@dataclass(frozen=True, slots=True)
class Encoder:
    """How results are written in a media type.

    Parameters
    ----------
    suffix : str
        Ending of the names of files.
    encode : callable
        ``(content, value of the parameter) -> bytes``.
    parameter : Parameter, optional
    stored : bool
        Whether representations are stored; else they are made whenever they are asked for.
    convert : callable, optional
        ``(stored, offset, path)``: writes the file of a stored result piece by piece. Without it,
        large results are not sent in this media type.
    large : str
        Media type in which large results are sent instead; empty: they are refused.
    binary : bool
        Whether it is no text: saved as a file, and compressed already.
    """

    suffix: str
    encode: Callable[[Content, str], bytes]
    parameter: Parameter | None = None
    stored: bool = True
    convert: Callable[[Path, int, Path], None] | None = None
    large: str = ""
    binary: bool = False


def _to_hdf5(content: Content, _: str) -> bytes:
    from vibroimpact_service.results import hdf5  # its libraries load at the first use

    return hdf5.to_hdf5(content)


def _to_arrays(content: Content, _: str) -> bytes:
    from vibroimpact_service.results import hdf5

    return entries.pack(hdf5.entries(content))


def _convert_to_hdf5(stored: Path, offset: int, path: Path) -> None:
    from vibroimpact_service.results import hdf5

    hdf5.convert(stored, offset, path)


ENCODERS: Final[Mapping[str, Encoder]] = {
    JSON: Encoder("json", encode.to_json),
    HDF5: Encoder("h5", _to_hdf5, convert=_convert_to_hdf5, binary=True),
    CSV: Encoder("csv", csv_tables.to_csv, Parameter("table", csv_tables.TABLE), stored=False),
    ARRAYS: Encoder("arrays", _to_arrays, stored=False, large=HDF5, binary=True),
}
"""By media type; the first is that of answers to requests that name none."""

IN_FILES: Final = " or ".join(name for name, encoder in ENCODERS.items() if encoder.convert)
"""Media types of large results."""
