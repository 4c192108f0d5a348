"""Results as arrays: what their HDF5 file has, without the file."""

from __future__ import annotations

import hashlib

import pytest
from starlette.testclient import TestClient

from vibroimpact_schema import entries, examples
from vibroimpact_schema.netcdf import file_of
from vibroimpact_service.results import encoders, representations

ARRAYS, HDF5 = encoders.ARRAYS, encoders.HDF5
CLIENT = f"{ARRAYS}, {HDF5};q=0.5"
REQUEST = examples.requests("impact-modes")["chain"]["request"]
PATH = "/v1/compute/impact-modes"

pytestmark = pytest.mark.needs("compiled kernels")


def test_arrays_are_those_of_the_file(http: TestClient) -> None:
    fresh = http.post(PATH, json=REQUEST, headers={"Accept": CLIENT})
    assert fresh.headers["content-type"] == ARRAYS
    assert fresh.headers["etag"] == f'"{hashlib.sha256(fresh.content).hexdigest()}"'
    stored = http.get(fresh.headers["content-location"], headers={"Accept": ARRAYS})
    assert stored.content == fresh.content
    file = http.post(PATH, json=REQUEST, headers={"Accept": HDF5})
    assert file_of(entries.unpack(fresh.content)) == file.content
    assert file.headers["etag"] != fresh.headers["etag"]


def test_they_are_not_compressed(http: TestClient) -> None:
    headers = {"Accept": CLIENT, "Accept-Encoding": "gzip"}
    answer = http.post(PATH, json=REQUEST, headers=headers)
    assert len(answer.content) > representations._SMALLEST_CODED
    assert "content-encoding" not in answer.headers


def test_a_large_result_comes_as_its_file(
    http: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    http.post(PATH, json=REQUEST)
    monkeypatch.setattr(representations, "LARGE", 100)
    answer = http.post(PATH, json=REQUEST, headers={"Accept": CLIENT})
    assert answer.status_code == 200
    assert answer.headers["content-type"] == HDF5
    assert answer.content[1:4] == b"HDF"
