"""The faults of `tests.planted` can still be planted: the lines that they replace are there."""

from __future__ import annotations

import pytest

from tests.planted import FAULTS, ROOT, planted


@pytest.mark.parametrize("room", FAULTS)
def test_a_fault_can_be_planted(room: str) -> None:
    fault = FAULTS[room]
    text = (ROOT / fault.file).read_text(encoding="utf-8")
    assert planted(text, fault) != text
    assert all((ROOT / place).exists() for place in fault.tests)
