"""The result of a computation, read from its file, with its display in notebooks and its plots."""

from __future__ import annotations

import html
import io
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from vibroimpact import plots, sweep_plots
from vibroimpact.tables import Array, Table, decoded, html_table

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

__all__ = ["Array", "Result", "Table"]

_NOT_OUTPUTS = frozenset({"axes", "error", "frequency"})
"""Tables that describe the outputs or their axes."""


class Result:
    """The result of a computation: the arrays and tables of its HDF5 file.

    Every output is an attribute: ``result.impulse``, ``result.shape``, ``result.Omega``.
    Codes are decoded: ``exists`` is boolean, ``reason`` an array of words.

    Parameters
    ----------
    content : bytes
        The HDF5 file.
    """

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

    def plot(
        self,
        ax: Axes | None = None,
        *,
        output: str | None = None,
        at: Mapping[str, float] | None = None,
    ) -> Axes:
        """Plot the result; what is drawn depends on its kind.

        Impact modes: the impulse over frequency, or the mode shape where there is one frequency
        only; ``output="energy"`` gives the frequency-energy plot. Time histories: a displacement
        over time. Ensembles: the number of impacts over the initial states, see
        `vibroimpact.plots.basins`. Sweeps: an output over the one or two dimensions that are
        left, see `vibroimpact.sweep_plots.draw`.

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw in; default: those of a new figure.
        output : str, optional
            Output of impact modes or of a sweep; default: the most telling one, or the first.
        at : mapping, optional
            For a sweep: dimension -> value at which it is held fixed.

        Raises
        ------
        ValueError
            If there is no plot of that output.
        """
        if self.kind == "sweep":
            return sweep_plots.draw(self, output, at, ax)
        if self.kind == "impact-modes":
            single = "shape" in self._arrays and self.Omega.size == 1
            return plots.mode_plot(output or ("shape" if single else "impulse"))(self, ax=ax)
        if output is not None:
            raise ValueError(f"{self.kind} has one plot only, so that output cannot be chosen")
        drawing: dict[str, Callable[..., Axes]] = {
            "existence-bands": plots.bands,
            "resonances": plots.resonances,
            "time-history": plots.history,
            "ensemble": plots.basins,
            "slow-flow": plots.displacement,
        }
        return drawing[self.kind](self, ax=ax)

    def _output_tables(self) -> list[tuple[str, Table]]:
        return [
            (name, table)
            for name, table in self._tables.items()
            if table.rows is not None and name not in _NOT_OUTPUTS
        ]

    def __repr__(self) -> str:
        """Return the kind, the digest and the sizes of the outputs."""
        sizes = [f"{name} {array.shape}" for name, array in self._arrays.items()]
        sizes += [f"{name} ({table.rows} rows)" for name, table in self._output_tables()]
        return f"<Result {self.kind} {self.digest[:12]}: {', '.join(sizes)}>"

    def _repr_html_(self) -> str:
        rows = [[name, str(a.shape), self._long_names[name]] for name, a in self._arrays.items()]
        rows += [
            [name, f"{table.rows} rows", ", ".join(table)] for name, table in self._output_tables()
        ]
        statement = self._tables["error"].get("statement") if "error" in self._tables else None
        note = f"<p>{html.escape(str(statement))}</p>" if statement else ""
        head = f"<b>{html.escape(self.kind)}</b> <code>{self.digest[:12]}</code>"
        return f"{head}{html_table(['name', 'size', 'meaning'], rows)}{note}"


def _is_bare(item: h5py.Dataset) -> bool:
    """Whether a dataset only stands for a dimension without a coordinate."""
    name = item.attrs.get("NAME", b"")
    return bytes(name).startswith(b"This is a netCDF dimension but not a netCDF variable")
