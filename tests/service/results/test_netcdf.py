"""Files of variables as others read them: h5netcdf and h5py."""

from __future__ import annotations

import io
import time

import h5netcdf
import h5py
import numpy as np

from vibroimpact_service.results.netcdf import Variables


def written() -> bytes:
    with h5py.File("x", "w", driver="core", backing_store=False, track_order=True) as file:
        variables = Variables(file)
        variables.describe("", {"kind": "täst", "count": 3})
        variables.name_dimensions({"t": 3, "row": 0, "dof": 2}, {"t", "x", "impacts/time"})
        x = np.arange(6.0).reshape(3, 2)
        variables.small("t", ("t",), np.array([1.0, 2.0, 4.0]), {"units": "s"})
        variables.small("x", ("t", "dof"), x, {"units": "m", "flag_values": np.int8([0, 1])})
        variables.small("impacts/time", ("row",), np.empty(0), {})
        variables.small("error/drift", (), np.array(2.5), {"units": "1"})
        large = variables.large(
            "deep/er/y", ("t",), (3,), np.dtype(np.int8), {}, {"chunks": (2,), "fletcher32": True}
        )
        large[...] = [1, 2, 3]
        variables.link("t", "axes/t")
        variables.attach()
        file.flush()
        return bytes(file.id.get_file_image())


def test_dimensions_are_those_of_netcdf() -> None:
    with h5netcdf.File(io.BytesIO(written())) as file:
        sizes = {name: (dim.size, dim.isunlimited()) for name, dim in file.dimensions.items()}
        # What has no length is unlimited: netCDF has no other dimension of that length.
        assert sizes == {"t": (3, False), "row": (0, True), "dof": (2, False)}
        assert set(file.variables) == {"t", "x"}
        assert file["x"].dimensions == ("t", "dof")
        assert file["impacts/time"].dimensions == ("row",)
        assert file["deep/er/y"].dimensions == ("t",)
        assert file["error/drift"].dimensions == ()
        assert file.attrs["kind"] == "täst"
        assert file["x"].attrs["units"] == "m"


def test_values_and_attributes_are_those_of_hdf5() -> None:
    with h5py.File(io.BytesIO(written())) as file:
        assert file["x"][...].tolist() == [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]
        assert file["x"].dims[0][0] == file["t"]
        assert file["axes/t"] == file["t"]
        assert file["deep/er/y"].fletcher32
        assert file["deep/er/y"][...].tolist() == [1, 2, 3]
        assert file["error/drift"][()] == 2.5
        assert file.attrs["count"].tolist() == [3]
        assert file["x"].attrs["flag_values"].dtype == np.int8
        assert list(file) == ["row", "dof", "t", "x", "impacts", "error", "deep", "axes"]


def test_equal_files_have_equal_bytes_whenever_they_are_written() -> None:
    first = written()
    time.sleep(1.1)  # times of HDF5 are whole seconds
    assert written() == first
