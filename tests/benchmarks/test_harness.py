"""Times are medians of turns, by a clock that the tests move."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from benchmarks import harness


class Clock:
    """A clock of which time passes only by work; the processor's goes at half the pace."""

    def __init__(self) -> None:
        self.now = 0.0

    def perf_counter(self) -> float:
        return self.now

    def process_time(self) -> float:
        return 0.5 * self.now

    def work(self, *seconds: float) -> Callable[[], None]:
        """Return work that takes these times, one call after the other, and then the last."""
        left = list(seconds)

        def step() -> None:
            self.now += left.pop(0) if len(left) > 1 else left[0]

        return step


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(harness, "time", found)
    return found


def test_functions_take_turns() -> None:
    calls: list[str] = []
    found = harness.measure(
        rounds=3,
        sample=0.0,
        a=lambda: calls.append("a"),
        b=lambda: calls.append("b"),
    )
    assert "".join(calls) == "aabb" + "ab" * 3
    assert len(found["a"].rounds) == 3


def test_medians_after_a_warm_up(clock: Clock) -> None:
    # A slow first call, one that tells how often to repeat, and three rounds.
    found = harness.measure(3, 0.0, work=clock.work(100.0, 1.0, 8.0, 2.0, 4.0))["work"]
    assert found.wall == 4.0
    assert found.processor == 2.0
    assert found.rounds == (4.0, 1.0, 2.0)


def test_quick_functions_are_repeated_until_a_sample_is_long_enough(clock: Clock) -> None:
    work, calls = clock.work(0.003), 0

    def counted() -> None:
        nonlocal calls
        calls += 1
        work()

    found = harness.measure(2, 0.02, work=counted)["work"]
    assert calls == 2 + 2 * 7  # seven times three milliseconds are more than twenty
    assert found.wall == pytest.approx(0.003)


def test_what_all_suffer_from_leaves_the_ratio_alone(clock: Clock) -> None:
    slow = clock.work(3.0, 3.0, 3.0, 30.0, 6.0)
    fast = clock.work(1.0, 1.0, 1.0, 10.0, 2.0)
    found = harness.measure(3, 0.0, slow=slow, fast=fast)
    assert harness.ratio(found["slow"], found["fast"]) == pytest.approx(3.0)


def test_ratio_is_taken_round_by_round() -> None:
    slow = harness.Timing(0.0, 0.0, (2.0, 20.0, 4.0))
    fast = harness.Timing(0.0, 0.0, (1.0, 10.0, 1.0))
    assert harness.ratio(slow, fast) == 2.0


def test_a_machine_is_described() -> None:
    found = harness.machine()
    assert found["cores"] >= 1
    assert found["python"].startswith("3.")
    assert set(found["packages"]) >= {"vibroimpact", "numpy", "numba"}
    assert harness.versions("no-such-package") == {}
