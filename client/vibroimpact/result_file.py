"""The file of a result: its arrays and tables by name."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from vibroimpact.tables import Array, Table, decoded

if TYPE_CHECKING:
    import xarray


class ResultFile:
    """Arrays and tables of a result, read from its HDF5 file: what plots need, see `Result`."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._arrays: dict[str, Array] = {}
        self._tables: dict[str, Table] = {}
        self._long_names: dict[str, str] = {}
        self._units: dict[str, str] = {}
        with h5py.File(io.BytesIO(content), "r") as file:
            self.kind = str(file.attrs["kind"])
            self.digest = str(file.attrs["digest"])
            self.solver_version = str(file.attrs["solver_version"])
            self.request: dict[str, Any] = json.loads(str(file.attrs["request"]))
            self.plan: dict[str, Any] = json.loads(str(file.attrs["plan"]))
            for name, item in file.items():
                if isinstance(item, h5py.Dataset) and not _is_bare(item):
                    self._arrays[name] = decoded(item)
                    self._long_names[name] = str(item.attrs.get("long_name", name))
                    self._units[name] = str(item.attrs.get("units", "1"))
                elif isinstance(item, h5py.Group):
                    self._tables[name] = Table.of(item)

    def __getattr__(self, name: str) -> Any:
        """Return an output, as an array or as a table."""
        outputs: Mapping[str, Any] = self.__dict__.get("_arrays", {}) | self.__dict__.get(
            "_tables", {}
        )
        if name in outputs:
            return outputs[name]
        available = ", ".join(sorted(outputs))
        raise AttributeError(f"the result has no {name!r}; it has {available}")

    def __dir__(self) -> list[str]:
        """Return the names of all attributes, outputs included."""
        return [*super().__dir__(), *self._arrays, *self._tables]

    def rows(self, table: str, **at: float) -> Table:
        """Return the rows of a table that belong to one point of a sweep.

        Parameters
        ----------
        table : str
            Name of the table, such as ``"impacts"``.
        **at : float
            The value on each axis; the nearest one computed is taken.
        """
        dim = table if f"{table}_count" in self._arrays else table.removesuffix("s")
        counts, offsets = self._arrays[f"{dim}_count"], self._arrays[f"{dim}_offset"]
        axes = [str(dim) for dim in self.to_xarray()["status"].dims]
        if set(at) != set(axes):
            raise ValueError(f"a point needs a value on every axis: {', '.join(axes)}")
        point = tuple(int(np.abs(self._arrays[axis] - at[axis]).argmin()) for axis in axes)
        first = int(offsets[point])
        return self._tables[table].part(first, first + int(counts[point]))

    def each(self, table: str) -> list[Table]:
        """Return the rows of a table for each member of an ensemble, as views.

        Parameters
        ----------
        table : str
            ``"impacts"`` or ``"contacts"``.
        """
        dim = table.removesuffix("s")
        ends = np.cumsum(self._arrays[f"{dim}_count"])
        starts = self._arrays[f"{dim}_offset"]
        rows = self._tables[table]
        return [rows.part(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]

    def unit(self, name: str) -> str:
        """Return the unit of an output, such as ``"m s-1"``; ``"1"`` if the system has no units."""
        return self._units.get(name, "1")

    def to_hdf5(self, path: str | Path) -> Path:
        """Write the file as the service sent it; return its path."""
        target = Path(path)
        target.write_bytes(self._content)
        return target

    def to_xarray(self, table: str | None = None) -> xarray.Dataset:
        """Return a dataset with named dimensions, coordinates and attributes.

        Parameters
        ----------
        table : str, optional
            Name of a table to return instead of the arrays, such as ``"bands"`` or ``"impacts"``.
        """
        import xarray

        if table is not None and table not in self._tables:
            raise ValueError(f"there is no table {table!r}; there are {', '.join(self._tables)}")
        file = io.BytesIO(self._content)
        with xarray.open_dataset(file, engine="h5netcdf", group=table) as data:
            return data.load()


def _is_bare(item: h5py.Dataset) -> bool:
    """Whether a dataset only stands for a dimension without a coordinate."""
    name = item.attrs.get("NAME", b"")
    return bytes(name).startswith(b"This is a netCDF dimension but not a netCDF variable")
