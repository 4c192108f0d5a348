"""Files with random damage are read or refused, whatever is damaged, in little time and memory."""

from __future__ import annotations

import random
import time
import tracemalloc
import warnings

import numpy as np
import pytest

from tests.client.mutated_files import mutated
from tests.schema.files.uploads import FORMATS
from vibroimpact_schema.files import label_texts, readers, structures
from vibroimpact_schema.files.bounds import Bounds

BOUNDS = Bounds(size=2**22, lines=2**16, rows=5000)
ROUNDS = 60
"""Damaged files of each format; thousands were tried."""


def _read(name: str, data: bytes) -> str:
    """Read a file: read, with matrices of finite size, or refused by the documented error."""
    try:
        if name.endswith((".dof", ".mapping")):
            assert all(isinstance(node, int) for node, _ in label_texts.read(name, data, BOUNDS))
            return "read"
        content = readers.read(name, data, BOUNDS)
        keyword = name[0] if list(content.matrices) == [""] else ""
        file = structures.select(name, content, keyword, bounds=BOUNDS)
    except ValueError:
        return "refused"
    for matrix in file.matrices.values():
        assert max(matrix.shape) <= BOUNDS.rows
        assert np.asarray(getattr(matrix, "data", matrix)).dtype.kind in "biuf"
    return "read"


@pytest.mark.parametrize("form", FORMATS)
def test_damage_ends_in_a_matrix_or_in_the_error(form: str) -> None:
    rng, ends = random.Random(form), set[str]()
    names = list(FORMATS[form])
    for _ in range(ROUNDS):
        name = rng.choice(names)
        data = mutated(FORMATS[form][name], rng)
        tracemalloc.start()
        began = time.process_time()
        try:
            ends.add(_read(name, data))
            assert time.process_time() - began < 1.0, (name, data)
            assert tracemalloc.get_traced_memory()[1] < 64 * 2**20, (name, data)
        finally:
            tracemalloc.stop()
    assert "refused" in ends


@pytest.mark.parametrize("form", FORMATS)
def test_every_end_of_a_file_is_read_or_refused(form: str) -> None:
    """Cut at places all over the file."""
    for name, data in FORMATS[form].items():
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for cut in range(0, len(data), max(1, len(data) // 60)):
                assert _read(name, data[:cut]) in ("read", "refused")
