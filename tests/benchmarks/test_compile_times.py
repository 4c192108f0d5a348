"""The guard of compile times fails where a kernel takes a quarter more, and nowhere else."""

from __future__ import annotations

import itertools
import json

import pytest

from benchmarks import compile_times, hot
from benchmarks.compile_times import KERNELS, TOLERANCE, USUAL, too_long

KNOWN = json.loads(USUAL.read_text())["ratios"]


def test_every_kernel_is_watched_and_has_its_usual_ratio() -> None:
    assert set(KNOWN) == set(KERNELS)
    assert set(KERNELS) <= set(hot.HOT)


def test_a_quarter_more_fails_by_name() -> None:
    assert TOLERANCE <= 1.25
    for name, ratio in KNOWN.items():
        assert not too_long({**KNOWN, name: 1.2 * ratio}, KNOWN)
        (sentence,) = too_long({**KNOWN, name: 1.3 * ratio}, KNOWN)
        assert sentence.startswith(f"{name}: compiling takes {1.3 * ratio:.1f} times")


def test_a_kernel_without_a_usual_ratio_fails() -> None:
    (sentence,) = too_long({"new": 1.0}, {})
    assert sentence == "new: nothing to compare with; store it by --usual"


def test_the_ratio_is_that_of_the_first_call_to_the_median(monkeypatch: pytest.MonkeyPatch) -> None:
    measured = itertools.chain([100.0], [2.0, 3.0, 50.0], [2.0, 2.0, 2.0])
    monkeypatch.setattr(compile_times, "measure", lambda: next(measured))
    clock = itertools.chain([10.0, 31.0])
    monkeypatch.setattr(compile_times.time, "process_time", lambda: next(clock))
    monkeypatch.setitem(hot.HOT, "kernel", lambda: lambda: None)  # type: ignore[misc]
    assert compile_times.one("kernel") == pytest.approx(10.5)


def test_the_fixed_function_takes_processor_time() -> None:
    assert compile_times.measure() > 0.0
