"""Arrays that grow in files, row by row, so that no array is ever in memory as a whole."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray


@dataclass(slots=True)
class RowFile:
    """An array in a file of its own, in C order and without any header."""

    path: Path
    dtype: np.dtype[Any]
    shape: tuple[int, ...]

    @property
    def nbytes(self) -> int:
        """Size of the array."""
        return self.dtype.itemsize * int(np.prod(self.shape, dtype=np.int64))

    def blocks(self) -> Iterator[bytes]:
        """Yield its bytes, a mebibyte at a time."""
        with self.path.open("rb") as file:
            yield from iter(lambda: file.read(2**20), b"")


class RowFiles:
    """Files of arrays in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._open = folder, ExitStack()
        self._files: dict[str, IO[bytes]] = {}
        self.arrays: dict[str, RowFile] = {}

    def append(self, name: str, rows: NDArray[Any]) -> None:
        """Append rows to an array."""
        array = self.arrays.get(name)
        if array is None:
            path = self._folder / f"{name}-rows"
            self._files[name] = self._open.enter_context(path.open("w+b"))
            array = self.arrays[name] = RowFile(path, rows.dtype, (0, *rows.shape[1:]))
        if rows.dtype != array.dtype or rows.shape[1:] != array.shape[1:]:
            raise ValueError(f"rows of {name} differ in type or size from those before")
        self._files[name].write(np.ascontiguousarray(rows).tobytes())
        array.shape = (array.shape[0] + rows.shape[0], *array.shape[1:])

    def patch(self, name: str, row: int, value: float) -> None:
        """Replace a number of an array with one axis."""
        array, file = self.arrays[name], self._files[name]
        if not 0 <= row < array.shape[0]:
            raise IndexError(f"{name} has {array.shape[0]} rows, not one numbered {row}")
        file.seek(row * array.dtype.itemsize)
        file.write(np.array(value, dtype=array.dtype).tobytes())
        file.seek(0, 2)

    def close(self) -> None:
        """Close the files, which can be read then."""
        self._open.close()
