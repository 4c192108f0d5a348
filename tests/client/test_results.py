"""Results: read as they are used, kept by digest, as data frames; computations in this process."""

from __future__ import annotations

import copy
import io
import json
import tracemalloc
from pathlib import Path
from typing import Any

import h5py
import httpx2
import numpy as np
import pytest

import vibroimpact as vi
from vibroimpact import conversations
from vibroimpact.cache import Cache
from vibroimpact.transport import Transport

REQUEST = {"system": {"preset": "oscillator", "Omega0": 1.0, "constraints": []}}


def content(size: int = 3, digest: str = "ab" * 32) -> bytes:
    """The file of a result with an array and a table."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs.update(
            kind="time-history", digest=digest, solver_version="1", request="{}", plan="{}"
        )
        file["x"] = np.arange(size, dtype=np.float64)
        file["x"].attrs.update(units="m", long_name="displacement")
        file["t"] = np.arange(size, dtype=np.float64)
        file["t"].attrs["units"] = "ms"
        file["impacts/time"] = np.array([1.0, np.nan])
        file["impacts/side"] = np.array([1, -1])
    return buffer.getvalue()


@pytest.mark.needs("compiled kernels")
def test_a_large_result_on_disk_takes_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "large.h5"
    path.write_bytes(content(8_000_000))  # 64 MB each
    tracemalloc.start()
    result = vi.Result(path)
    assert "x (8000000,)" in repr(result)
    with result.open() as file:
        assert file["x"][7_999_999] == 7_999_999.0
    assert result.impacts.side.tolist() == [1, -1]
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 5e6
    assert result.x.size == 8_000_000


def test_what_a_result_contains() -> None:
    """Arrays and tables by name; other names, and what is no name, are not in it."""
    result = vi.Result(content())
    for name in ("x", "t", "impacts"):
        assert name in result
    assert "side" in result.impacts
    for other in ("side", "kind", 3, None):
        assert other not in result


def test_outputs_by_name() -> None:
    """As of a dataset: by the name that is an attribute too, and columns by their path."""
    result = vi.Result(content())
    assert result["x"].tolist() == result.x.tolist() == [0.0, 1.0, 2.0]
    assert result["impacts"] is result.impacts
    assert result["impacts/side"].tolist() == [1, -1]
    assert {"x", "t", "impacts"} <= set(result)
    with pytest.raises(KeyError, match=r"the result has no 'velocity'; it has .*impacts"):
        result["velocity"]
    with pytest.raises(KeyError, match="momentum"):
        result["impacts/momentum"]
    assert copy.copy(result)["x"].size == 3


def test_numbers_as_a_document_and_as_a_data_frame() -> None:
    result = vi.Result(content())
    document = result.to_dict()
    assert document["impacts"] == {"time": [1.0, None], "side": [1, -1]}
    assert json.loads(json.dumps(document))["x"] == [0.0, 1.0, 2.0]
    frame = result.to_pandas("impacts")
    assert sorted(frame.columns) == ["side", "time"]
    assert frame.side.tolist() == [1, -1]
    assert result.unit("impacts/time") == "1"


@pytest.mark.parametrize(
    ("unit", "expected"), [("Hz", 1.0), ("rpm", 60.0), ("Omega", 2e-3 * np.pi)]
)
def test_frequencies_in_other_units(
    unit: str, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = vi.Result(content())
    monkeypatch.setattr(result, "unit", {"Omega": "rad/ms"}.get)
    assert result.in_unit([2e-3 * np.pi], unit)[0] == pytest.approx(expected)
    with pytest.raises(ValueError, match="Bq"):
        result.in_unit([1.0], "Bq")


class Service:
    """Answers with a result, or says that it is the one that is known; then it is gone."""

    def __init__(self) -> None:
        self.asked: list[str | None] = []

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        known = request.headers.get("If-None-Match")
        self.asked.append(known)
        if len(self.asked) > 2:
            raise httpx2.ConnectError("down")
        if known == '"v1"':
            return httpx2.Response(304)
        return httpx2.Response(200, content=content(), headers={"ETag": '"v1"'})


def test_results_are_fetched_once_and_are_there_offline(tmp_path: Path) -> None:
    service = Service()
    transport = Transport("http://service", 5.0, httpx2.MockTransport(service), retries=0)
    cache = Cache(tmp_path)

    def ask(**more: Any) -> Any:
        return transport.hold(conversations.ask("time-history", REQUEST | more, cache))

    assert ask() == ask() == ask() == content()
    assert service.asked == [None, '"v1"', '"v1"']
    with pytest.raises(vi.ConnectionFailed):
        ask(tolerance=1e-3)
    assert transport.hold(conversations.result("ab" * 32, cache=cache)) == content()
    assert len(service.asked) == 4
