"""The parts of a result that this program computed itself: what its file would have, without it.

They are read as those of the file are, by the part of h5py's interface that this needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

Array = np.ndarray[Any, Any]
Entries = Sequence[tuple[str, tuple[Any, ...]]]


class Dataset:
    """An array with what is said of it, as `h5py.Dataset`."""

    def __init__(self, name: str, values: Array, attrs: Mapping[str, Any], *, scale: bool) -> None:
        self.name, self.attrs, self.is_scale = name, attrs, scale
        self._values = values

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the array."""
        return tuple(self._values.shape)

    def __getitem__(self, key: Any) -> Any:
        """Return some of the numbers, which are the caller's own."""
        return np.array(self._values[key])[()]


class Group(Mapping[str, Any]):
    """Arrays and groups by name or path, as `h5py.Group`."""

    def __init__(self, name: str) -> None:
        self.name, self.attrs = name, dict[str, Any]()
        self._parts: dict[str, Any] = {}

    def __getitem__(self, path: str) -> Any:
        """Return what is at a path."""
        first, _, rest = path.partition("/")
        part = self._parts[first]
        return part[rest] if rest else part

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(self._parts)

    def __len__(self) -> int:
        """Return how many parts there are."""
        return len(self._parts)

    def group(self, path: str) -> Group:
        """Return the group at a path, which is made where it is missing."""
        if not path:
            return self
        first, _, rest = path.partition("/")
        inner: Group = self._parts.setdefault(first, Group(f"{self.name.rstrip('/')}/{first}"))
        return inner.group(rest)

    def place(self, path: str, part: Dataset) -> None:
        """Put an array at a path."""
        folder, _, name = path.rpartition("/")
        self.group(folder)._parts[name] = part


class Parts:
    """What the file of a result has.

    Parameters
    ----------
    entries : sequence
        All that the file has, in order: ``("name_dimensions", (sizes, variables))``,
        ``("array", (path, dimensions, values, dtype, attributes))``, ``("link", (path, other))``,
        ``("describe", (path of a group, attributes))``.
    write : callable
        Returns the file of such entries.

    Attributes
    ----------
    root : Group
    """

    def __init__(self, entries: Entries, write: Callable[[Entries], bytes]) -> None:
        self._entries, self._write = entries, write
        self.root, sizes = Group("/"), dict[str, int]()
        for name, given in entries:
            match name:
                case "name_dimensions":
                    sizes = given[0]
                case "array":
                    path, _, values, dtype, attrs = given
                    scale, numbers = path in sizes, np.asarray(values, dtype)
                    self.root.place(path, Dataset(f"/{path}", numbers, attrs, scale=scale))
                case "link":
                    self.root.place(given[1], self.root[given[0]])
                case "describe":
                    self.root.group(given[0]).attrs.update(given[1])

    def hdf5(self) -> bytes:
        """Return the file."""
        return self._write(self._entries)
