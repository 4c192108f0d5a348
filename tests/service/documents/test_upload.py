"""Matrices as files: read where they are what they claim, refused before memory is taken."""

from __future__ import annotations

import io
import tracemalloc
import zipfile
from typing import Any

import numpy as np
import pytest
from scipy import io as files
from scipy import sparse
from starlette.testclient import TestClient

from vibroimpact_service.documents import upload
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings

LIMITS = Settings(max_dofs=100)
K = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.5]])
M = np.diag([1.0, 2.0, 3.0])


def market(matrix: Any, **options: Any) -> bytes:
    buffer = io.BytesIO()
    files.mmwrite(buffer, matrix, **options)
    return buffer.getvalue()


def npy(array: Any, **options: Any) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, **options)
    return buffer.getvalue()


def dense(matrix: Any) -> Any:
    if hasattr(matrix, "row"):
        entries = (matrix.data, (matrix.row, matrix.col))
        return sparse.coo_array(entries, shape=matrix.shape).toarray()
    return np.array(matrix)


@pytest.mark.parametrize("symmetry", ["general", "symmetric"])
@pytest.mark.parametrize("make", [np.array, sparse.coo_array])
def test_matrix_market_is_read_to_the_bit(make: Any, symmetry: str) -> None:
    third = K / 3.0
    third = (third + third.T) / 2.0
    text = market(make(third), symmetry=symmetry, precision=17)
    found, _ = upload.system(upload.MATRIX_MARKET, text, LIMITS)
    assert np.array_equal(dense(found.K), third)
    assert (found.M.scalar, found.M.n) == (1.0, 3)  # type: ignore[union-attr]
    assert found.C is None


def test_matrices_follow_one_another() -> None:
    text = market(sparse.coo_array(M)) + b"\n" + market(K) + market(0.1 * K)
    found, _ = upload.system(upload.MATRIX_MARKET, text, LIMITS)
    for given, matrix in ((M, found.M), (K, found.K), (0.1 * K, found.C)):
        assert np.allclose(dense(matrix), given, rtol=1e-15)


def test_integers_comments_blank_lines_and_repeated_entries() -> None:
    text = (
        b"%%matrixmarket MATRIX Coordinate Integer symmetric\n"
        b"% made by hand\n%\n\n 2 2 4 \n1 1 2\n1 1 1\n2 1 -1\n2 2 2\n"
    ).replace(b"%%matrixmarket", b"%%MatrixMarket")
    found, _ = upload.system(upload.MATRIX_MARKET, text, LIMITS)
    assert np.array_equal(dense(found.K), [[3.0, -1.0], [-1.0, 2.0]])


@pytest.mark.parametrize("dtype", ["<f8", ">f8", "<f4", "<i8", "|u1"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_npy_is_read_to_the_bit(dtype: str, order: str) -> None:
    stack = np.array([M, abs(K)]).astype(dtype).copy(order)  # type: ignore[call-overload]
    found, _ = upload.system(upload.NPY, npy(stack), LIMITS)
    assert np.array_equal(dense(found.M), stack[0])
    assert np.array_equal(dense(found.K), stack[1])
    alone, _ = upload.system(upload.NPY, npy(stack[1]), LIMITS)
    assert np.array_equal(dense(alone.K), stack[1])


HEADER = b"%%MatrixMarket matrix coordinate real general\n"


@pytest.mark.parametrize(
    ("text", "status"),
    [
        (b"", 400),
        (b"hello", 400),
        (b"junk " + HEADER + b"1 1 1\n1 1 1\n", 400),
        (HEADER, 400),
        (HEADER + b"% only comments\n" * 50, 400),
        (HEADER + b"2 2\n1 1 1\n", 400),
        (HEADER + b"2 3 1\n1 1 1\n", 400),
        (HEADER + b"0 0 0\n", 400),
        (HEADER + b"-1 -1 1\n1 1 1\n", 400),
        (HEADER + b"2 2 100000000\n1 1 1.0\n", 400),
        (HEADER + b"101 101 1\n1 1 1.0\n", 413),
        (HEADER + b"100000000 100000000 1\n1 1 1.0\n", 413),
        (HEADER + b"99999999999999999999 1 1\n1 1 1.0\n", 400),
        (HEADER + b"2 2 2\n1 1 1.0\n", 400),
        (HEADER + b"2 2 1\n3 3 1.0\n", 400),
        (HEADER + b"2 2 1\n0 1 1.0\n", 400),
        (HEADER + b"2 2 1\n1 1 one\n", 400),
        (HEADER + b"1 1 1\n1 1 nan\n", 422),
        (HEADER + b"1 1 1\n1 1 inf\n", 422),
        (b"%%MatrixMarket matrix array real general\n100 100\n1\n", 400),
        (b"%%MatrixMarket matrix coordinate pattern general\n1 1 1\n1 1\n", 400),
        (b"%%MatrixMarket matrix coordinate complex general\n1 1 1\n1 1 1 0.1\n", 400),
        (b"%%MatrixMarket matrix array complex general\n1 1\n1 0.1\n", 400),
        (HEADER + b"1 1 1\n1 1 1,5\n", 400),
        (HEADER + b"1 1 1\n1 1 0x10\n", 400),
        (HEADER + b"1 1 1\n1 1 1 2\n", 400),
        (HEADER + b"1 1 1\n1 1 1e999\n", 422),
        (HEADER + b"2 2 1\n1 1 1\n2 2 2\n", 400),
        (HEADER + b"1 1 1\n1 1 2.5\0", 400),
        (HEADER + b"1.0 1 1\n1 1 2.5\n", 400),
        (HEADER + b"1 1 1\n1.5 1 2.5\n", 400),
        (b"1 1 1\n1 1 1\n", 400),
        (b"%%MatrixMarket matrix coordinate real skew-symmetric\n2 2 1\n2 1 1\n", 400),
        (b"%%MatrixMarket vector coordinate real general\n1 1\n1 1\n", 400),
        ((HEADER + b"1 1 1\n1 1 1\n") * 4, 400),
        ((HEADER + b"1 1 1\n1 1 1\n") * 1000, 400),
    ],
)
def test_texts_that_are_none(text: bytes, status: int) -> None:
    with pytest.raises(ProblemError) as error:
        upload.system(upload.MATRIX_MARKET, text, LIMITS)
    assert error.value.type.status == status


@pytest.mark.parametrize(
    ("value", "number"), [("2.0D3", 2e3), ("-2.0d-03", -2e-3), ("2.5 ", 2.5), ("2.5\t", 2.5)]
)
@pytest.mark.parametrize("end", ["", "\n", "\r", "\r\n", " ", "\t"])
def test_numbers_that_other_readers_cut_or_end_at(value: str, number: float, end: str) -> None:
    text = HEADER + f"1 1 1\n1 1 {value}{end}".encode()
    assert dense(upload.system(upload.MATRIX_MARKET, text, LIMITS)[0].K).tolist() == [[number]]


@pytest.mark.parametrize("text", [market(np.tril(K)), market(sparse.coo_array(np.triu(K)))])
def test_a_triangle_stands_for_the_whole(text: bytes) -> None:
    assert dense(upload.system(upload.MATRIX_MARKET, text, LIMITS)[0].K).tolist() == K.tolist()


def test_the_line_at_fault_is_told() -> None:
    text = market(M) + b"% and K\n" + HEADER + b"2 2 2\n1 1 1.0\n2 2 1,5\n"
    line = text[: text.index(b"1,5")].count(b"\n") + 1
    with pytest.raises(ProblemError, match=f"Line {line}: '1,5' has a decimal comma"):
        upload.system(upload.MATRIX_MARKET, text, LIMITS)


def header(text: str, version: bytes = b"\x01\x00") -> bytes:
    width = 2 if version[0] == 1 else 4
    return b"\x93NUMPY" + version + len(text).to_bytes(width, "little") + text.encode()


def archive(name: str) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr(name, bytes(10**6))
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("data", "status"),
    [
        (b"", 400),
        (b"\x93NUMPY", 400),
        (b"\x93NUMPY\x01\x00\xff\xff", 400),
        (b"\x93NUMPY\x03\x00" + bytes(20), 400),
        (npy(K)[:-1], 400),
        (npy(K) + b"\0", 400),
        (npy(np.ones((2, 3))), 400),
        (npy(np.ones((4, 2, 2))), 400),
        (npy(np.ones((0, 0))), 400),
        (npy(np.ones((101, 101))), 413),
        (npy(np.ones((2, 2)) * (1 + 0.1j)), 400),
        (npy(np.array([["a"]])), 400),
        (npy(np.array([[None]]), allow_pickle=True), 400),
        (npy(np.zeros((1, 1), [("a", float)])), 400),
        (npy(np.array([[np.nan]])), 422),
        (header("{'descr': '<f8', 'fortran_order': False, 'shape': (10**8, 10**8)}\n"), 400),
        (header("{'descr': '<f8', 'fortran_order': False, 'shape': (99999999, 99999999)}\n"), 413),
        (header("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, -1)}\n"), 400),
        (header("{'descr': '|O', 'fortran_order': False, 'shape': (1, 1)}\n") + bytes(8), 400),
        (header("{'descr': '<f8', 'fortran_order': False, 'shape': (True, True)}\n"), 400),
        (header("{'descr': '<f1', 'fortran_order': False, 'shape': (1, 1)}\n") + bytes(8), 400),
        (header("(" * 3000), 400),
        (header("__import__('os').system('true')\n"), 400),
        (header("{" * 60_000, b"\x02\x00"), 400),
        (archive("K.npy"), 400),
        (b"\x89HDF\r\n\x1a\n" + bytes(100), 400),
    ],
)
def test_arrays_that_are_none(data: bytes, status: int) -> None:
    with pytest.raises(ProblemError) as error:
        upload.system(upload.NPY, data, LIMITS)
    assert error.value.type.status == status


@pytest.mark.parametrize(
    ("media_type", "data"),
    [
        (upload.MATRIX_MARKET, HEADER + b"5000 5000 25000000\n1 1 1.0\n"),
        (upload.MATRIX_MARKET, b"%%MatrixMarket matrix array real general\n5000 5000\n1\n"),
        (upload.NPY, header("{'descr': '<f8', 'fortran_order': False, 'shape': (5000, 5000)}\n")),
    ],
)
def test_claims_take_no_memory(media_type: str, data: bytes) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(ProblemError):
            upload.system(media_type, data, Settings())
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2**20


def test_a_file_stands_for_its_matrices(http: TestClient) -> None:
    sent = {"content": npy(np.array([M, K])), "headers": {"Content-Type": upload.NPY}}
    new = http.post("/v1/systems", **sent)
    assert (new.status_code, new.json()["n"], new.json()["constraints"]) == (201, 3, 0)
    assert http.post("/v1/systems", **sent).status_code == 200
    reference = {"id": new.json()["id"], "constraints": [{"dof": 0, "gap": 0.1}]}
    frequency = {"values": [1.0, 2.0]}
    body = {"system": reference, "frequency": frequency}
    by_file = http.post("/v1/compute/impact-modes", json=body)
    body["system"] = {"M": M.tolist(), "K": K.tolist(), "constraints": reference["constraints"]}
    spelled = http.post("/v1/compute/impact-modes", json=body)
    assert by_file.json()["impulse"] == spelled.json()["impulse"]


def test_files_that_are_no_systems(http: TestClient) -> None:
    wrong = {"content": npy(np.array([[1.0, 2.0], [3.0, 1.0]]))}
    answer = http.post("/v1/systems", **wrong, headers={"Content-Type": upload.NPY})
    assert (answer.status_code, answer.json()["errors"][0]["pointer"]) == (422, "/K")
    for media_type in ("application/x-hdf5", "application/zip", "application/octet-stream"):
        answer = http.post("/v1/systems", **wrong, headers={"Content-Type": media_type})
        assert answer.status_code == 415
        assert "application/x-npy" in answer.headers["accept"]
