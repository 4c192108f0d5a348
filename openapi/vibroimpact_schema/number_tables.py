"""Tables of numbers in texts: every token is checked, and faults are told by line and reason.

Numbers are decimal, ``-1.5``, ``2.5e-3``, or with Fortran's exponent, ``2.5D-3``; nothing else is
taken for a number. No line is read by a library that could stop at a token it does not know.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Possessive quantifiers: the time is proportional to the length of any text.
NUMBER: Final = rb"[+-]?+(?:[0-9]++(?:\.[0-9]*+)?+|\.[0-9]++)(?:[eEdD][+-]?+[0-9]++)?+"
_NUMBER: Final = re.compile(NUMBER)
_STREAM: Final = re.compile(rb"(?:\s*+" + NUMBER + rb"(?=\s|\Z))*+")
_WORD: Final = re.compile(rb"\S+")
_BLANKS: Final = rb"[ \t\v\f]"
_NOT_FINITE: Final = re.compile(rb"[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
_HEXADECIMAL: Final = re.compile(rb"[+-]?0[xX].*")
_DECIMAL_COMMA: Final = re.compile(rb"[+-]?[0-9]+,[0-9]+(?:[eEdD][+-]?[0-9]+)?")
_BINARY: Final = re.compile(rb"[\x00-\x08\x0e-\x1f]")
_EXPONENTS: Final = bytes.maketrans(b"dD", b"ee")


class TextError(ValueError):
    """A text is not what its format demands.

    Parameters
    ----------
    line : int
        The line at fault, from 1.
    reason : str
        What is wrong with it.
    """

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(f"line {line}: {reason}")
        self.line, self.reason = line, reason


class NotFiniteError(TextError):
    """A number is nan, infinite, or beyond double precision."""


def plain(data: bytes) -> bytes:
    """Return a text as ASCII with a line feed at the end of each line, no byte order mark.

    Bytes beyond ASCII, as comments have in UTF-8 or Latin-1, stay; UTF-16 is decoded.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        data = data.decode("utf-16", "replace").encode("latin-1", "replace")
    text = data.removeprefix(b"\xef\xbb\xbf").rstrip(b"\x1a")  # an end of file of DOS
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return text


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Lines with the same number of numbers each.

    Parameters
    ----------
    values : array, shape (row, column)
        The numbers, finite.
    text : bytes
        The text, comments and separators replaced by blanks.
    first_line : int
        The line at which the text begins, from 1.
    """

    values: Floats
    text: bytes
    first_line: int

    def lines(self) -> Iterator[tuple[int, list[bytes]]]:
        """Yield the line of each row, from 1, and its numbers as they are written."""
        for line, content in enumerate(self.text.split(b"\n"), self.first_line):
            words = content.split()
            if words:
                yield line, words

    def row(self, row: Any) -> tuple[int, list[bytes]]:
        """Return the line of a row, which counts from 0, and its numbers as they are written."""
        return next(itertools.islice(self.lines(), int(row), None))

    def after_first(self) -> NumberTable:
        """Return the table without its first row."""
        line, _ = self.row(0)
        start = 0
        for _ in range(line - self.first_line + 1):
            start = self.text.find(b"\n", start) + 1 or len(self.text)
        return NumberTable(self.values[1:], self.text[start:], line + 1)

    def whole(self, stop: int) -> Integers:
        """Return the first columns as whole numbers, such as indices.

        Raises
        ------
        TextError
            Where a number is not whole.
        """
        numbers = self.values[:, :stop]
        wrong = (numbers != np.floor(numbers)) | (np.abs(numbers) > 2.0**53)
        if wrong.any():
            row, column = np.argwhere(wrong)[0]
            line, words = self.row(row)
            raise TextError(line, f"{shown(words[column])} is not a whole number")
        return numbers.astype(np.int64)


def read(
    text: bytes, *, first_line: int = 1, comments: bytes = b"", comma: bytes = b"", width: int = 0
) -> NumberTable:
    """Return the numbers of a text, line by line.

    Parameters
    ----------
    text : bytes
        As `plain` returns it. Empty lines are left out.
    first_line : int
        Number of its first line, for messages.
    comments : bytes
        Characters that begin comments, which end with the line.
    comma : bytes
        A character that separates numbers, besides blanks; a line may end with it.
    width : int
        Numbers in each line; default: as many as in the first.

    Raises
    ------
    TextError
        With the first line that has something else than numbers, or another number of them.
    """
    text = without_comments(text, comments)
    if not width and not text.strip():
        raise TextError(first_line, "there are no numbers")
    separator = re.escape(comma)
    gap = rb"(?:" + _BLANKS + rb"*+" + separator + _BLANKS + rb"*+|" + _BLANKS + rb"++)"
    end = _BLANKS + rb"*+(?:" + separator + rb")?+" + _BLANKS + rb"*+(?:\n|\Z)"
    if not comma:
        gap, end = _BLANKS + rb"++", _BLANKS + rb"*+(?:\n|\Z)"
    width = width or _first_width(text, comma)
    row = _BLANKS + rb"*+" + NUMBER + rb"(?:" + gap + NUMBER + rb"){%d}" % (width - 1) + end
    match = re.compile(rb"(?:" + row + rb"|" + _BLANKS + rb"*+\n)*+").match(text)
    assert match is not None  # it matches the empty text
    rest = text[match.end() :]
    if rest.strip():
        line = first_line + text.count(b"\n", 0, match.end())
        raise _fault(rest.partition(b"\n")[0], line, width, comma)
    if comma:
        text = text.replace(comma, b" ")
    table = NumberTable(_parsed(text).reshape(-1, width), text, first_line)
    wrong = ~np.isfinite(table.values)
    if wrong.any():
        at, column = np.argwhere(wrong)[0]
        line, words = table.row(at)
        raise NotFiniteError(line, f"{shown(words[column])} is beyond double precision")
    _check_end(text, first_line)
    return table


def stream(text: bytes, *, first_line: int = 1, comments: bytes = b"") -> Floats:
    """Return the numbers of a text however many of them its lines have, shape (number,).

    Raises
    ------
    TextError
        With the first line that has something else than numbers.
    """
    text = without_comments(text, comments)
    match = _STREAM.match(text)
    assert match is not None
    wrong = _WORD.search(text, match.end())
    if wrong:
        raise _not_a_number(wrong[0], first_line + text.count(b"\n", 0, wrong.start()))
    values = _parsed(text)
    if not np.isfinite(values).all():
        at = int(np.argmin(np.isfinite(values)))
        word = next(itertools.islice(_WORD.finditer(text), at, None))
        line = first_line + text.count(b"\n", 0, word.start())
        raise NotFiniteError(line, f"{shown(word[0])} is beyond double precision")
    _check_end(text, first_line)
    return values


def without_comments(text: bytes, signs: bytes) -> bytes:
    """Return a text without what stands behind one of some characters in its lines."""
    if not any(sign in text for sign in signs):
        return text
    return re.sub(rb"[" + re.escape(signs) + rb"][^\n]*", b"", text)


def _parsed(text: bytes) -> Floats:
    """Return the numbers of a text that is known to have numbers and blanks alone."""
    if b"d" in text or b"D" in text:
        text = text.translate(_EXPONENTS)
    if not text.strip():
        return np.zeros(0)
    return np.asarray(np.fromstring(text, dtype=np.float64, sep=" "))


def shown(token: bytes) -> str:
    """Return a token for a message, shortened."""
    text = token[:40].decode("latin-1").encode("unicode_escape").decode()
    return f"'{text}{'…' if len(token) > 40 else ''}'"


def why_no_number(token: bytes) -> str:
    """Return why a token is not taken for a number."""
    if _BINARY.search(token):
        return f"{shown(token)} has bytes that no text has"
    if _HEXADECIMAL.fullmatch(token):
        return f"{shown(token)} is hexadecimal; write decimal numbers"
    if _DECIMAL_COMMA.fullmatch(token):
        return f"{shown(token)} has a decimal comma; write a point"
    return f"{shown(token)} is not a number"


def _first_width(text: bytes, comma: bytes) -> int:
    """Return how many words the first line has that is not empty."""
    first = re.search(rb"\S[^\n]*", text)
    return max(1, len(_words(first[0], comma))) if first else 1


def _words(line: bytes, comma: bytes) -> list[bytes]:
    return (line.replace(comma, b" ") if comma else line).split()


def _not_a_number(word: bytes, line: int) -> TextError:
    if _NOT_FINITE.fullmatch(word):
        return NotFiniteError(line, f"{shown(word)} is not a finite number")
    return TextError(line, why_no_number(word))


def _fault(line: bytes, number: int, width: int, comma: bytes) -> TextError:
    """Return the error of a line that is not `width` numbers."""
    words = _words(line, comma)
    for word in words:
        if not _NUMBER.fullmatch(word):
            return _not_a_number(word, number)
    if len(words) == width:
        return TextError(number, "an empty field")
    return TextError(number, f"{len(words)} number{'s' * (len(words) != 1)} instead of {width}")


def _check_end(text: bytes, first_line: int) -> None:
    """Refuse a last number that was cut off: shorter than those before it, which have one length.

    Programs that write all numbers in one form also end the last line.
    """
    if text.endswith(b"\n") or not text[-1:].strip():
        return
    *before, last = [line.split()[-1].lstrip(b"+-") for line in text[-8192:].split(b"\n")[1:]
                     if line.strip()] or [b""]  # fmt: skip
    if len(before) >= 3 and len({len(word) for word in before}) == 1 and len(last) < len(before[0]):
        line = first_line + text.count(b"\n")
        raise TextError(line, f"{shown(last)} seems cut off: the text ends within it")
