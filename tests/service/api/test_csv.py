"""Results as CSV: one table of a result, its numbers to the bit."""

from __future__ import annotations

import csv
import io
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from vibroimpact_service.results import representations

CSV = {"Accept": "text/csv"}
HISTORY = {
    "system": {"preset": "chain", "n": 3, "constraints": [{"dof": 1, "gap": 0.2}]},
    "initial": {"x": [0, 0, 0], "v": [0, 1, 0]},
    "t_end": 5,
    "t": {"num": 4},
    "outputs": ["x", "impacts"],
}
SWEEP = {
    "kind": "impact-modes",
    "base": {
        "system": {"preset": "chain", "n": 3, "constraints": [{"dof": 1, "gap": 0.2}]},
        "frequency": {"values": [2.0, 2.5]},
        "outputs": ["impulse", "exists", "reason"],
    },
    "axes": [
        {"path": "system.constraints.0.gap", "values": [0.1, 0.2, 0.3]},
        {"path": "system.stiffness", "values": [1.0, 1.1]},
    ],
}


def table(http: TestClient, kind: str, body: Any, name: str = "") -> list[dict[str, str]]:
    path = f"/v1/compute/{kind}" + (f"?table={name}" if name else "")
    answer = http.post(path, json=body, headers=CSV)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "text/csv; charset=utf-8"
    return list(csv.DictReader(io.StringIO(answer.text)))


@pytest.mark.needs("compiled kernels")
def test_a_table_has_the_numbers_of_the_document(http: TestClient) -> None:
    shown = http.post("/v1/compute/time-history", json=HISTORY).json()
    rows = table(http, "time-history", HISTORY, "impacts")
    assert len(rows) == len(shown["impacts"]["time"]) > 2
    for name in ("time", "velocity", "impulse"):
        assert [float(row[name]) for row in rows] == shown["impacts"][name]
    assert [row["law"] for row in rows] == shown["impacts"]["law"]
    assert [float(row["error.time"]) for row in rows] == shown["error"]["impacts"]["time"]
    times = table(http, "time-history", HISTORY)
    assert [float(row["t"]) for row in times] == shown["t"]
    assert [[float(row[f"x[{k}]"]) for k in range(3)] for row in times] == shown["x"]


@pytest.mark.needs("compiled kernels")
def test_rows_of_a_sweep_are_its_points(http: TestClient) -> None:
    shown = http.post("/v1/compute/sweep", json=SWEEP).json()
    rows = table(http, "sweep", SWEEP)
    assert len(rows) == 6
    gaps = [float(row["axes.gap"]) for row in rows]
    assert gaps == [0.1, 0.1, 0.2, 0.2, 0.3, 0.3]
    impulse = np.array(shown["impulse"]).reshape(6, 2)
    assert [[float(row[f"impulse[{k},0]"]) for k in range(2)] for row in rows] == impulse.tolist()
    assert {row["exists[0]"] for row in rows} <= {"true", "false"}
    long = table(http, "sweep", SWEEP, "gap,stiffness,frequency")
    assert len(long) == 12
    assert [float(row["impulse[0]"]) for row in long] == impulse.ravel().tolist()
    assert [float(row["frequency.Omega"]) for row in long[:2]] == [2.0, 2.5]


@pytest.mark.needs("compiled kernels")
def test_a_stored_result_is_sent_as_tables_with_their_own_tags(http: TestClient) -> None:
    made = http.post("/v1/compute/time-history", json=HISTORY)
    place = made.headers["content-location"]
    impacts = http.get(f"{place}?table=impacts", headers=CSV)
    times = http.get(place, headers=CSV)
    assert impacts.status_code == times.status_code == 200
    assert len({made.headers["etag"], impacts.headers["etag"], times.headers["etag"]}) == 3
    known = {**CSV, "If-None-Match": impacts.headers["etag"]}
    assert http.get(f"{place}?table=impacts", headers=known).status_code == 304
    missing = http.get(f"{place}?table=springs", headers=CSV)
    assert missing.status_code == 400
    assert "impacts" in missing.json()["detail"]


@pytest.mark.needs("compiled kernels")
def test_what_is_large_is_not_sent_as_text(
    http: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(representations, "LARGE", 100)
    refused = http.post("/v1/compute/time-history", json=HISTORY, headers=CSV)
    assert refused.status_code == 406
    assert "x-hdf5" in refused.json()["detail"]
