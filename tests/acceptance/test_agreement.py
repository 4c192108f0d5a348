"""Compiled kernels and those that run as plain Python give the same, within stated errors."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests import agreement
from tests.needs import ROOT

Results = list[tuple[str, object, agreement.Arrays]]


def results(
    file: Path, seed: int, **environment: str
) -> list[tuple[str, object, agreement.Arrays]]:
    """Return what a process of its own computes."""
    command = [sys.executable, "-m", "tests.agreement", str(file), "--seed", str(seed)]
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, **environment}, capture_output=True, text=True,
        timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    read: Results = pickle.loads(file.read_bytes())
    return read


def test_both_forms_of_all_kernels_agree(tmp_path: Path) -> None:
    compiled = results(tmp_path / "compiled", 7, NUMBA_DISABLE_JIT="0")
    plain = results(tmp_path / "plain", 7, NUMBA_DISABLE_JIT="1")
    assert len(compiled) == len(plain) > 30
    numbers = 0
    for (kind, content, one), (_, _, other) in zip(compiled, plain, strict=True):
        assert list(agreement.differences(kind, one, other)) == [], (kind, content)
        numbers += sum(array.size for array in one.values())
    assert numbers > 5_000


@pytest.mark.parametrize(
    ("path", "value", "told"),
    [
        ("impulse", 1.0 + 3e-9, "impulse"),
        ("impulse", np.nan, "impulse"),
        ("impulse", 1.0 + 1e-9, None),
        ("exists", 0.0, "exists"),
    ],
)
def test_what_differs_is_named(path: str, value: float, told: str | None) -> None:
    one = {
        "impulse": np.array([2.0, 1.0]),
        "exists": np.array([True, True]),
        "error/impulse": np.array([1e-9, 1e-9]),
    }
    other = {name: array.copy() for name, array in one.items()}
    other[path][1] = value
    found = list(agreement.differences("impact-modes", one, other))
    assert [each.partition(":")[0].split()[0] for each in found] == ([told] if told else [])
