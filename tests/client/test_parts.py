"""Results that were computed without a server are those of their files, which are not made."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vibroimpact as vi
from vibroimpact import kinds
from vibroimpact.parts import Parts
from vibroimpact.tables import Table
from vibroimpact_schema import entries, examples
from vibroimpact_service.kinds import KINDS

CASES = [(kind, name) for kind in KINDS for name in examples.requests(kind)]


def computed(kind: str, name: str) -> vi.Result:
    return vi.Local().compute(kind, examples.requests(kind)[name]["request"])


def same(one: Any, other: Any) -> None:
    if isinstance(one, Table):
        assert isinstance(other, type(one))
        assert list(one) == list(other)
        for name in one:
            same(one[name], other[name])
        return
    a, b = np.asarray(one), np.asarray(other)
    assert (a.dtype, a.shape) == (b.dtype, b.shape)
    assert a.tolist() == b.tolist() or a.tobytes() == b.tobytes()


@pytest.mark.parametrize(("kind", "name"), CASES)
def test_a_result_is_that_of_its_file(kind: str, name: str, tmp_path: Path) -> None:
    one = computed(kind, name)
    outputs, shown, document = one.outputs(), (repr(one), one._repr_html_()), one.to_dict()
    assert "_file" not in vars(one)  # none is made where none is asked for
    other = kinds.read(one.to_hdf5(tmp_path / "result.h5"))
    assert type(one) is type(other)
    assert outputs == other.outputs()
    assert shown == (repr(other), other._repr_html_())
    assert document == other.to_dict()
    assert [*one._arrays] == [*other._arrays]
    assert [*one._tables] == [*other._tables]
    for field in (*one._arrays, *one._tables):
        same(getattr(one, field), getattr(other, field))
    assert one._about == other._about
    with one.open() as file:
        assert dict(file.attrs)["kind"] == one.kind
    sent = Parts(entries.unpack(entries.pack(one._content._entries)))
    assert sent.hdf5() == one._content.hdf5()


def test_a_result_can_be_copied_and_sent_to_other_processes(tmp_path: Path) -> None:
    one = computed("impact-modes", "chain")
    read = kinds.read(one.to_hdf5(tmp_path / "result.h5"))
    for given in (one, read):
        for other in (copy.deepcopy(given), pickle.loads(pickle.dumps(given))):
            assert other.impulse.tolist() == one.impulse.tolist()
            assert (
                other.to_hdf5(tmp_path / "other.h5").read_bytes()
                == (tmp_path / "result.h5").read_bytes()
            )


def test_arrays_are_the_callers_own() -> None:
    one = computed("impact-modes", "chain")
    first = float(one.Omega[0])
    one.Omega[0] = -1.0
    assert one.frequency["Omega"][0] == first
    with one.open() as file:
        assert file["Omega"][0] == first
