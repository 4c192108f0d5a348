"""A data folder written by version 0.1.0 is read: jobs, results, systems, keys, pinned results.

The folder and what 0.1.0 itself answered about it are in ``tests/reference/data-0.1.0.tar.xz``,
made by ``tests/reference/make_data.py`` with the environment of a checkout of v0.1.0.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import sqlalchemy as sa
from starlette.testclient import TestClient

from vibroimpact_service.app import create_app
from vibroimpact_service.jobs.database import open_database
from vibroimpact_service.jobs.tables import pins
from vibroimpact_service.settings import Settings

ARCHIVE = Path(__file__).parents[1] / "reference" / "data-0.1.0.tar.xz"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return the folder with ``data`` and ``answers.json``."""
    with tarfile.open(ARCHIVE) as tar:
        # Python 3.11.2, that of Debian 12, knows no filters.
        tar.extraction_filter = getattr(tarfile, "data_filter", None)
        tar.extractall(tmp_path)
    return tmp_path


@pytest.fixture
def settings(folder: Path) -> Settings:
    return Settings(data=folder / "data", workers=1, hosts=("testserver",))


@pytest.fixture
def answers(folder: Path) -> dict[str, Any]:
    """Return what 0.1.0 answered."""
    return dict(json.loads((folder / "answers.json").read_text()))


@pytest.fixture
def client(http: TestClient, answers: dict[str, Any]) -> TestClient:
    """Return a client of today's service, without workers, with the key that 0.1.0 made."""
    http.headers["Authorization"] = f"Bearer {answers['key']}"
    return http


def test_the_key_is_needed_and_valid(client: TestClient) -> None:
    assert client.get("/v1/jobs").status_code == 200
    assert client.get("/v1/jobs", headers={"Authorization": "Bearer wrong"}).status_code == 401


def test_jobs_are_listed_as_they_ended(settings: Settings, answers: dict[str, Any]) -> None:
    with TestClient(create_app(settings)) as client:  # with the real queue and its records
        client.headers["Authorization"] = f"Bearer {answers['key']}"
        jobs = client.get("/v1/jobs").json()["jobs"]
        assert [job | {"history": None, "name": None} for job in answers["jobs"]] == jobs
        assert {job["state"] for job in jobs} == {"succeeded", "failed", "cancelled"}
        for job in jobs:
            alone = client.get(f"/v1/jobs/{job['id']}").json()
            assert alone | {"history": None} == job
            assert len(alone["history"]) == min(1, job["attempts"])
            if job["result"] is not None:
                assert client.get(job["result"]).json() == answers["results"][job["digest"]]


def test_pinned_results_are_pinned(settings: Settings, answers: dict[str, Any]) -> None:
    engine = open_database(settings.database_url)
    with engine.connect() as connection:
        pinned = connection.execute(sa.select(pins.c.owner, pins.c.result)).all()
        assert pinned == [("ann", result) for result in answers["pinned"]]
    engine.dispose()


def test_systems_are_there(client: TestClient, answers: dict[str, Any]) -> None:
    assert answers["systems"]
    for name, system in answers["systems"].items():
        assert client.get(f"/v1/systems/{name}").json() == system


@pytest.mark.parametrize("encoded_anew", [False, True])
def test_results_are_the_same_in_json(
    client: TestClient, folder: Path, answers: dict[str, Any], encoded_anew: bool
) -> None:
    assert len({result["kind"] for result in answers["results"].values()}) == 7
    if encoded_anew:  # from the container, and not the JSON that 0.1.0 stored beside it
        for file in (folder / "data" / "store" / "results").glob("*/*.json"):
            file.unlink()
    for name, result in answers["results"].items():
        assert client.get(f"/v1/results/{name}").json() == result


@pytest.mark.needs("compiled kernels")
def test_results_have_the_same_numbers_in_hdf5(client: TestClient, answers: dict[str, Any]) -> None:
    for name, result in answers["results"].items():
        answer = client.get(f"/v1/results/{name}", headers={"Accept": "application/x-hdf5"})
        assert answer.status_code == 200
        with h5py.File(io.BytesIO(answer.content)) as file:
            stored = numbers(file)
        expected = dict(columns(result))
        expected.setdefault("Omega", expected.get("frequency/Omega"))  # a coordinate in HDF5
        assert len(stored) > 3
        for path, values in stored.items():
            np.testing.assert_array_equal(
                np.where(np.isfinite(values), values, np.nan),  # JSON has null for both
                np.array(expected[path], dtype=float),
                f"{result['kind']}: {path}",
            )


def numbers(file: h5py.File) -> dict[str, np.ndarray[Any, Any]]:
    """Return the datasets of numbers by path; words and flags are stored as small integers."""
    found = {}

    def visit(path: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype in (np.float64, np.int64) and item.size:
            found[path] = item[()].astype(float)

    file.visititems(visit)
    return found


def columns(document: dict[str, Any], under: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the fields of a JSON document by path, those of a list of objects as columns."""
    for name, value in document.items():
        path = under + name
        if isinstance(value, dict):
            yield from columns(value, f"{path}/")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for column in value[0]:
                yield f"{path}/{column}", [row[column] for row in value]
        else:
            yield path, value
