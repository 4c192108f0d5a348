"""Reference numbers of the book chapter, as decimal strings with their source."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import mpmath
import pytest

_FOLDER = Path(__file__).parent.parent / "reference"


@lru_cache
def _entries(file: str) -> dict[str, dict[str, Any]]:
    document = json.loads((_FOLDER / f"{file}.json").read_text(encoding="utf-8"))
    return {entry["name"]: entry for entry in document["entries"]}


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    """Digits that a test asks of mpmath are its own: others neither need nor lose them."""
    with mpmath.workdps(15):
        yield


@pytest.fixture(scope="session")
def reference() -> Callable[[str, str], dict[str, Any]]:
    """Return the function (file, name) -> entry with parameters and values."""
    return lambda file, name: _entries(file)[name]
