"""Damaged files of matrices: each is refused by its name, before memory is taken for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import vibroimpact as vi
from tests.client import program_files

ONE = "%%MatrixMarket matrix coordinate real symmetric\n"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("x.sti", "1 1 2.0\n2147483647 2147483647 1.0\n"),
        ("K.mtx", ONE + "2147483647 2147483647 1\n1 1 2.0\n"),
        ("K.mtx", "%%MatrixMarket matrix coordinate real general\n1 2147483647 1\n1 1 2.0\n"),
    ],
)
def test_a_size_without_entries_is_refused(tmp_path: Path, name: str, text: str) -> None:
    """One wrong digit would have taken 16 GiB."""
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ValueError, match=r"only . of its entries are given") as refused:
        vi.read_model(K=path, M=path)
    assert name in str(refused.value)
    assert "2147483647" in str(refused.value)


def test_what_is_wrong_with_a_matrix_names_its_files(tmp_path: Path) -> None:
    mass, stiffness = tmp_path / "the mass.mtx", tmp_path / "the stiffness.mtx"
    mass.write_text(ONE + "2 2 2\n1 1 1.0\n2 2 1.0\n")
    for entries, wrong in (
        ("general\n2 2 4\n1 1 1.0\n2 2 1.0\n1 2 0.5\n2 1 0.1\n", "K is not symmetric"),
        ("general\n2 2 2\n1 1 nan\n2 2 1.0\n", "not a finite number"),
        ("general\n2 3 3\n1 1 1.0\n2 2 1.0\n1 3 0.5\n", "K is not square"),
    ):
        stiffness.write_text("%%MatrixMarket matrix coordinate real " + entries)
        with pytest.raises(ValueError, match=wrong) as refused:
            vi.read_model(M=mass, K=stiffness)
        assert "the stiffness.mtx" in str(refused.value)
    with pytest.raises(ValueError, match=r"the mass\.mtx: K missing; there is M"):
        vi.read_model(M=mass)


def test_records_of_output4_are_whole_words(tmp_path: Path) -> None:
    """Numbers behind a record that is not were read from other bytes than theirs."""
    matrix = np.array([[2.0, -1.0], [-1.0, 2.0]])
    data = program_files.op4_binary({"KAAX": matrix, "MAAX": matrix})
    head = 4 + 24 + 4
    size = int.from_bytes(data[head : head + 4], "little")
    longer = (size + 2).to_bytes(4, "little")
    body = data[head + 4 : head + 4 + size]
    damaged = data[:head] + longer + body + b"\0\0" + longer + data[head + 8 + size :]
    path = tmp_path / "model.op4"
    path.write_bytes(data)
    assert np.array_equal(vi.read_model(path).K.toarray(), matrix)
    path.write_bytes(damaged)
    with pytest.raises(ValueError, match=rf"model\.op4: byte {head}: a record of {size + 2} bytes"):
        vi.read_model(path)
