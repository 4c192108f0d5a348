"""How many chunks a call computes."""

from __future__ import annotations

from itertools import pairwise

import pytest

from vibroimpact_service.jobs import bundles


def test_few_workers_get_bundles_of_a_fifth_of_a_second() -> None:
    assert bundles.size(100_000, 0.004, 2) == 50
    assert bundles.size(100_000, 0.5, 2) == 1
    assert bundles.size(3, 0.004, 2) == 1


@pytest.mark.parametrize("slots", [1, 2, 20, 21, 100, 1000])
def test_no_more_bundles_a_second_are_handed_out_than_one_process_can(slots: int) -> None:
    each = 0.004
    size = bundles.size(10**9, each, slots)
    assert slots / (size * each) <= bundles.HANDED * 1.02
    assert size * each <= max(bundles.SECONDS, slots / bundles.HANDED)


@pytest.mark.parametrize("slots", [1, 7, 300])
def test_towards_the_end_bundles_become_smaller_and_all_chunks_are_in_one(slots: int) -> None:
    waiting, sizes = 54_321, []
    while waiting:
        sizes.append(bundles.size(waiting, 0.004, slots))
        waiting -= sizes[-1]
    assert sum(sizes) == 54_321
    assert min(sizes) >= 1
    assert all(later <= earlier for earlier, later in pairwise(sizes))
    # What one worker may still have to do when all others have ended.
    assert sizes[-1] * 0.004 <= max(0.004, 0.25 * bundles.seconds(slots))
