"""Benchmarks run unattended: small versions of those that take long, and what a failure does."""

from __future__ import annotations

import pytest

from benchmarks import command, registry, scheduler
from benchmarks.tables import Table


def test_simulated_workers_do_not_lose_time_until_the_scheduler_limits() -> None:
    one = scheduler.simulate(100_000, 1)
    ten = scheduler.simulate(100_000, 10)
    assert one["busy"] > 0.99
    assert ten["busy"] > 0.95
    assert one["seconds"] / ten["seconds"] > 9.0
    # Two thousand slots want a bundle of a fifth of a second each: ten thousand a second.
    many = scheduler.simulate(1_000_000, 1000)
    assert many["scheduler"] > 0.95
    assert many["seconds"] == pytest.approx(many["bundles"] * scheduler.HANDING + 0.2, rel=0.05)


def test_simulated_chunks_are_all_done() -> None:
    found = scheduler.simulate(12_345, 3)
    assert found["bundles"] >= 12_345 / 50
    assert found["busy"] * found["seconds"] * 6 == pytest.approx(12_345 * scheduler.CHUNK, rel=0.05)


def test_a_benchmark_that_fails_hinders_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> Table:
        """Fail."""
        raise RuntimeError("a peer is gone")

    def sound() -> Table:
        """Succeed."""
        return Table("Numbers", ("one",), [(1,)])

    monkeypatch.setattr(registry.Benchmark, "functions", lambda self: iter((broken, sound)))
    said: list[str] = []
    failed = command.run(registry.BENCHMARKS[:1], said.append, save=False)
    assert failed == 1
    assert any("a peer is gone" in text for text in said)
    assert any("Numbers" in text for text in said)


def test_every_benchmark_can_be_loaded() -> None:
    for benchmark in registry.BENCHMARKS:
        functions = list(benchmark.functions())
        assert functions
        assert all(function.__doc__ for function in functions)
