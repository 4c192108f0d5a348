"""Damaged files are refused or read, whatever is damaged."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.client import mutated_files


@pytest.mark.parametrize("seed", [0, 1])
def test_damaged_files_are_refused_or_read(tmp_path: Path, seed: int) -> None:
    found = mutated_files.run(tmp_path, 17 * 20, seed)
    assert not any(end == "failed" for _, end in found)
    refused = sum(number for (_, end), number in found.items() if end == "refused")
    assert refused >= 17 * 10  # the damage is such
