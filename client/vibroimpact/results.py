"""A result: its arrays by name, as xarray, as a file and as a picture."""

from __future__ import annotations

import html
import io
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

Array = np.ndarray[Any, Any]

_SHOWN_ROWS = 20
_ABOUT_OUTPUTS = frozenset({"axes", "error", "frequency"})


class Table(Mapping[str, Any]):
    """Columns of equal length, or single numbers: ``impacts["time"]``, ``impacts.time``."""

    def __init__(self, columns: dict[str, Any]) -> None:
        self._columns = columns

    @classmethod
    def of(cls, group: h5py.Group) -> Table:
        """Read a group of a file."""
        columns = {k: _decoded(v) for k, v in group.items() if isinstance(v, h5py.Dataset)}
        single = {k: _single(v) for k, v in group.attrs.items() if not k.startswith("_")}
        return cls({**columns, **single})

    def __getitem__(self, name: str) -> Any:
        """Return a column."""
        return self._columns[name]

    def __getattr__(self, name: str) -> Any:
        """Return a column."""
        columns: dict[str, Any] = self.__dict__.get("_columns", {})
        if name in columns:
            return columns[name]
        raise AttributeError(f"the table has no {name!r}; it has {', '.join(columns)}")

    def part(self, start: int, stop: int) -> Table:
        """Return some of the rows."""
        return Table({name: column[start:stop] for name, column in self._columns.items()})

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(self._columns)

    def __len__(self) -> int:
        """Return how many columns there are."""
        return len(self._columns)

    @property
    def rows(self) -> int | None:
        """How many rows there are; None of single numbers and of arrays that are no columns."""
        shapes = {c.shape for c in self._columns.values() if isinstance(c, np.ndarray)}
        shape: tuple[int, ...] = shapes.pop() if len(shapes) == 1 else ()
        return int(shape[0]) if len(shape) == 1 else None

    def __repr__(self) -> str:
        """Return names and sizes."""
        size = "" if self.rows is None else f" ({self.rows} rows)"
        return f"<Table{size} {', '.join(self._columns)}>"

    def _repr_html_(self) -> str:
        """Return the first rows, or names and numbers."""
        if self.rows is None:
            values = [
                [name, str(value.shape) if isinstance(value, np.ndarray) else str(value)]
                for name, value in self._columns.items()
            ]
            return _html_table(["name", "value or size"], values)
        columns = {k: v for k, v in self._columns.items() if isinstance(v, np.ndarray)}
        count = min(self.rows, _SHOWN_ROWS)
        shown = [[_cell(column[row]) for column in columns.values()] for row in range(count)]
        left = f"<p>… and {self.rows - count} more rows</p>" if self.rows > count else ""
        return _html_table(list(columns), shown) + left


class Result:
    """What a computation returned.

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
                    self._arrays[name] = _decoded(item)
                    self._long_names[name] = str(item.attrs.get("long_name", name))
                    self._units[name] = str(item.attrs.get("units", "1"))
                elif isinstance(item, h5py.Group):
                    self._tables[name] = Table.of(item)

    def __getattr__(self, name: str) -> Any:
        """Return an output: an array, or a table of them."""
        arrays: dict[str, Array] = self.__dict__.get("_arrays", {})
        if name in arrays:
            return arrays[name]
        tables: dict[str, Table] = self.__dict__.get("_tables", {})
        if name in tables:
            return tables[name]
        there = ", ".join(sorted([*arrays, *tables]))
        raise AttributeError(f"the result has no {name!r}; it has {there}")

    def __dir__(self) -> list[str]:
        """Return the names of attributes, outputs among them."""
        return [*super().__dir__(), *self._arrays, *self._tables]

    def rows(self, table: str, **at: float) -> Table:
        """Return the rows of a table that belong to one point of a sweep.

        Parameters
        ----------
        table : str
            Its name, such as ``"impacts"``.
        **at : float
            Where to stand on each axis; the nearest value is taken.
        """
        dim = table if f"{table}_count" in self._arrays else table.removesuffix("s")
        counts, offsets = self._arrays[f"{dim}_count"], self._arrays[f"{dim}_offset"]
        axes = [str(dim) for dim in self.to_xarray()["status"].dims]
        if set(at) != set(axes):
            raise ValueError(f"a point is named by all axes: {', '.join(axes)}")
        point = tuple(int(np.abs(self._arrays[axis] - at[axis]).argmin()) for axis in axes)
        first = int(offsets[point])
        return self._tables[table].part(first, first + int(counts[point]))

    def each(self, table: str) -> list[Table]:
        """Return the rows of a table for every member of an ensemble, without copying them.

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
        """Return the unit of an output, such as ``"m s-1"``; ``"1"`` where the system has none."""
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
            A table of the result instead of its arrays, such as ``"bands"`` or ``"impacts"``.
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
        """Draw the impulse over frequency, the shape at a single one, or the motion over time.

        Of impact modes ``output="energy"`` draws the frequency over the energy, and
        ``output="impulse"`` or ``"shape"`` what they say. Of a sweep: an output over the one or
        two dimensions that are left, see `vibroimpact.sweep_plots.draw`. Of an
        ensemble: the number of impacts over the initial states, see `vibroimpact.plots.basins`.

        Parameters
        ----------
        ax : Axes, optional
            Where to draw; absent: a new figure.
        output : str, optional
            What to draw of impact modes or of a sweep; absent: what says most, the first output.
        at : mapping, optional
            Of a sweep: dimension -> where to stand on it.

        Raises
        ------
        ValueError
            Where there is no picture of that output.
        """
        from vibroimpact import plots, sweep_plots

        if self.kind == "sweep":
            return sweep_plots.draw(self, output, at, ax)
        if self.kind == "impact-modes":
            single = "shape" in self._arrays and self.Omega.size == 1
            return plots.mode_plot(output or ("shape" if single else "impulse"))(self, ax=ax)
        if output is not None:
            raise ValueError(f"there is one picture of {self.kind}; output is for other kinds")
        if self.kind == "existence-bands":
            return plots.bands(self, ax)
        if self.kind == "resonances":
            return plots.resonances(self, ax)
        if self.kind == "time-history":
            return plots.history(self, ax=ax)
        if self.kind == "ensemble":
            return plots.basins(self, ax=ax)
        return plots.displacement(self, ax)

    def _shown_tables(self) -> list[tuple[str, Table]]:
        """Return the tables that are outputs, not about them or their axes."""
        return [
            (name, table)
            for name, table in self._tables.items()
            if table.rows is not None and name not in _ABOUT_OUTPUTS
        ]

    def __repr__(self) -> str:
        """Return kind, name and sizes."""
        sizes = [f"{name} {array.shape}" for name, array in self._arrays.items()]
        sizes += [f"{name} ({table.rows} rows)" for name, table in self._shown_tables()]
        return f"<Result {self.kind} {self.digest[:12]}: {', '.join(sizes)}>"

    def _repr_html_(self) -> str:
        rows = [[name, str(a.shape), self._long_names[name]] for name, a in self._arrays.items()]
        rows += [
            [name, f"{table.rows} rows", ", ".join(table)] for name, table in self._shown_tables()
        ]
        statement = self._tables["error"].get("statement") if "error" in self._tables else None
        said = f"<p>{html.escape(str(statement))}</p>" if statement else ""
        head = f"<b>{html.escape(self.kind)}</b> <code>{self.digest[:12]}</code>"
        return f"{head}{_html_table(['name', 'size', 'meaning'], rows)}{said}"


def _html_table(head: list[str], rows: list[list[str]]) -> str:
    """Return a table; the first column is names, the others are text."""
    top = "".join(f"<th>{html.escape(name)}</th>" for name in head)
    body = "".join(
        "<tr>"
        + "".join(f"<td style='text-align:left'>{html.escape(c)}</td>" for c in row)
        + "</tr>"
        for row in rows
    )
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


def _cell(value: Any) -> str:
    return f"{value:.8g}" if isinstance(value, float | np.floating) else str(value)


def _is_bare(item: h5py.Dataset) -> bool:
    """Whether a dataset only stands for a dimension without a coordinate."""
    name = item.attrs.get("NAME", b"")
    return bytes(name).startswith(b"This is a netCDF dimension but not a netCDF variable")


def _single(value: Any) -> Any:
    """Return a number that a file holds as an array of one."""
    return value.item() if isinstance(value, np.ndarray) and value.size == 1 else value


def _decoded(item: h5py.Dataset) -> Array:
    """Return a dataset's numbers, or what its flags mean."""
    values: Array = item[()]
    if "flag_meanings" not in item.attrs:
        return values
    meanings = np.array(str(item.attrs["flag_meanings"]).split())
    if item.name == "/exists":
        return values.astype(np.bool_)
    return np.asarray(meanings[values])
