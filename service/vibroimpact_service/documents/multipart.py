"""The parts of a multipart/form-data body (RFC 7578), as slices of the bytes that were received.

The library parses; nothing is written to disk, and no part is longer than the body, whose length
is limited where it is received.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from vibroimpact_service import problems
from vibroimpact_service.problems import ProblemError

_MOST_PARTS: Final = 32
_LONGEST_NAME: Final = 255
"""Characters of the name of a file, as file systems have them."""


@dataclass(frozen=True)
class Part:
    """A part of a body.

    Parameters
    ----------
    name : str
        Of the field.
    filename : str
        Of the file, without folders.
    data : bytes
    """

    name: str
    filename: str
    data: bytes


def parts(content_type: str, body: bytes) -> list[Part]:
    """Return the parts of a body.

    Parameters
    ----------
    content_type : str
        The header Content-Type, which has the boundary.
    body : bytes

    Raises
    ------
    ProblemError
        400 where it is no such body, 413 where it has too many parts.
    """
    _, options = parse_options_header(content_type)
    boundary = options.get(b"boundary", b"")
    if not boundary:
        raise _malformed("The header Content-Type names no boundary of the parts.")
    collected = _Parts()
    try:
        parser = MultipartParser(boundary, collected.callbacks())  # type: ignore[arg-type]
        parser.write(body)
        parser.finalize()
    except FormParserError:
        raise _malformed("It does not consist of parts between its boundaries.") from None
    if not collected.ended:
        raise _malformed("It ends before the last of its boundaries.")
    return collected.parts


class _Parts:
    """Collects what the parser meets."""

    def __init__(self) -> None:
        self.parts: list[Part] = []
        self.ended = False
        self._headers: dict[bytes, bytes] = {}
        self._field, self._value = b"", b""
        self._data: list[bytes] = []

    def callbacks(self) -> dict[str, object]:
        """Return what the parser calls."""
        return {
            "on_part_begin": self._begin, "on_part_data": self._more, "on_part_end": self._end,
            "on_header_field": self._more_field, "on_header_value": self._more_value,
            "on_header_end": self._end_header, "on_end": self._end_all,
        }  # fmt: skip

    def _begin(self) -> None:
        if len(self.parts) >= _MOST_PARTS:
            message = f"The body has more than {_MOST_PARTS} parts."
            raise problems.too_large("", "too_many_parts", message)
        self._headers, self._data = {}, []

    def _more_field(self, data: bytes, start: int, end: int) -> None:
        self._field += data[start:end]

    def _more_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _end_header(self) -> None:
        self._headers[self._field.lower()] = self._value
        self._field, self._value = b"", b""

    def _more(self, data: bytes, start: int, end: int) -> None:
        self._data.append(data[start:end])

    def _end(self) -> None:
        disposition = self._headers.get(b"content-disposition", b"").decode("latin-1")
        kind, options = parse_options_header(disposition)
        name = options.get(b"name", b"").decode("utf-8", "replace")
        if kind != b"form-data" or not name:
            raise _malformed("A part has no name in a header Content-Disposition: form-data.")
        filename = options.get(b"filename", b"").decode("utf-8", "replace")
        base = filename.replace("\\", "/").rpartition("/")[2][-_LONGEST_NAME:]
        self.parts.append(Part(name, base, b"".join(self._data)))
        self._data = []

    def _end_all(self) -> None:
        self.ended = True


def _malformed(detail: str) -> ProblemError:
    return ProblemError(problems.MALFORMED_FILE, detail)
