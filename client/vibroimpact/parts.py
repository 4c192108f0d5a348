"""The parts of a result without a file: what its file would have.

They are read as those of the file are, by the part of h5py's interface that this needs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from vibroimpact_schema.entries import Array, Entry


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
    entries : sequence of Entry
        All that the file has, in order.

    Attributes
    ----------
    root : Group
    """

    def __init__(self, entries: Sequence[Entry]) -> None:
        self._entries = entries
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
        # A tenth of a second, which the import of the client does not take.
        from vibroimpact_schema.netcdf import file_of

        return file_of(self._entries)
