"""What a file may have at most, so that reading it ends soon and in little memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


class TooLargeError(ValueError):
    """A file has more than is read."""


class TooManyRowsError(TooLargeError):
    """A matrix has more rows than are read."""


@dataclass(frozen=True)
class Bounds:
    """The most that is read of a file.

    Parameters
    ----------
    size : int
        Bytes, unpacked: of a file that ends in ``.gz``, and of all parts of an archive together.
    lines : int
        Lines of the formats that are read line by line: OUTPUT4, DMIG, Harwell-Boeing, labels.
    rows : int
        Rows of a matrix.
    """

    size: int = 4 << 30
    lines: int = 1 << 31
    rows: int = 2**31 - 1

    def check_size(self, size: int) -> None:
        """Refuse that many bytes.

        Raises
        ------
        TooLargeError
            If they are more than `size`.
        """
        if size > self.size:
            most = f"{self.size >> 30} GiB" if self.size >= 1 << 30 else f"{self.size} bytes"
            raise TooLargeError(f"unpacked it is larger than {most}")

    def check_lines(self, count: int) -> None:
        """Refuse that many lines.

        Raises
        ------
        TooLargeError
            If they are more than `lines`.
        """
        if count > self.lines:
            raise TooLargeError(f"{count} lines are more than {self.lines}")

    def check_rows(self, rows: int) -> None:
        """Refuse a matrix of that many rows.

        Raises
        ------
        TooManyRowsError
            If they are more than `rows`.
        """
        if rows > self.rows:
            raise TooManyRowsError(f"a matrix of {rows} rows; at most {self.rows} are read")


LOCAL: Final = Bounds()
"""What the user's own machine reads: 50 million entries as text."""
MOST_MATRICES: Final = 1000
"""Matrices of one file; programs write some ten."""


def check_count(matrices: int) -> None:
    """Refuse a file of that many matrices.

    Raises
    ------
    TooLargeError
        If they are more than `MOST_MATRICES`.
    """
    if matrices > MOST_MATRICES:
        raise TooLargeError(f"there are more than {MOST_MATRICES} matrices")
