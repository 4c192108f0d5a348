"""Arrays that grow in files, row by row, so that none of them is ever in memory as a whole."""

from __future__ import annotations

import shutil
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import numpy as np
from numpy.typing import NDArray


@dataclass(slots=True)
class Spooled:
    """An array in a file of its own.

    Parameters
    ----------
    path : Path
        C order, without any header.
    dtype : dtype
    shape : tuple of int
    """

    path: Path
    dtype: np.dtype[Any]
    shape: tuple[int, ...]

    @property
    def nbytes(self) -> int:
        """Size of the array."""
        return self.dtype.itemsize * int(np.prod(self.shape, dtype=np.int64))

    def copy_into(self, file: IO[bytes]) -> None:
        """Write the array into another file."""
        with self.path.open("rb") as mine:
            shutil.copyfileobj(mine, file, 2**20)


class Spool:
    """Files of arrays in a folder.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._open = folder, ExitStack()
        self._files: dict[str, IO[bytes]] = {}
        self.arrays: dict[str, Spooled] = {}

    def append(self, name: str, rows: NDArray[Any]) -> None:
        """Take the next rows of an array."""
        found = self.arrays.get(name)
        if found is None:
            path = self._folder / f"{name}-rows"
            self._files[name] = self._open.enter_context(path.open("w+b"))
            found = self.arrays[name] = Spooled(path, rows.dtype, (0, *rows.shape[1:]))
        if rows.dtype != found.dtype or rows.shape[1:] != found.shape[1:]:
            raise ValueError(f"rows of {name} differ in kind from those before")
        self._files[name].write(np.ascontiguousarray(rows).tobytes())
        found.shape = (found.shape[0] + rows.shape[0], *found.shape[1:])

    def patch(self, name: str, row: int, value: float) -> None:
        """Replace a number of a row that was taken before, of an array with one axis."""
        found, file = self.arrays[name], self._files[name]
        if not 0 <= row < found.shape[0]:
            raise IndexError(f"{name} has {found.shape[0]} rows, not one numbered {row}")
        file.seek(row * found.dtype.itemsize)
        file.write(np.array(value, dtype=found.dtype).tobytes())
        file.seek(0, 2)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the files, which then hold everything."""
        self._open.close()
