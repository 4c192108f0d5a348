"""The reader of each format, by how the names of its files end.

==============================  ==================================================================
``.mtx``                        Matrix Market, or Abaqus ``*MATRIX GENERATE`` in any of its formats
``.sti``, ``.mas``              CalculiX, with the labels of the ``.dof`` file beside
``.matrix``, ``.hb``, ``.rb``,  Harwell-Boeing and Rutherford-Boeing; ``.matrix`` of ANSYS HBMAT
``.rsa``, ``.rua``              with the labels of the ``.mapping`` file beside
``.op4``                        Nastran OUTPUT4, formatted or binary
``.bdf``, ``.dat``, ``.nas``,   Nastran DMIG: nodes and directions are kept
``.pch``
``.npz``, ``.npy``              of `scipy.sparse.save_npz`, `numpy.savez` or `numpy.save`
``.csv``, ``.txt``              all rows as text, or entries ``row, column, value``
==============================  ==================================================================

All may be compressed: ``K.mtx.gz``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from vibroimpact_schema.files import (
    array_files,
    file_bytes,
    harwell_boeing,
    nastran,
    output4,
    text_files,
)
from vibroimpact_schema.files.bounds import LOCAL, Bounds
from vibroimpact_schema.files.labels import Content

Reader = Callable[[bytes, Bounds], Content]
READERS: Final[Mapping[str, Reader]] = {
    ".npz": array_files.npz,
    ".npy": array_files.npy,
    ".mtx": text_files.market_or_list,
    **dict.fromkeys((".sti", ".mas"), text_files.triangle),
    **dict.fromkeys((".matrix", ".hb", ".rb", ".rsa", ".rua"), harwell_boeing.matrix),
    **dict.fromkeys((".csv", ".txt"), text_files.rows),
    ".op4": output4.output4,
    **dict.fromkeys((".bdf", ".dat", ".nas", ".pch"), nastran.dmig),
}


def reader_of(name: str, known: Mapping[str, Reader] = READERS) -> Reader:
    """Return the reader of a file, by the ending of its name.

    Raises
    ------
    ValueError
        Where the ending is none of those known.
    """
    reader = known.get(file_bytes.suffix(name))
    if reader is None:
        raise ValueError(f"known are files ending in {', '.join(known)}")
    return reader


def read(
    name: str, data: bytes, bounds: Bounds = LOCAL, known: Mapping[str, Reader] = READERS
) -> Content:
    """Return the matrices of a file.

    Parameters
    ----------
    name : str
        Its name, whose ending tells the format.
    data : bytes
    bounds : Bounds
    known : mapping, optional
        Ending -> reader.

    Raises
    ------
    TooLargeError
        If it has more than the bounds allow.
    ValueError
        If its format is not known, or it has another, with the line or the byte at fault.
    """
    return reader_of(name, known)(file_bytes.unpacked(name, data, bounds), bounds)
