"""/v1/results and /v1/systems: immutable things by name."""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
from typing import Any

import h5py
import numpy as np
import pytest
import zstandard
from starlette.testclient import TestClient

from vibroimpact_service.api import answers
from vibroimpact_service.app import create_app
from vibroimpact_service.results import representations

HDF5 = {"Accept": "application/x-hdf5"}


def unzstd(data: bytes) -> bytes:
    return zstandard.ZstdDecompressor().decompress(data)


@pytest.fixture
def address(http: TestClient, request_body: dict[str, Any]) -> str:
    answer = http.post("/v1/compute/impact-modes", json=request_body)
    return str(answer.headers["content-location"])


@pytest.mark.parametrize("accept", ["application/json", "application/x-hdf5"])
def test_a_result_never_changes(http: TestClient, address: str, accept: str) -> None:
    first = http.get(address, headers={"Accept": accept})
    assert first.status_code == 200
    assert first.headers["content-type"] == accept
    assert "immutable" in first.headers["cache-control"]
    sha256 = hashlib.sha256(first.content)
    assert first.headers["etag"] == f'"{sha256.hexdigest()}"'
    encoded = base64.b64encode(sha256.digest()).decode()
    assert first.headers["repr-digest"] == f"sha-256=:{encoded}:"
    assert http.get(address, headers={"Accept": accept}).content == first.content


def test_the_two_representations_have_tags_of_their_own(http: TestClient, address: str) -> None:
    json_, hdf5 = http.get(address), http.get(address, headers=HDF5)
    assert json_.headers["etag"] != hdf5.headers["etag"]
    assert json_.headers["vary"] == hdf5.headers["vary"] == "Accept, Accept-Encoding"
    condition = {"If-None-Match": f"{json_.headers['etag']}, {hdf5.headers['etag']}"}
    for more in ({}, HDF5):
        answer = http.get(address, headers={**condition, **more})
        assert (answer.status_code, answer.content) == (304, b"")
        assert "content-type" not in answer.headers


def test_head_says_what_get_would(http: TestClient, address: str) -> None:
    get, head = http.get(address, headers=HDF5), http.head(address, headers=HDF5)
    assert head.status_code == 200
    assert head.content == b""
    varying = {"x-request-id", "date"}
    assert {k: v for k, v in head.headers.items() if k not in varying} == {
        k: v for k, v in get.headers.items() if k not in varying
    }


def test_parts_make_up_the_whole(http: TestClient, address: str) -> None:
    whole = http.get(address, headers=HDF5)
    assert whole.headers["accept-ranges"] == "bytes"
    size, parts = len(whole.content), []
    for first in range(0, size, 1000):
        last = min(first + 999, size - 1)
        part = http.get(address, headers={**HDF5, "Range": f"bytes={first}-{last}"})
        assert part.status_code == 206
        assert part.headers["content-range"] == f"bytes {first}-{last}/{size}"
        assert part.headers["etag"] == whole.headers["etag"]
        assert part.headers["content-type"] == "application/x-hdf5"
        parts.append(part.content)
    assert b"".join(parts) == whole.content


@pytest.mark.parametrize(("coding", "plain"), [("gzip", gzip.decompress), ("zstd", unzstd)])
def test_json_is_compressed_where_that_is_accepted(
    http: TestClient, request_body: dict[str, Any], coding: str, plain: Any
) -> None:
    request_body["frequency"]["num"] = 1000
    identity = {"Accept-Encoding": "identity"}
    whole = http.post("/v1/compute/impact-modes", json=request_body, headers=identity)
    where = whole.headers["content-location"]
    with http.stream("GET", where, headers={"Accept-Encoding": coding}) as coded:
        raw = b"".join(coded.iter_raw())
    assert coded.headers["content-encoding"] == coding
    assert len(raw) < len(whole.content) / 2
    assert plain(raw) == whole.content
    sha256 = hashlib.sha256(raw)
    assert coded.headers["etag"] == f'"{sha256.hexdigest()}"' != whole.headers["etag"]
    assert base64.b64encode(sha256.digest()).decode() in coded.headers["repr-digest"]
    again = {"Accept-Encoding": coding, "If-None-Match": coded.headers["etag"]}
    assert http.get(where, headers=again).status_code == 304
    # Ranges are of the bytes without coding; HDF5 is compressed inside.
    part = http.get(where, headers={"Accept-Encoding": coding, "Range": "bytes=0-9"})
    assert (part.status_code, part.content) == (206, whole.content[:10])
    file = http.get(where, headers={"Accept-Encoding": coding, **HDF5})
    assert "content-encoding" not in file.headers


def test_a_large_result_is_sent_from_its_file(
    http: TestClient, address: str, monkeypatch: pytest.MonkeyPatch, settings: Any
) -> None:
    whole = http.get(address, headers=HDF5)
    for part in settings.data.glob("store/results/*/*.h5"):
        part.unlink()
    monkeypatch.setattr(representations, "LARGE", 100)
    monkeypatch.setattr(answers, "_PIECE", 1000)
    with TestClient(create_app(settings, http.app.state.services.evaluation.queue)) as fresh:
        streamed = fresh.get(address, headers=HDF5)
        assert streamed.headers["etag"] == f'"{hashlib.sha256(streamed.content).hexdigest()}"'
        with (
            h5py.File(io.BytesIO(whole.content)) as first,
            h5py.File(io.BytesIO(streamed.content)) as second,
        ):
            assert list(first) == list(second)
            assert np.array_equal(first["impulse"], second["impulse"])
        assert int(streamed.headers["content-length"]) == len(streamed.content)
        head = fresh.head(address, headers=HDF5)
        assert (head.headers["content-length"], head.content) == (
            streamed.headers["content-length"],
            b"",
        )
        part = fresh.get(address, headers={**HDF5, "Range": "bytes=500-2499"})
        assert (part.status_code, part.content) == (206, streamed.content[500:2500])
        text = fresh.get(address)
        assert (text.status_code, text.json()["code"]) == (406, "not_acceptable")


def test_ranges_that_cannot_be(http: TestClient, address: str) -> None:
    size = len(http.get(address, headers=HDF5).content)
    beyond = http.get(address, headers={**HDF5, "Range": f"bytes={size}-"})
    assert beyond.status_code == 416
    assert beyond.headers["content-range"] == f"bytes */{size}"
    assert beyond.headers["content-type"] == "application/problem+json"
    for whole in ("bytes=0-1,5-6", "lines=1-2", "bytes=x"):
        assert http.get(address, headers={**HDF5, "Range": whole}).status_code == 200


def test_a_range_of_something_else_gets_the_whole(http: TestClient, address: str) -> None:
    etag = http.get(address, headers=HDF5).headers["etag"]
    same = {**HDF5, "Range": "bytes=0-9", "If-Range": etag}
    assert http.get(address, headers=same).status_code == 206
    assert http.get(address, headers={**same, "If-Range": '"other"'}).status_code == 200


@pytest.mark.parametrize("name", ["0" * 64, "x", "A" * 64, "0" * 65, "..%2f..%2fetc"])
def test_unknown_results_are_not_found(http: TestClient, name: str) -> None:
    answer = http.get(f"/v1/results/{name}")
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.headers["cache-control"] == "no-store"


def test_a_stored_system_stands_for_itself(
    http: TestClient, chain: dict[str, Any], request_body: dict[str, Any]
) -> None:
    new = http.post("/v1/systems", json=chain)
    assert new.status_code == 201
    known = http.post("/v1/systems", json={**chain, "stiffness": 1.0})
    assert known.status_code == 200
    assert known.json() == new.json() == {
        "id": new.json()["id"], "n": 13, "constraints": 1, "unused": [],
    }  # fmt: skip
    address = new.headers["location"]
    stored = http.get(address)
    assert stored.json()["n"] == 13
    assert http.head(address).headers["etag"] == stored.headers["etag"]
    etag = {"If-None-Match": stored.headers["etag"]}
    assert http.get(address, headers=etag).status_code == 304
    reference = {"id": new.json()["id"]}
    by_name = http.post("/v1/compute/impact-modes", json={**request_body, "system": reference})
    spelled = http.post("/v1/compute/impact-modes", json=request_body)
    assert by_name.json()["impulse"] == spelled.json()["impulse"]
    moved = {**reference, "constraints": [{"dof": 0, "gap": 1}]}
    other = http.post("/v1/compute/impact-modes", json={**request_body, "system": moved})
    assert other.json()["impulse"] != spelled.json()["impulse"]


def test_wrong_systems_are_pointed_at_and_not_stored(http: TestClient, queue: Any) -> None:
    body = {"M": [[1, 2], [2, 1]], "K": [[1, 0], [0, 1]], "constraints": []}
    answer = http.post("/v1/systems", json=body)
    assert (answer.status_code, answer.json()["errors"][0]["pointer"]) == (422, "/M")
    answer = http.post("/v1/systems", json={"preset": "chain", "n": 501, "constraints": []})
    assert (answer.status_code, answer.json()["errors"][0]["pointer"]) == (413, "")
    answer = http.post("/v1/systems", json={"id": "sys_" + "0" * 64})
    assert (answer.status_code, answer.json()["errors"][0]["pointer"]) == (422, "/id")
    unknown = http.post(
        "/v1/compute/impact-modes",
        json={"system": {"id": "sys_" + "0" * 64}, "frequency": {"values": [1]}},
    )
    assert unknown.json()["errors"][0]["pointer"] == "/system/id"
    for name in ("sys_" + "0" * 64, "sys_x", "x"):
        assert http.get(f"/v1/systems/{name}").status_code == 404
