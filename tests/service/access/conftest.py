"""A service with keys, and callers who have some."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from starlette.testclient import TestClient

from vibroimpact_schema.keys import KeyRequest
from vibroimpact_service.access import records
from vibroimpact_service.app import create_app
from vibroimpact_service.settings import Settings

MakeKey = Callable[..., dict[str, str]]


@pytest.fixture
def make_key(settings: Settings) -> Iterator[MakeKey]:
    """Return the function that makes a key, as the command line does, and gives its header."""
    engine = records.open_keys(settings.database_url)

    def make(
        owner: str, *scopes: str, days: float | None = None, rate: int | None = None,
        seconds: float | None = None,
    ) -> dict[str, str]:  # fmt: skip
        new = KeyRequest.model_construct(  # unchecked: some expired long ago
            owner=owner, label="test", scopes=list(scopes or ("read", "submit")), days=days,
            requests_per_minute=rate, seconds_per_hour=seconds,
        )  # fmt: skip
        with engine.begin() as connection:
            text, _ = records.create(connection, "test", new)
        return {"Authorization": f"Bearer {text}"}

    yield make
    engine.dispose()


@pytest.fixture
def ann(make_key: MakeKey) -> dict[str, str]:
    return make_key("ann")


@pytest.fixture
def bob(make_key: MakeKey) -> dict[str, str]:
    return make_key("bob")


@pytest.fixture
def admin(make_key: MakeKey) -> dict[str, str]:
    return make_key("root", "admin")


@pytest.fixture
def closed(settings: Settings, queue: Any, ann: dict[str, str]) -> Iterator[TestClient]:
    """Return a client of a service that has keys, and so asks for them."""
    with TestClient(create_app(settings, queue)) as client:
        yield client
