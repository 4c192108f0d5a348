"""Benchmarks can be loaded, and small versions run of those that take long."""

from __future__ import annotations

import pytest

from benchmarks import registry, scheduler


def test_simulated_workers_do_not_lose_time_until_the_scheduler_limits() -> None:
    one = scheduler.simulate(100_000, 1)
    ten = scheduler.simulate(100_000, 10)
    assert one["busy"] > 0.99
    assert ten["busy"] > 0.95
    assert one["seconds"] / ten["seconds"] > 9.0
    # A thousand workers want a bundle of a fifth of a second each: five thousand a second.
    many = scheduler.simulate(1_000_000, 1000, bundle=0.2)
    assert many["scheduler"] > 0.95
    assert many["seconds"] == pytest.approx(many["bundles"] * scheduler.HANDING + 0.2, rel=0.05)


def test_longer_bundles_keep_a_thousand_simulated_workers_busy() -> None:
    many = scheduler.simulate(10_000_000, 1000, handing=4e-3)
    assert many["busy"] > 0.9
    assert many["scheduler"] < 0.7


def test_simulated_chunks_are_all_done() -> None:
    found = scheduler.simulate(12_345, 3)
    assert found["bundles"] >= 12_345 / 50
    assert found["busy"] * found["seconds"] * 3 == pytest.approx(12_345 * scheduler.CHUNK, rel=0.05)


def test_every_benchmark_can_be_loaded() -> None:
    for benchmark in registry.BENCHMARKS:
        functions = benchmark.functions()
        assert functions
        assert all(function.__doc__ for function in functions)
        assert len({function.__name__ for function in functions}) == len(functions)


def test_bundles_hold_all_chunks_and_become_smaller_towards_the_end() -> None:
    sizes = scheduler._sizes(123_457, 7, None)
    assert sizes.sum() == 123_457
    assert sizes[0] == 50
    assert sizes[-1] <= 4
    assert (sizes[1:] <= sizes[:-1]).all()
