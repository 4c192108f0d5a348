"""Reader of what Nastran's decks say of a structure: GRID, SPOINT, SPC, SPC1, CORD2R, -C and -S.

The layout: MSC Nastran Quick Reference Guide, entries of these names.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from vibroimpact.models.nodes import Nodes
from vibroimpact_schema.files import file_bytes, fixed_fields
from vibroimpact_schema.files.labels import label
from vibroimpact_schema.files.nastran import fields_of
from vibroimpact_schema.number_tables import TextError

_SHAPES: Final[Mapping[bytes, tuple[int, Mapping[int, str]]]] = {
    b"CTETRA": (2, {4: "tetra"}), b"CPYRAM": (2, {5: "pyramid"}), b"CPENTA": (2, {6: "wedge"}),
    b"CHEXA": (2, {8: "hexahedron"}), b"CQUAD4": (2, {4: "quad"}), b"CTRIA3": (2, {3: "triangle"}),
    b"CBAR": (2, {2: "line"}), b"CBEAM": (2, {2: "line"}), b"CROD": (2, {2: "line"}),
}  # fmt: skip
"""Element -> the field its nodes begin at, and shapes by the number of corners."""
_NAMES: Final = (
    b"GRID", b"SPOINT", b"SPC", b"SPC1", b"CORD2R", b"CORD2C", b"CORD2S", *_SHAPES
)  # fmt: skip


@dataclass
class _Card:
    """A card: its name, its fields and the line it begins at."""

    name: bytes
    fields: list[bytes]
    line: int

    def text(self, place: int) -> bytes:
        """Return a field; blank behind the last one."""
        return self.fields[place] if place < len(self.fields) else b""

    def whole(self, place: int, default: int = 0) -> int:
        """Return a whole number."""
        text = self.text(place)
        if not text:
            return default
        return fixed_fields.whole_numbers(text, 16, 1, self.line)[0]

    def number(self, place: int) -> float:
        """Return a number; 0 of a blank field."""
        text = self.text(place)
        return float(fixed_fields.numbers([text], len(text), [self.line])[0]) if text else 0.0


@dataclass
class _Deck:
    """What cards said so far."""

    place: dict[int, tuple[int, Sequence[float], int]] = field(default_factory=dict)
    """Node -> its coordinate system, its coordinates there, and the line."""
    systems: dict[int, _Card] = field(default_factory=dict)
    scalar: set[int] = field(default_factory=set)
    held: set[tuple[int, int]] = field(default_factory=set)
    elements: dict[str, list[list[int]]] = field(default_factory=dict)


def nodes(data: bytes) -> Nodes:
    """Return the nodes of a deck, and which of their directions are held.

    Raises
    ------
    TextError
        If a card is wrong, a node occurs twice, or its coordinate system is unknown.
    """
    deck = _Deck()
    count = 0
    for card in _cards(file_bytes.lines(data)):
        count += 1
        _take(deck, card)
    if not deck.place and not deck.scalar:
        raise TextError(max(1, count), "there are no cards GRID")
    frames: dict[int, tuple[Any, Any]] = {}
    coordinates = {
        node: _basic(deck.systems, frames, system, np.array(place), line).tolist()
        for node, (system, place, line) in deck.place.items()
    }
    ends = [(node, part) for node in deck.place for part in range(1, 7)]
    ends = sorted([*ends, *((node, 0) for node in deck.scalar)])
    held = deck.held
    held_labels = frozenset(label(*end) for end in held)
    return Nodes(coordinates, [label(*end) for end in ends], held_labels, deck.elements)


def _cards(lines: Sequence[bytes]) -> Iterator[_Card]:
    """Yield the cards of the names that are read, with the lines that continue them."""
    card: _Card | None = None
    for number, line in enumerate(lines, 1):
        name, fields = fields_of(line)
        if not name and not fields:
            continue
        if name:
            if card is not None:
                yield card
            card = _Card(name, fields, number) if name in _NAMES else None
        elif card is not None:
            card.fields += fields
    if card is not None:
        yield card


def _take(deck: _Deck, card: _Card) -> None:
    """Take what a card says."""
    match card.name:
        case b"GRID":
            node = card.whole(0)
            if node in deck.place:
                raise TextError(card.line, f"there are two nodes {node}")
            place = [card.number(k) for k in (2, 3, 4)]
            deck.place[node] = card.whole(1), place, card.line
            deck.held |= {(node, part) for part in _parts(card, 6)}
        case b"SPOINT":
            deck.scalar |= set(_listed(card, 0))
        case b"SPC":
            for start in (1, 4):
                if card.text(start):
                    node = card.whole(start)
                    deck.held |= {(node, part) for part in _parts(card, start + 1)}
        case b"SPC1":
            parts = _parts(card, 1)
            deck.held |= {(node, part) for node in _listed(card, 2) for part in parts}
        case name if name in _SHAPES:
            start, shapes = _SHAPES[name]
            for count, shape in shapes.items():  # corners alone, of elements with more nodes too
                corners = [card.whole(k) for k in range(start, start + count)]
                deck.elements.setdefault(shape, []).append(corners)
        case _:
            deck.systems[card.whole(0)] = card


def _parts(card: _Card, place: int) -> list[int]:
    """Return the components of a field such as 1246."""
    text = card.text(place).decode("latin-1")
    if not set(text) <= set("0123456"):
        raise TextError(card.line, f"{text!r} are no components 1 to 6")
    return [int(each) for each in text]


def _listed(card: _Card, start: int) -> list[int]:
    """Return the nodes of a list such as ``1, 2, 3`` or ``1, THRU, 9``."""
    if card.text(start + 1).upper() == b"THRU":
        first, last = card.whole(start), card.whole(start + 2)
        if not 0 < first <= last < first + 10**7:
            raise TextError(card.line, f"nodes {first} THRU {last}")
        return list(range(first, last + 1))
    return [card.whole(k) for k in range(start, len(card.fields)) if card.text(k)]


def _basic(
    systems: Mapping[int, _Card], frames: dict[int, tuple[Any, Any]], system: int, place: Any,
    line: int, depth: int = 0,
) -> Any:  # fmt: skip
    """Return coordinates in the basic system."""
    if system == 0:
        return place
    card = systems.get(system)
    if card is None or depth > len(systems):
        raise TextError(
            line, f"coordinate system {system} is none of CORD2R, CORD2C, CORD2S in this file"
        )
    if system not in frames:
        points = np.array([card.number(k) for k in range(2, 11)]).reshape(3, 3)
        A, B, C = (
            _basic(systems, frames, card.whole(1), each, card.line, depth + 1) for each in points
        )
        z = B - A
        y = np.cross(z, C - A)
        if not (np.linalg.norm(z) > 0.0 and np.linalg.norm(y) > 0.0):
            raise TextError(card.line, f"the points of coordinate system {system} are in a line")
        z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
        frames[system] = A, np.column_stack([np.cross(y, z), y, z])
    origin, axes = frames[system]
    return origin + axes @ _rectangular(card.name, place)


def _rectangular(kind: bytes, place: Any) -> Any:
    """Return the rectangular coordinates of cylindrical or spherical ones, angles in degrees."""
    if kind == b"CORD2R":
        return place
    r, second, third = place
    if kind == b"CORD2C":
        angle = np.deg2rad(second)
        return np.array([r * np.cos(angle), r * np.sin(angle), third])
    polar, angle = np.deg2rad([second, third])
    return r * np.array(
        [np.sin(polar) * np.cos(angle), np.sin(polar) * np.sin(angle), np.cos(polar)]
    )
