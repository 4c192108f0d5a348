"""What decks of finite-element programs say of nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from vibroimpact_schema.files.labels import Label


@dataclass(frozen=True, eq=False)
class Nodes:
    """What a deck says of nodes.

    Parameters
    ----------
    coordinates : mapping
        Node -> its coordinates.
    labels : sequence of (int, str)
        All degrees of freedom that nodes can have, in the order of their numbers; empty: unknown.
    held : set of (int, str)
        Those that are held.
    elements : mapping
        Shape -> the nodes of each element; of shapes that `Model.write` knows.
    """

    coordinates: Mapping[int, Sequence[float]]
    labels: Sequence[Label] = ()
    held: frozenset[Label] = field(default_factory=frozenset)
    elements: Mapping[str, Sequence[Sequence[int]]] = field(default_factory=dict)
