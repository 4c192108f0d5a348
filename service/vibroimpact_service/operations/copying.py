"""Copies of blocks from one store to another, several at a time; those that are there stay."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from typing import Final, NamedTuple

from vibroimpact_service.store import ContentStore, Store

_THREADS: Final = 8
_AT_ONCE: Final = 256

Advance = Callable[[int], None]
"""Called with the number of blocks that were dealt with."""


class Copied(NamedTuple):
    """A block after the attempt to copy it.

    Parameters
    ----------
    area, name : str
    sha256 : str or None
        Absent: the source has no such block any more, or a damaged one.
    new : bool
        Whether the target did not have it before.
    """

    area: str
    name: str
    sha256: str | None
    new: bool


def copied(
    source: Store, target: Store, blocks: Iterable[tuple[str, str]], advance: Advance
) -> Iterator[Copied]:
    """Copy blocks, given by area and name, and yield what became of each, in order.

    Blocks never change. One that the target has is therefore left as it is once its content was
    compared with its own SHA-256; a damaged one is copied again.
    """
    waiting = iter(blocks)
    with ThreadPoolExecutor(_THREADS, "copying") as threads:
        while some := list(islice(waiting, _AT_ONCE)):
            yield from threads.map(
                lambda block: _copy(source.areas[block[0]], target.areas[block[0]], *block), some
            )
            advance(len(some))


def digests(
    place: Store, blocks: Iterable[tuple[str, str]], advance: Advance
) -> Iterator[str | None]:
    """Yield the SHA-256 of blocks, in order; None where one is missing or damaged."""
    waiting = iter(blocks)
    with ThreadPoolExecutor(_THREADS, "checking") as threads:
        while some := list(islice(waiting, _AT_ONCE)):
            for digest in threads.map(lambda block: place.areas[block[0]].digest(block[1]), some):
                yield None if digest is None else digest.hex()
            advance(len(some))


def _copy(source: ContentStore, target: ContentStore, area: str, name: str) -> Copied:
    there = target.digest(name)
    if there is not None:
        return Copied(area, name, there.hex(), new=False)
    digest = source.copy(name, target)
    return Copied(area, name, None if digest is None else digest.hex(), new=True)
