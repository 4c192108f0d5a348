"""Results in containers, JSON and HDF5: the same numbers, to the last bit, with their meaning."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from typing import Annotated, Any

import h5py
import numpy as np
import orjson
import pytest
import xarray
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from vibroimpact_service.results import container, encode, hdf5
from vibroimpact_service.results.container import DamagedContainerError
from vibroimpact_service.results.encode import Content
from vibroimpact_solvers.arrays import Booleans, Floats, Integers, Quantity

HEAD = {
    "kind": "test-kind",
    "digest": "ab" * 32,
    "request": '{"system":"§"}',
    "plan": {"steps": [], "skips": [], "flops": 0.0, "bytes": 0.0},
    "provenance": {"created": "2026-01-01T00:00:00.000+00:00", "solver_version": "1.2.3"},
    "units": {"length": "m", "mass": "kg", "time": "s"},
}


@dataclass(frozen=True)
class Result:
    Omega: Annotated[
        Floats, Quantity(("frequency",), "time-1", "frequency", True, path="frequency/Omega")
    ]
    omega: Annotated[
        Floats, Quantity(("frequency",), "time-1", "beside", True, path="frequency/omega")
    ]
    dof: Annotated[Integers | None, Quantity(("dof",), "1", "index", True)]
    x: Annotated[Floats | None, Quantity(("frequency", "dof"), "mass length2 time-2", "value")]
    exists: Annotated[
        Booleans | None, Quantity(("frequency",), "1", "is it", flags=("phantom", "real"))
    ] = None
    reason: Annotated[
        Integers | None, Quantity(("frequency",), "1", "why", flags=("ok", "bad", "worse"))
    ] = None
    spread: Annotated[
        Floats | None, Quantity(("frequency",), "1", "error", path="error/spread")
    ] = None
    largest_error: Annotated[
        float | None, Quantity((), "1", "largest", path="error/largest_of_all")
    ] = None
    error_statement: Annotated[
        str, Quantity((), "1", "how it was obtained", path="error/statement")
    ] = "a bound"


def result(points: int = 3, dofs: int = 2, **fields: Any) -> Result:
    rng = np.random.default_rng(1)
    return Result(
        Omega=1.0 + np.arange(points),
        omega=2.0 + np.arange(points),
        dof=np.arange(dofs),
        x=rng.standard_normal((points, dofs)),
        **fields,
    )


def content(of: Result, **head: Any) -> encode.Content:
    return encode.unpack(encode.pack(encode.describe(of, HEAD | head)))


def in_hdf5(data: bytes) -> h5py.File:
    return h5py.File(io.BytesIO(data))


def test_a_container_gives_the_result_back() -> None:
    given_ = result(exists=np.array([True, False, True]), reason=np.array([0, 2, 1]))
    again = encode.to_result(content(given_), Result)
    np.testing.assert_array_equal(again.x, given_.x)
    np.testing.assert_array_equal(again.exists, given_.exists)
    assert again.exists.dtype == np.bool_
    assert again.spread is None
    assert again.error_statement == "a bound"


def test_a_damaged_container_is_noticed() -> None:
    data = bytearray(encode.pack(encode.describe(result(), HEAD)))
    data[-1] ^= 1
    with pytest.raises(DamagedContainerError):
        encode.unpack(bytes(data))


def test_json_places_fields_by_their_paths() -> None:
    fields = {
        "exists": np.array([True, False, True]),
        "reason": np.array([0, 2, 1]),
        "spread": np.array([1e-16, np.nan, 1e-15]),
        "largest_error": 1e-15,
    }
    document = json.loads(encode.to_json(content(result(**fields))))
    assert list(document)[:2] == ["kind", "digest"]
    assert document["frequency"] == {"Omega": [1, 2, 3], "omega": [2, 3, 4]}
    assert document["exists"] == [True, False, True]
    assert document["reason"] == ["ok", "worse", "bad"]
    assert document["error"] == {
        "spread": [1e-16, None, 1e-15],
        "largest_of_all": 1e-15,
        "statement": "a bound",
    }
    assert document["provenance"]["solver_version"] == "1.2.3"
    assert "tau" not in document


def test_a_stored_result_without_declarations_of_its_numbers_is_read() -> None:
    """Results of 0.1.0 have none."""
    arrays, meta = container.unpack(encode.pack(encode.describe(result(), HEAD)))
    del meta["meanings"]["error_statement"]
    old = encode.unpack(container.pack(arrays, meta))
    assert encode.to_json(old) == encode.to_json(content(result()))
    with in_hdf5(hdf5.to_hdf5(old)) as file:
        assert file["error"].attrs["statement"] == "a bound"


def test_what_was_not_asked_is_in_neither() -> None:
    bare = content(Result(np.ones(1), np.ones(1), None, None))
    assert "x" not in json.loads(encode.to_json(bare))
    with in_hdf5(hdf5.to_hdf5(bare)) as file:
        assert set(file) == {"Omega", "omega", "frequency", "error"}


@pytest.mark.needs("compiled kernels")
@given(
    arrays.arrays(
        np.float64,
        st.tuples(st.integers(1, 40), st.just(2)),
        elements=st.floats(allow_nan=False, allow_infinity=False),
    )
)
@settings(deadline=None, max_examples=60)
def test_both_encodings_hold_every_bit(x: np.ndarray) -> None:
    points = x.shape[0]
    one = content(Result(1.0 + np.arange(points), np.ones(points), np.arange(2), x))
    from_json = np.array(json.loads(encode.to_json(one))["x"])
    with in_hdf5(hdf5.to_hdf5(one)) as file:
        from_hdf5 = file["x"][...]
    assert from_json.tobytes() == x.tobytes()
    assert from_hdf5.tobytes() == x.tobytes()


@pytest.mark.needs("compiled kernels")
def test_xarray_opens_the_file_unaided() -> None:
    fields = {"exists": np.array([True, False, True]), "spread": np.full(3, 1e-16)}
    given_ = result(**fields)
    file = io.BytesIO(hdf5.to_hdf5(content(given_)))
    with xarray.open_dataset(file, engine="h5netcdf") as data:
        assert data["x"].dims == ("Omega", "dof")
        assert set(data.coords) == {"Omega", "omega", "dof"}
        np.testing.assert_array_equal(data["x"].sel(Omega=2.0).values, given_.x[1])
        assert data["x"].attrs["units"] == "J"
        assert data["x"].attrs["long_name"] == "value"
        assert data["Omega"].attrs["units"] == "rad/s"
        assert data["exists"].attrs["flag_meanings"] == "phantom real"
        np.testing.assert_array_equal(data["exists"].attrs["flag_values"], [0, 1])
        assert data["exists"].dtype == np.int8
        assert data.attrs["kind"] == "test-kind"
        assert data.attrs["digest"] == "ab" * 32
        assert data.attrs["solver_version"] == "1.2.3"
        assert data.attrs["created"] == "2026-01-01T00:00:00.000+00:00"
        assert data.attrs["request"] == '{"system":"§"}'
        assert json.loads(data.attrs["plan"])["flops"] == 0.0


def test_arrays_bring_their_other_coordinates_along() -> None:
    with xarray.open_dataset(
        io.BytesIO(hdf5.to_hdf5(content(result()))), engine="h5netcdf"
    ) as file:
        assert set(file.x.coords) == {"Omega", "omega", "dof"}
        assert file.omega.encoding.get("coordinates") is None
        assert "coordinates" not in file.omega.attrs


def test_paths_of_the_file_are_those_of_the_document() -> None:
    with in_hdf5(hdf5.to_hdf5(content(result(spread=np.full(3, 1e-16))))) as file:
        assert file["frequency/Omega"] == file["Omega"]
        assert file["frequency/omega"] == file["omega"]
        assert file["error/spread"].dims[0][0] == file["Omega"]
        assert file["error"].attrs["statement"] == "a bound"


def test_without_units_everything_is_dimensionless() -> None:
    with in_hdf5(hdf5.to_hdf5(content(result(), units=None))) as file:
        assert file["x"].attrs["units"] == "1"


@pytest.mark.parametrize(
    ("dimension", "expected"),
    [("1", "1"), ("length", "m"), ("mass length2 time-2", "J"), ("rad time-1", "rad/s")],
)
def test_units_are_put_in_place_of_dimensions(dimension: str, expected: str) -> None:
    assert hdf5.unit(dimension, HEAD["units"]) == expected


def test_large_arrays_are_chunked_compressed_and_checked() -> None:
    with in_hdf5(hdf5.to_hdf5(content(result(2000, 300)))) as file:
        large, small = file["x"], file["Omega"]
        assert (large.compression, large.shuffle, large.fletcher32) == ("gzip", True, True)
        assert large.chunks == (436, 300)
        assert small.chunks is None


def test_one_result_has_one_encoding() -> None:
    first, second = content(result(2000, 30)), encode.describe(result(2000, 30), HEAD)
    assert encode.to_json(first) == encode.to_json(second)
    assert hdf5.to_hdf5(first) == hdf5.to_hdf5(second)


def test_a_request_longer_than_an_attribute_message_is_kept() -> None:
    request = json.dumps({"system": list(range(100_000))})
    with in_hdf5(hdf5.to_hdf5(content(result(), request=request))) as file:
        assert file.attrs["request"] == request


@pytest.mark.parametrize(
    ("dimension", "units", "expected"),
    [
        ("mass length time-2", ("kg", "m", "s"), "N"),
        ("mass length time-2", ("t", "mm", "s"), "N"),
        ("mass length time-2", ("kg", "mm", "ms"), "kN"),
        ("mass length2 time-2", ("t", "mm", "s"), "mJ"),
        ("mass time-2", ("t", "mm", "s"), "kN/m"),
        ("mass length time-1", ("kg", "m", "s"), "kg m/s"),
        ("length time-1", ("kg", "mm", "s"), "mm/s"),
        ("mass length time-2", ("lb", "in", "s"), "lb in/s2"),
        ("time-1", ("kg", "m", "ms"), "rad/ms"),
        ("time-3", ("kg", "m", "s"), "1/s3"),
        ("mass length time-2", ("kg", "cm", "s"), "kg cm/s2"),
    ],
)
def test_units_as_engineers_write_them(
    dimension: str, units: tuple[str, str, str], expected: str
) -> None:
    names = dict(zip(("mass", "length", "time"), units, strict=True))
    assert hdf5.unit(dimension, names) == expected


def test_numbers_and_dimensions_of_documents_are_in_files_too() -> None:
    """What JSON has under ``count``, ``of`` and ``dimensions`` a file has under the same paths."""
    meanings = {
        "impulse": Quantity(("gap", "frequency"), "1", "impulse"),
        "Omega": Quantity(("frequency",), "time-1", "frequency", True, path="frequency/Omega"),
        "count_impacts": Quantity((), "1", "number of impacts", path="count/impacts"),
        "of": Quantity((), "1", "kind of the base", path="of"),
    }
    arrays = {"impulse": np.zeros((2, 3)), "Omega": np.ones(3)}
    plain = {"count_impacts": 7, "of": "impact-modes"}
    content = Content(arrays, meanings, plain, HEAD, free=True)
    document = orjson.loads(encode.to_json(content))
    with h5py.File(io.BytesIO(hdf5.to_hdf5(content))) as file:
        assert file["count/impacts"][()] == document["count"]["impacts"] == 7
        assert file["count/impacts"].attrs["long_name"] == "number of impacts"
        assert file.attrs["of"] == document["of"]
        assert set(file["dimensions"].attrs) >= set(document["dimensions"])
        assert file["dimensions"].attrs["impulse"] == "gap Omega"
