"""Tables as text for the terminal, and as Markdown for the documentation."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

from benchmarks.tables import Table, Verdict, written


def text(table: Table) -> str:
    """Return a table for the terminal."""
    lines = [table.title, "=" * len(table.title), *_aligned(*_cells(table))]
    grown = table.grown()
    if grown:
        lines += ["", *_aligned(TREND_COLUMNS, [trend_cells(verdict) for verdict in grown])]
    if table.note:
        lines.append(table.note)
    for reason in dict.fromkeys(v.reason for v in table.verdicts() if v.reason):
        lines.append(f"Missed: {reason}")
    return "\n".join(lines)


TREND_COLUMNS = ("growth", "exponent", "expected", "outcome")


def trend_cells(verdict: Verdict) -> list[str]:
    """Return the cells of a trend, with `TREND_COLUMNS` above them."""
    what = f"{verdict.label} with {verdict.quantity.removeprefix('exponent of ')}"
    return [what, f"{verdict.value:.2f}", f"{sign(verdict)} {verdict.limit:g}", outcome(verdict)]


def sign(verdict: Verdict) -> str:
    """Return what stands before the limit of a goal."""
    return "≥" if verdict.at_least else "≤"


def outcome(verdict: Verdict | None) -> str:
    """Return what stands in the last column of a table with goals."""
    return "" if verdict is None else "reached" if verdict.reached else "missed"


def _cells(table: Table) -> tuple[list[str], list[list[str]]]:
    head = [*table.columns, *(["outcome"] if table.goal else [])]
    body = [
        [*map(written, row), *([outcome(verdict)] if table.goal else [])]
        for row, verdict in zip(table.rows, table.judged(), strict=True)
    ]
    return head, body


def _aligned(head: Sequence[str], body: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(head, *body, strict=True)]
    lines = ["  ".join(name.rjust(width) for name, width in zip(head, widths, strict=True))]
    lines.append("  ".join("-" * width for width in widths))
    lines += ["  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in body]
    return lines


def markdown(table: Table) -> str:
    """Return a table for the documentation: words to the left, numbers to the right.

    What a cell of words repeats from the row above is left out.
    """
    head, body = _cells(table)
    words = [
        any(isinstance(cell, str) for cell in column) for column in zip(*table.rows, strict=True)
    ]
    words += [False] * (len(head) - len(words))
    shown = _without_repetition(body, words)
    return grid(head, shown, words)


def _without_repetition(body: list[list[str]], words: Sequence[bool]) -> list[list[str]]:
    """Leave out leading cells of words that are those of the row above."""
    shortened = body[:1]
    for above, row in itertools.pairwise(body):
        same = 0
        while same < len(row) - 1 and words[same] and row[same] == above[same]:
            same += 1
        shortened.append([""] * same + row[same:])
    return shortened


def grid(head: Sequence[str], body: Sequence[Sequence[str]], words: Sequence[bool]) -> str:
    """Return a table of texts in Markdown; `words` tells the columns that stand to the left."""
    lines = ["| " + " | ".join(map(_cell, head)) + " |"]
    lines.append("|" + "|".join(":---" if word else "---:" for word in words) + "|")
    lines += ["| " + " | ".join(map(_cell, row)) + " |" for row in body]
    return "\n".join(lines)


def _cell(words: str) -> str:
    """Return a cell of Markdown: powers of ten as such, outcomes marked, bars escaped.

    Exponents of other numbers get a hyphen at which lines do not break.
    """
    power = re.fullmatch(r"(-?\d\.\d\d)e([+-]\d+)", words)
    if power:
        return f"{power[1]}·10{str(int(power[2])).translate(_RAISED)}"
    unbroken = re.sub(r"(?<=\de)-(?=\d)", "\u2011", words)
    return _OUTCOMES.get(words, unbroken).replace("|", "\\|")


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_OUTCOMES = {"reached": "✓ reached", "missed": "✗ **missed**"}
