"""Files of every format, sent as they are: the service stores what the client reads."""

from __future__ import annotations

import gzip
import io
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from httpx2 import Response
from starlette.testclient import TestClient

import vibroimpact as vi
from tests.client import model_files
from tests.client import program_files as programs
from tests.client.model_files import dense
from tests.schema.files.uploads import FORMATS, MODEL, write

ROUTE = "/v1/systems"
Files = Sequence[tuple[str, str, bytes]]
"""Part, name of the file, content."""


def _post(http: TestClient, files: Files) -> Response:
    return http.post(ROUTE, files=[(part, (name, data)) for part, name, data in files])


def _stored(http: TestClient, files: Files) -> dict[str, Any]:
    answer = _post(http, files)
    assert answer.status_code in (200, 201), answer.text
    document: dict[str, Any] = http.get(f"{ROUTE}/{answer.json()['id']}").json()
    return document | {"answer": answer.json()}


@pytest.mark.parametrize("form", FORMATS)
def test_the_service_reads_what_the_client_reads(
    http: TestClient, tmp_path: Path, form: str
) -> None:
    model = vi.read_model(*write(tmp_path, FORMATS[form]))
    files = [("file", name, data) for name, data in FORMATS[form].items()]
    system = _stored(http, files)
    assert system["answer"]["unused"] == []
    for name in ("M", "K", "C"):
        given = getattr(model, name)
        assert (given is None) == (name not in system)
        if given is not None:
            assert np.array_equal(dense(system[name]), given.toarray())
            rtol = {"dmig": 1e-8, "dmig small": 5e-3}.get(form, 1e-13)
            np.testing.assert_allclose(given.toarray(), MODEL[name], rtol=rtol)
    # The same structure as JSON has the same id, and so has it in another order of the files.
    again = http.post(ROUTE, json=model.system([]))
    assert (again.status_code, again.json()["id"]) == (200, system["answer"]["id"])
    assert _post(http, files[::-1]).json()["id"] == system["answer"]["id"]


def test_full_matrices_have_the_id_of_their_rows(http: TestClient) -> None:
    full = np.add.outer(np.arange(1.0, 5.0), np.arange(1.0, 5.0)) + 9.0 * np.eye(4)
    text = model_files.rows(full).encode()
    sent = _post(http, [("M", "any.csv", text), ("K", "other.csv", text)])
    spelled = {"M": full.tolist(), "K": full.tolist(), "constraints": []}
    assert http.post(ROUTE, json=spelled).json()["id"] == sent.json()["id"]


def test_parts_name_matrices_that_files_do_not(http: TestClient) -> None:
    first, second = model_files.market(MODEL["M"]), model_files.rows(MODEL["K"])
    files = [("M", "first.mtx", first.encode()), ("K", "second.csv.gz", gzip.compress(second.encode()))]  # fmt: skip # noqa: E501
    system = _stored(http, files)
    assert np.array_equal(dense(system["M"]), MODEL["M"])
    assert np.array_equal(dense(system["K"]), MODEL["K"])
    alone = _stored(http, [("file", "second.csv", second.encode())])
    assert np.array_equal(dense(alone["M"]), np.eye(6))
    answer = _post(http, [("file", "mass.csv", second.encode())])
    assert answer.status_code == 422
    assert answer.json()["detail"] == "/K: no file has the stiffness K; there is M"


def test_rows_of_lists_are_placed_by_their_nodes(http: TestClient, tmp_path: Path) -> None:
    """The mass leaves out a node without mass: its rows are not those of the stiffness."""
    light = MODEL["M"].copy()
    light[2] = light[:, 2] = 0.0
    contents = {"job_MASS1.mtx": model_files.abaqus(light).encode(),
                "job_STIF1.mtx": model_files.abaqus(MODEL["K"]).encode()}  # fmt: skip
    system = _stored(http, [("file", name, data) for name, data in contents.items()])
    assert np.array_equal(dense(system["M"]), light)
    model = vi.read_model(*write(tmp_path, contents))
    assert np.array_equal(model.M.toarray(), light)


def test_what_is_not_used_is_named(http: TestClient) -> None:
    beside = {"MGG": MODEL["M"], "KGG": MODEL["K"], "PHG": MODEL["K"][:, :2].copy(),
              "K4GG": MODEL["C"]}  # fmt: skip
    data = programs.op4_text(beside).encode()
    assert _stored(http, [("file", "a.op4", data)])["answer"]["unused"] == ["PHG", "K4GG"]
    assert http.post(ROUTE, json={"preset": "chain", "n": 3, "constraints": []}).json()[
        "unused"
    ] == []  # fmt: skip


def _zip(content: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("K.npy", content)
    return buffer.getvalue()


K = ("K", "K.mtx", model_files.market(MODEL["K"]).encode())
WRONG: dict[str, tuple[Files, int, str, str, str]] = {
    "a line": (
        [K, ("M", "m.mtx", b"%%MatrixMarket matrix coordinate real general\n1 1 1\n1 1 1,5\n")],
        400, "/M", "malformed_file", "m.mtx: line 3: '1,5' has a decimal comma; write a point"),
    "not finite": (
        [K, ("M", "m.csv", b"1,nan\n0,1\n")],
        422, "/M", "not_finite", "m.csv: line 1: 'nan' is not a finite number"),
    "not symmetric": (
        [("file", "K.csv", b"1,2\n3,1\n")],
        422, "/K", "not_symmetric",
        "K is not symmetric: entries (0, 1) and (1, 0) differ by 0.33 of the largest entry"),
    "not square": (
        [("K", "K.csv", b"1,2,3,4\n3,1,2,4\n")], 400, "/K", "malformed_file",
        "K is not square: (2, 4)"),
    "too many rows": (
        [("K", "K.mtx", b"%%MatrixMarket matrix coordinate real general\n9999 9999 1\n1 1 1\n")],
        413, "/K", "too_many_dofs", "K.mtx: a matrix of 9999 rows; at most 500 are read"),
    "a bomb": (
        [K, ("file", "M.mtx.gz", gzip.compress(bytes(2**27)))],
        413, "/file", "file_too_large", "M.mtx.gz: unpacked it is larger than 1048228 bytes"),
    "a bomb of numpy": (
        [K, ("M", "M.npz", _zip(bytes(2**27)))],
        413, "/M", "file_too_large", "M.npz: unpacked it is larger than 1048228 bytes"),
    "of Matlab": (
        [("file", "wing.mat", b"MATLAB 7.3")], 400, "/file", "malformed_file",
        "wing.mat: known are files ending in .npz, .npy, .mtx, .sti, .mas, .matrix"),
    "a pickle": (
        [("K", "K.npy", b"\x80\x04\x95cos\nsystem\n(S'true'\ntR.")],
        400, "/K", "malformed_file", "K.npy: it is no array of numpy"),
    "no name": (
        [K, ("file", "one.csv", b"1,2\n2,1\n")],
        400, "/file", "malformed_file", "one.csv: its name does not tell which matrix it is"),
    "of the system": (
        [K, ("M", "M.csv", b"1\n")], 422, "/K", "wrong_size", ""),
    "labels alone": (
        [K, ("file", "job.dof", b"1.1\n")],
        422, "/file", "unused_file", "job.dof: there is no file of a matrix with the same name"),
    "labels of others": (
        [("file", "job.sti", b"1 1 2.0\n2 2 2.0\n"), ("file", "job.dof", b"1.1\n")],
        400, "/file", "malformed_file", "job.dof: it has 1 rows; the matrix has 2 in job.sti"),
    "another part": ([("stiffness", "K.mtx", K[2])], 422, "", "unknown_part",
                     "parts are called M, K, C or file, not 'stiffness'"),
    "many parts": ([("file", f"{k}.csv", b"1\n") for k in range(33)], 413, "", "too_many_parts",
                   "The body has more than 32 parts."),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_the_part_that_is_wrong_is_named(http: TestClient, what: str) -> None:
    files, status, pointer, code, said = WRONG[what]
    answer = _post(http, files)
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    (fault,) = answer.json()["errors"]
    assert (fault["pointer"], fault["code"]) == (pointer, code)
    assert said in fault["message"]


@pytest.mark.parametrize("twice", ["M", "file"])
def test_two_files_of_one_matrix_are_refused(http: TestClient, twice: str) -> None:
    files = [K, *((twice, f"{k}/M.csv", b"1\n") for k in range(2))]
    answer = _post(http, files)
    assert answer.status_code == 400
    assert answer.json()["detail"] == "M in both M.csv and M.csv."


BOUNDARY = "multipart/form-data; boundary=x"


@pytest.mark.parametrize(
    ("content_type", "body", "said"),
    [
        ("multipart/form-data", b"--x\r\n", "names no boundary"),
        (BOUNDARY + "x" * 100, b"--x\r\n", "does not consist of parts"),
        (BOUNDARY, b"", "ends before the last"),
        (BOUNDARY, b"{}", "does not consist of parts"),
        (BOUNDARY, b"--x\r\nContent-Disposition: form-data; name=K\r\n\r\n1", "ends before"),
        (BOUNDARY, b"--x\r\n\r\n1\r\n--x--\r\n", "A part has no name"),
        (BOUNDARY, b"--x\r\n" + b"a" * 2**16 + b": b\r\n\r\n1\r\n--x--", "does not consist"),
        (BOUNDARY, b"--x\r\n" + b"a: b\r\n" * 2**16 + b"\r\n1\r\n--x--", "does not consist"),
    ],
)
def test_bodies_that_have_no_parts(
    http: TestClient, content_type: str, body: bytes, said: str
) -> None:
    answer = http.post(ROUTE, content=body, headers={"Content-Type": content_type})
    assert answer.status_code == 400
    assert said in answer.json()["detail"]


def test_nearly_symmetric_matrices_become_their_mean(http: TestClient, tmp_path: Path) -> None:
    uneven = MODEL["K"].copy()
    uneven[0, 1] *= 1 + 1e-12
    contents = {"K.csv": model_files.rows(uneven).encode(),
                "M.csv": model_files.rows(MODEL["M"]).encode()}  # fmt: skip
    system = _stored(http, [("file", name, data) for name, data in contents.items()])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = vi.read_model(*write(tmp_path, contents))
    assert np.array_equal(dense(system["K"]), model.K.toarray())
    assert np.array_equal(dense(system["K"]), 0.5 * (uneven + uneven.T))
