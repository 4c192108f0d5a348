"""The file of a result: its arrays and tables by name."""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, reduce
from operator import getitem
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final, Self, TypeVar

import numpy as np

from vibroimpact.errors import MissingExtra
from vibroimpact.grids import angular
from vibroimpact.parts import Dataset, Group, Parts
from vibroimpact.tables import Array, Table, decoded, is_group_of, single

if TYPE_CHECKING:
    import h5py
    import pandas
    import xarray

    JSON = None | bool | int | float | str | list["JSON"] | dict[str, "JSON"]

Part = TypeVar("Part")
_NOT_OUTPUTS: Final = frozenset({"axes", "error", "frequency"})
"""Tables that describe the outputs or their axes."""


class ResultFile:
    """Arrays and tables of a result, read from its HDF5 file: what plots need, see `Result`.

    Each is read when it is first used, so that a large file on disk takes no memory.

    Parameters
    ----------
    content : bytes or path or Parts
        The file, or where it lies, or what it would have.

    Attributes
    ----------
    kind, digest, solver_version : str
    request, plan : mapping
        The documents of the request and of its plan.
    of : str
        Of a sweep, the kind that is swept.
    neglected : tuple of str
        What of the structure has no effect on the result, a sentence each, such as damping on
        impact modes; empty where all of it has.
    cautions : tuple of str
        What of the structure is permitted but seldom meant, such as an indefinite K.
    """

    PARTS: ClassVar[Mapping[str, type[Table]]] = {}
    """Name of a table -> its class."""
    NUMBERS: ClassVar[tuple[str, ...]] = ()
    """Names of outputs that are one number."""

    def __init__(self, content: bytes | Path | Parts) -> None:
        self._content = content
        self._arrays = _Lazy[Array](self._array, self._array_names)
        self._tables = _Lazy[Table](self._table, self._table_names)
        with reading(content) as file:
            self.kind = str(file.attrs["kind"])
            self.digest = str(file.attrs["digest"])
            self.solver_version = str(file.attrs["solver_version"])
            self.request: Mapping[str, Any] = json.loads(str(file.attrs["request"]))
            self.plan: Mapping[str, Any] = json.loads(str(file.attrs["plan"]))
            self.of = str(file.attrs.get("of", self.kind))
            self.neglected = tuple(str(file.attrs.get("neglected", "")).splitlines())
            self.cautions = tuple(str(file.attrs.get("cautions", "")).splitlines())
            there = [name for name in self.NUMBERS if name in file.attrs]
            self._numbers = {name: single(file.attrs[name]) for name in there}

    def _array_names(self) -> list[str]:
        return self._names[0]

    def _table_names(self) -> list[str]:
        return self._names[1]

    @cached_property
    def _names(self) -> tuple[list[str], list[str]]:
        """The names of arrays, and of tables."""
        with reading(self._content) as file:
            groups = {name: is_group_of(file, name) for name in file}
            arrays = [name for name, group in groups.items() if not (group or _is_bare(file, name))]
        return arrays, [name for name, group in groups.items() if group]

    @cached_property
    def _about(self) -> Mapping[str, _About]:
        """What is said of each array, and of the columns of tables by their paths."""
        arrays, tables = self._names
        with reading(self._content) as file:
            columns = [
                f"{table}/{name}"
                for table in tables
                for name in file[table]
                if not is_group_of(file[table], name)
            ]
            return {name: _About.of(file[name]) for name in (*arrays, *columns)}

    def open(self) -> h5py.File:
        """Open the file for reading, to read parts of its arrays: ``file["x"][:100]``."""
        return opened(self._file)

    @cached_property
    def _file(self) -> bytes | Path:
        """The file, or where it lies."""
        return self._content.hdf5() if isinstance(self._content, Parts) else self._content

    def _array(self, name: str) -> Array:
        with reading(self._content) as file:
            return decoded(file[name])

    def _table(self, name: str) -> Table:
        with reading(self._content) as file:
            return self.PARTS.get(name, Table).of(file[name])

    def __getattr__(self, name: str) -> Any:
        """Return an output, as a number, an array or a table."""
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self._numbers:
            return self._numbers[name]
        if name not in self:
            raise AttributeError(self._without(name))
        return self._arrays[name] if name in self._arrays else self._tables[name]

    def __getitem__(self, path: str) -> Any:
        """Return an output, or a column of a table: ``result["x"]``, ``result["impacts/time"]``."""
        name, *columns = path.split("/")
        if name not in self:
            raise KeyError(self._without(name))
        return reduce(getitem, columns, getattr(self, name))

    def _without(self, name: str) -> str:
        if name.startswith("to_"):
            return (
                f"the result has no {name!r}; it is written by to_hdf5(file), read by to_xarray() "
                "and to_pandas(), whose tables have to_csv(file)"
            )
        return (
            f"the result has no {name!r}; it has {', '.join(sorted(self))}; `outputs` of the "
            "request chooses what is computed"
        )

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the arrays, of the tables and of single numbers."""
        yield from (*self._arrays, *self._tables, *self._numbers)

    def __contains__(self, name: object) -> bool:
        """Return whether there is an output of that name: ``"impulse" in result``."""
        return name in self._arrays or name in self._tables or name in self._numbers

    def __dir__(self) -> list[str]:
        """Return the names of all attributes, outputs included."""
        return [*super().__dir__(), *self]

    def outputs(self) -> list[str]:
        """Return the names of the arrays that are no axes."""
        with reading(self._content) as file:
            return [name for name in self._arrays if not file[name].is_scale]

    def axis_names(self) -> list[str]:
        """Return the names of the arrays that are axes of the others."""
        outputs = set(self.outputs())
        return [name for name in self._arrays if name not in outputs]

    def size_of(self, name: str) -> tuple[int, ...]:
        """Return the shape of an array, without reading it."""
        return tuple(self._about[name].shape)

    def row_counts(self) -> dict[str, int]:
        """Return how many rows each table of an output has."""
        return {
            name: table.rows
            for name, table in self._tables.items()
            if table.rows is not None and name not in _NOT_OUTPUTS
        }

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
        """Return the unit of an output, such as ``"m/s"``; ``"1"`` if the system has no units.

        Columns of tables are named by their path, such as ``"impacts/time"``.
        """
        return self._about[name].unit if name in self._about else "1"

    def in_unit(self, Omega: Any, unit: str) -> Array:
        """Return angular frequencies of the result in another unit.

        Parameters
        ----------
        Omega : array
            Angular frequencies in the structure's unit of time, such as ``result.Omega``.
        unit : str
            ``"Hz"``, ``"rpm"``, ``"Omega"``, or ``"omega"`` for (2/pi) Omega.
        """
        given = np.asarray(Omega, dtype=np.float64)
        time = self.unit("Omega").removeprefix("rad/")
        return given * (1.0 / angular(unit, "s" if time == "1" else time))

    def to_hdf5(self, path: str | Path) -> Path:
        """Write the file as the service sent it; return its path."""
        target = Path(path)
        if isinstance(self._file, bytes):
            target.write_bytes(self._file)
        elif target.resolve() != self._file.resolve():
            shutil.copyfile(self._file, target)
        return target

    def to_dict(self) -> dict[str, JSON]:
        """Return the numbers as lists and words, as the JSON document of the service has them.

        Tables are objects of columns here; NaN and infinity are None.
        """
        head: dict[str, Any] = {
            "kind": self.kind,
            "digest": self.digest,
            "of": self.of,
            "plan": self.plan,
        }
        if self.neglected:
            head["neglected"] = list(self.neglected)
        if self.cautions:
            head["cautions"] = list(self.cautions)
        arrays = {name: _plain(values) for name, values in self._arrays.items()}
        return head | arrays | {name: _plain(table) for name, table in self._tables.items()}

    def to_pandas(self, table: str | None = None) -> pandas.DataFrame:
        """Return a data frame: the arrays with their axes as index, one of them, or a table.

        An array over time and degrees of freedom has a row for each time and a column for each
        degree of freedom, as a spreadsheet needs it.

        Parameters
        ----------
        table : str, optional
            Name of a table or array, such as ``"bands"``, ``"impacts"`` or ``"x"``; default: all
            arrays, or the first table where there are tables only, as of periodic motions.

        Raises
        ------
        AttributeError
            If there is neither a table nor an array of that name.
        MissingExtra
            If pandas or xarray is not installed.
        """
        if table is None and not self.outputs():
            table = next(iter(self.row_counts()), None)
        if table is None:
            return self.to_xarray().to_dataframe()
        if table in self._arrays:
            return _frame(self.to_xarray()[table])
        try:
            import pandas
        except ImportError as error:
            raise MissingExtra("data frames", "data", error) from error
        columns = getattr(self, table)
        return pandas.DataFrame(
            {name: values for name, values in columns.items() if np.ndim(values) == 1}
        )

    def to_xarray(self, table: str | None = None) -> xarray.Dataset:
        """Return a dataset with named dimensions, coordinates and attributes.

        Parameters
        ----------
        table : str, optional
            Name of a table to return instead of the arrays, such as ``"bands"`` or ``"impacts"``.
        """
        try:
            import xarray
        except ImportError as error:
            raise MissingExtra("datasets", "data", error) from error
        if table is not None and table not in self._tables:
            raise ValueError(f"there is no table {table!r}; there are {', '.join(self._tables)}")
        if not isinstance(self._file, bytes):
            # Read as it is used.
            return xarray.open_dataset(self._file, engine="h5netcdf", group=table)
        file = io.BytesIO(self._file)
        with xarray.open_dataset(file, engine="h5netcdf", group=table) as data:
            return data.load()


def opened(content: bytes | Path) -> h5py.File:
    """Open the file of a result for reading."""
    import h5py  # a tenth of a second, which the import of the client does not take

    return h5py.File(io.BytesIO(content) if isinstance(content, bytes) else content, "r")


@dataclass(frozen=True, slots=True)
class _About:
    """What a file says of an array."""

    shape: tuple[int, ...]
    long_name: str
    unit: str

    @classmethod
    def of(cls, item: h5py.Dataset | Dataset) -> Self:
        """Read it."""
        name = item.name.rpartition("/")[2]
        long_name = str(item.attrs.get("long_name", name))
        return cls(item.shape, long_name, str(item.attrs.get("units", "1")))


@contextmanager
def reading(content: bytes | Path | Parts) -> Iterator[Any]:
    """Open the file of a result, or its parts, which are read in the same way."""
    if isinstance(content, Parts):
        yield content.root
    else:
        with opened(content) as file:
            yield file


class _Lazy(Mapping[str, Part]):
    """Parts of a file by name, each read when it is first used."""

    def __init__(self, read: Callable[[str], Part], names: Callable[[], list[str]]) -> None:
        self._read, self._names, self._known = read, names, dict[str, Part]()

    def __getitem__(self, name: str) -> Part:
        if name not in self._known:
            if name not in self._names():
                raise KeyError(name)
            self._known[name] = self._read(name)
        return self._known[name]

    def __contains__(self, name: object) -> bool:
        return name in self._names()

    def __iter__(self) -> Iterator[str]:
        return iter(self._names())

    def __len__(self) -> int:
        return len(self._names())


def _frame(array: xarray.DataArray) -> pandas.DataFrame:
    """Return an array as a table: columns along its second dimension, if it has two."""
    if array.ndim != 2:
        return array.to_dataframe()
    frame: pandas.DataFrame = array.to_pandas()
    return frame


def _plain(values: Any) -> Any:
    """Return lists, numbers and words, None for numbers that are not finite."""
    if isinstance(values, Mapping):
        return {name: _plain(value) for name, value in values.items()}
    given = np.asarray(values)
    if given.dtype.kind == "f":
        given = given.astype(object)
        given[~np.isfinite(given.astype(np.float64))] = None
    return given.tolist()


def _is_bare(file: h5py.File | Group, name: str) -> bool:
    """Whether a dataset only stands for a dimension without a coordinate."""
    if isinstance(file, Group):
        return False
    from h5py import h5a

    if not h5a.exists(file.id, b"NAME", obj_name=name.encode()):
        return False
    scale = bytes(file[name].attrs["NAME"])
    return scale.startswith(b"This is a netCDF dimension but not a netCDF variable")
