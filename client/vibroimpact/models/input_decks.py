"""Reader of nodes in input decks of Abaqus and CalculiX: *NODE, *NSET and *BOUNDARY.

The layout: Abaqus Keywords Reference Guide, of these keywords; CalculiX reads the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from vibroimpact.models.nodes import Nodes
from vibroimpact_schema.files import file_bytes, fixed_fields
from vibroimpact_schema.files.labels import label
from vibroimpact_schema.number_tables import TextError, shown

_SHAPES: Final = (
    (("C3D4",), "tetra", 4), (("C3D5",), "pyramid", 5), (("C3D6", "SC6"), "wedge", 6),
    (("C3D8", "SC8"), "hexahedron", 8), (("C3D10",), "tetra10", 10), (("C3D15",), "wedge15", 15),
    (("C3D20",), "hexahedron20", 20), (("S3", "M3D3", "CPS3", "CPE3"), "triangle", 3),
    (("S4", "M3D4", "CPS4", "CPE4"), "quad", 4), (("S6", "CPS6", "CPE6"), "triangle6", 6),
    (("S8", "CPS8", "CPE8"), "quad8", 8), (("B31", "T3D2", "B21", "T2D2", "B33"), "line", 2),
)  # fmt: skip
"""How names of elements begin, their shape, and their number of nodes; a letter may follow."""
_MOST: Final = 10**7
"""Nodes that a line of a generated set may have."""


@dataclass
class _Deck:
    """What keywords said so far."""

    place: dict[int, list[float]] = field(default_factory=dict)
    sets: dict[str, set[int]] = field(default_factory=dict)
    held: list[tuple[str, int, int, int]] = field(default_factory=list)
    """Node or set, first and last direction, line."""
    elements: dict[str, list[list[int]]] = field(default_factory=dict)
    words: list[int] = field(default_factory=list)
    """Numbers of an element whose lines go on."""


def nodes(data: bytes) -> Nodes:
    """Return the nodes of a deck, and which of their directions are held at zero.

    Raises
    ------
    TextError
        If a line is wrong, or there are no nodes.
    """
    deck, keyword, options = _Deck(), "", dict[str, str]()
    lines = file_bytes.lines(data)
    for number, line in enumerate(lines, 1):
        text = line.decode("latin-1").strip()
        if not text or text.startswith("**"):
            continue
        if text.startswith("*"):
            keyword, options = _keyword(text)
        elif keyword == "NODE":
            _node(deck, text, options, number)
        elif keyword == "ELEMENT":
            _element(deck, text, options, number)
        elif keyword == "NSET":
            _listed(deck, text, options, number)
        elif keyword == "BOUNDARY" and not options.keys() & {"AMPLITUDE", "SUBMODEL"}:
            _boundary(deck, text, number)
    if not deck.place:
        raise TextError(len(lines), "there are no nodes")
    held = {
        label(node, part)
        for which, first, last, number in deck.held
        for node in _of(deck, which, number)
        for part in range(first, last + 1)
    }
    return Nodes(deck.place, (), frozenset(held), deck.elements)


def _keyword(text: str) -> tuple[str, dict[str, str]]:
    """Return the keyword of a line and its options, in capitals."""
    name, *parts = (part.strip().upper() for part in text[1:].split(","))
    pairs = (part.partition("=") for part in parts)
    return name, {key.strip(): value.strip() for key, _, value in pairs if key}


def _node(deck: _Deck, text: str, options: dict[str, str], line: int) -> None:
    words = [word.strip().encode("latin-1") for word in text.split(",")]
    words = words[:4] if words[-1] else words[:-1][:4]
    node = _whole(words[0], line)
    if len(words) < 2 or node in deck.place:
        again = f"there are two nodes {node}" if node in deck.place else "a node without a place"
        raise TextError(line, again)
    deck.place[node] = [
        float(fixed_fields.numbers([word], max(1, len(word)), [line])[0]) if word else 0.0
        for word in words[1:]
    ]
    if "NSET" in options:
        deck.sets.setdefault(options["NSET"], set()).add(node)


def _element(deck: _Deck, text: str, options: dict[str, str], line: int) -> None:
    """Take an element of a known shape: its number and its nodes, which may fill several lines."""
    kind = options.get("TYPE", "")
    for names, shape, count in _SHAPES:
        if any(kind == name or (kind.startswith(name) and kind[len(name)].isalpha())
               for name in names):  # fmt: skip
            words = [word.strip() for word in text.split(",") if word.strip()]
            deck.words += [_whole(word.encode("latin-1"), line) for word in words]
            if len(deck.words) > count:
                deck.elements.setdefault(shape, []).append(deck.words[1 : count + 1])
                deck.words = []
            return


def _listed(deck: _Deck, text: str, options: dict[str, str], line: int) -> None:
    nodes_of_set = deck.sets.setdefault(options.get("NSET", ""), set())
    words = [word.strip() for word in text.split(",") if word.strip()]
    if "GENERATE" in options:
        first, last, *step = (_whole(word.encode("latin-1"), line) for word in words)
        by = step[0] if step else 1
        if not (first <= last < first + _MOST and by >= 1):
            raise TextError(line, f"nodes {first} to {last} by {by}")
        nodes_of_set |= set(range(first, last + 1, by))
        return
    for word in words:
        nodes_of_set |= _of(deck, word.upper(), line)


def _boundary(deck: _Deck, text: str, line: int) -> None:
    """Take what a line holds: a node or set, a first and a last direction, and a value."""
    words = [word.strip().upper() for word in text.split(",")]
    which, parts = words[0], words[1:3]
    named = {"ENCASTRE": (1, 6), "PINNED": (1, 3)}.get(parts[0] if parts else "")
    if named is not None:
        deck.held.append((which, *named, line))
        return
    if not parts or not parts[0]:
        raise TextError(line, f"{shown(text.encode('latin-1'))} names no direction")
    first = _whole(parts[0].encode("latin-1"), line)
    last = _whole(parts[1].encode("latin-1"), line) if len(parts) > 1 and parts[1] else first
    if not 1 <= first <= last <= 11:
        raise TextError(line, f"directions {first} to {last}")
    deck.held.append((which, first, min(last, 6), line))


def _of(deck: _Deck, which: str, line: int) -> set[int]:
    """Return the nodes of a set, or a node by its number."""
    if which in deck.sets:
        return deck.sets[which]
    return {_whole(which.encode("latin-1"), line)}


def _whole(text: bytes, line: int) -> int:
    return fixed_fields.whole_numbers(text, 16, 1, line)[0]
