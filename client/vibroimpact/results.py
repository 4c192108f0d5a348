"""A result: its arrays by name, as xarray, as a file and as a picture."""

from __future__ import annotations

import html
import io
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

Array = np.ndarray[Any, Any]


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
        self._long_names: dict[str, str] = {}
        with h5py.File(io.BytesIO(content), "r") as file:
            self.kind = str(file.attrs["kind"])
            self.digest = str(file.attrs["digest"])
            self.solver_version = str(file.attrs["solver_version"])
            self.request: dict[str, Any] = json.loads(str(file.attrs["request"]))
            self.plan: dict[str, Any] = json.loads(str(file.attrs["plan"]))
            for name, item in file.items():
                if isinstance(item, h5py.Dataset):
                    self._arrays[name] = _decoded(item)
                    self._long_names[name] = str(item.attrs.get("long_name", name))

    def __getattr__(self, name: str) -> Array:
        """Return an output."""
        arrays: dict[str, Array] = self.__dict__.get("_arrays", {})
        if name in arrays:
            return arrays[name]
        raise AttributeError(f"the result has no {name!r}; it has {', '.join(sorted(arrays))}")

    def __dir__(self) -> list[str]:
        """Return the names of attributes, outputs among them."""
        return [*super().__dir__(), *self._arrays]

    def to_hdf5(self, path: str | Path) -> Path:
        """Write the file as the service sent it; return its path."""
        target = Path(path)
        target.write_bytes(self._content)
        return target

    def to_xarray(self) -> xarray.Dataset:
        """Return a dataset with named dimensions, coordinates and attributes."""
        import xarray

        with xarray.open_dataset(io.BytesIO(self._content), engine="h5netcdf") as data:
            return data.load()

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the impulse over the frequency, or the shape where there is one frequency."""
        from vibroimpact import plots

        if "shape" in self._arrays and self.Omega.size == 1:
            return plots.shape(self, 0, ax)
        return plots.impulse(self, ax)

    def __repr__(self) -> str:
        """Return kind, name and sizes."""
        sizes = ", ".join(f"{name} {array.shape}" for name, array in self._arrays.items())
        return f"<Result {self.kind} {self.digest[:12]}: {sizes}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td><code>{html.escape(name)}</code></td><td>{array.shape}</td>"
            f"<td style='text-align:left'>{html.escape(self._long_names[name])}</td></tr>"
            for name, array in self._arrays.items()
        )
        head = f"<b>{html.escape(self.kind)}</b> <code>{self.digest[:12]}</code>"
        return f"{head}<table>{rows}</table>"


def _decoded(item: h5py.Dataset) -> Array:
    """Return a dataset's numbers, or what its flags mean."""
    values: Array = item[()]
    if "flag_meanings" not in item.attrs:
        return values
    meanings = np.array(str(item.attrs["flag_meanings"]).split())
    if item.name == "/exists":
        return values.astype(np.bool_)
    return np.asarray(meanings[values])
