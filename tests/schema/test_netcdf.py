"""Files of variables as others read them: h5netcdf and h5py."""

from __future__ import annotations

import io
import time

import h5netcdf
import h5py
import numpy as np
import pytest

from vibroimpact_schema import entries
from vibroimpact_schema.entries import Entry
from vibroimpact_schema.netcdf import file_of


def parts() -> list[Entry]:
    real, codes = np.dtype(np.float64), np.dtype(np.int8)
    flags = {"units": "m", "flag_values": np.int8([0, 1])}
    return [
        ("describe", ("", {"kind": "täst", "count": 3})),
        ("name_dimensions", ({"t": 3, "row": 0, "dof": 2, "many": 10**5}, {"t", "x"})),
        ("array", ("t", ("t",), np.array([1.0, 2.0, 4.0]), real, {"units": "s"})),
        ("array", ("x", ("t", "dof"), np.arange(6.0).reshape(3, 2), real, flags)),
        ("array", ("impacts/time", ("row",), np.empty(0), real, {})),
        ("array", ("error/drift", (), np.array(2.5), real, {"units": "1"})),
        ("array", ("deep/er/y", ("many",), np.arange(10**5) % 7, codes, {})),
        ("link", ("t", "axes/t")),
    ]


def written() -> bytes:
    return file_of(parts())


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


def test_entries_sent_as_bytes_make_the_same_file() -> None:
    data = entries.pack(parts())
    received = entries.unpack(data)
    assert file_of(received) == written()
    assert entries.pack(received) == data
    (name, (_, dims, values, dtype, attributes)) = received[3]
    assert (name, dims, dtype) == ("array", ("t", "dof"), np.float64)
    assert values.tolist() == [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]
    assert attributes["flag_values"].dtype == np.int8


def test_numbers_are_sent_to_the_bit() -> None:
    values = np.array([np.nan, np.inf, -0.0, 5e-324, 1.0 + 2.0**-52])
    flags = {"largest": np.float64(1e300), "none": float("nan"), "count": np.int64(2**62)}
    sent: list[Entry] = [("array", ("x", (), values, values.dtype, flags))]
    ((_, (_, _, received, _, read)),) = entries.unpack(entries.pack(sent))
    assert received.tobytes() == values.tobytes()
    assert read["largest"] == 1e300
    assert np.isnan(read["none"])
    assert int(read["count"]) == 2**62


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{}",
        entries.pack(parts())[:-8],
        entries.pack(parts())[:1000],
        entries.pack([("write", ())]),
        entries.pack([("link", ({"dtype": "|O", "shape": [1], "offset": 0}, "x"))]),
        entries.pack([("link", ({"dtype": "<f8", "shape": [-2], "offset": 0}, "x"))]),
        entries.pack([("link", ({"dtype": "<f8", "shape": [10**9], "offset": 0}, "x"))]),
    ],
)
def test_other_bytes_are_refused(data: bytes) -> None:
    # numpy, json and the module each say what is wrong
    with pytest.raises(ValueError):  # noqa: PT011
        entries.unpack(data)


def test_texts_are_packed_too() -> None:
    """As of an axis whose numbers are named, such as parameters of derivatives."""
    texts = np.array(["system.constraints.0.gap", "Ω"], h5py.string_dtype())
    array = ("array", ("parameter", ("parameter",), texts, texts.dtype, {"long_name": "path"}))
    _, (path, dimensions, values, dtype, attributes) = entries.unpack(entries.pack([array]))[0]
    assert (path, dimensions, attributes) == ("parameter", ("parameter",), {"long_name": "path"})
    assert values.tolist() == texts.tolist()
    assert h5py.check_string_dtype(dtype) is not None
