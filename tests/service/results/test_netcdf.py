"""Files of variables as others read them: h5netcdf and h5py."""

from __future__ import annotations

import io
import time

import h5netcdf
import h5py
import numpy as np

from vibroimpact_service.results.netcdf import Entry, Variables


def written() -> bytes:
    real, codes = np.dtype(np.float64), np.dtype(np.int8)
    flags = {"units": "m", "flag_values": np.int8([0, 1])}
    entries: list[Entry] = [
        ("describe", ("", {"kind": "täst", "count": 3})),
        ("name_dimensions", ({"t": 3, "row": 0, "dof": 2, "many": 10**5}, {"t", "x"})),
        ("array", ("t", ("t",), np.array([1.0, 2.0, 4.0]), real, {"units": "s"})),
        ("array", ("x", ("t", "dof"), np.arange(6.0).reshape(3, 2), real, flags)),
        ("array", ("impacts/time", ("row",), np.empty(0), real, {})),
        ("array", ("error/drift", (), np.array(2.5), real, {"units": "1"})),
        ("array", ("deep/er/y", ("many",), np.arange(10**5) % 7, codes, {})),
        ("link", ("t", "axes/t")),
    ]
    with h5py.File("x", "w", driver="core", backing_store=False, track_order=True) as file:
        Variables(file).write(entries)
        file.flush()
        return bytes(file.id.get_file_image())


def test_dimensions_are_those_of_netcdf() -> None:
    with h5netcdf.File(io.BytesIO(written())) as file:
        sizes = {name: (dim.size, dim.isunlimited()) for name, dim in file.dimensions.items()}
        # What has no length is unlimited: netCDF has no other dimension of that length.
        assert sizes == {
            "t": (3, False), "row": (0, True), "dof": (2, False), "many": (10**5, False),
        }  # fmt: skip
        assert set(file.variables) == {"t", "x"}
        assert file["x"].dimensions == ("t", "dof")
        assert file["impacts/time"].dimensions == ("row",)
        assert file["deep/er/y"].dimensions == ("many",)
        assert file["error/drift"].dimensions == ()
        assert file.attrs["kind"] == "täst"
        assert file["x"].attrs["units"] == "m"


def test_values_and_attributes_are_those_of_hdf5() -> None:
    with h5py.File(io.BytesIO(written())) as file:
        assert file["x"][...].tolist() == [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]
        assert file["x"].dims[0][0] == file["t"]
        assert file["axes/t"] == file["t"]
        assert file["deep/er/y"].fletcher32
        assert file["deep/er/y"][[6, 10**5 - 1]].tolist() == [6, (10**5 - 1) % 7]
        assert file["error/drift"][()] == 2.5
        assert file.attrs["count"].tolist() == [3]
        assert file["x"].attrs["flag_values"].dtype == np.int8
        assert list(file) == ["row", "dof", "many", "t", "x", "impacts", "error", "deep", "axes"]


def test_equal_files_have_equal_bytes_whenever_they_are_written() -> None:
    first = written()
    time.sleep(1.1)  # times of HDF5 are whole seconds
    assert written() == first
