"""Keys that are required while there are none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from vibroimpact_service.operations.checks.access import access
from vibroimpact_service.settings import Settings


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, "ok"),
        ({"host": "0.0.0.0"}, "failed"),
        ({"access": "keys"}, "failed"),
        ({"host": "0.0.0.0", "access": "open"}, "warning"),
        ({"access": "keys", "oidc_issuer": "https://a.b"}, "ok"),
        ({"database": "postgresql://x@127.0.0.1:1/x"}, "warning"),
    ],
)
def test_without_keys(tmp_path: Path, settings: dict[str, Any], expected: str) -> None:
    check = access(Settings(data=tmp_path, **settings))
    assert check.state == expected
    assert (check.advice == "") is (expected == "ok")
    assert list(tmp_path.iterdir()) == []


def test_with_keys(make: Callable[..., Any]) -> None:
    place = make("sqlite", host="0.0.0.0")
    place.fill(1)
    check = access(place.settings)
    assert (check.state, check.seen) == ("ok", "required")
