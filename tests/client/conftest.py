"""What tests of the client share."""

from __future__ import annotations

import threading
import time

import pytest


@pytest.fixture
def pauses(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return the pauses that this thread makes, which take no time; others have theirs."""
    pauses: list[float] = []
    this, sleep = threading.get_ident(), time.sleep

    def pause(seconds: float) -> None:
        if threading.get_ident() == this:
            pauses.append(seconds)
        else:
            sleep(seconds)

    monkeypatch.setattr("vibroimpact.transport.time.sleep", pause)
    return pauses
