"""The number of chunks in a batch."""

from __future__ import annotations

from itertools import pairwise

import pytest

from vibroimpact_service.jobs.run_one import (
    BATCH_SECONDS,
    MAX_BATCH_RATE,
    batch_seconds,
    batch_size,
)


def test_few_workers_get_batches_of_a_fifth_of_a_second() -> None:
    assert batch_size(100_000, 0.004, 2) == 50
    assert batch_size(100_000, 0.5, 2) == 1
    assert batch_size(3, 0.004, 2) == 1


@pytest.mark.parametrize("workers", [1, 2, 20, 21, 100, 1000])
def test_no_more_batches_per_second_are_sent_than_one_process_can_send(workers: int) -> None:
    each = 0.004
    size = batch_size(10**9, each, workers)
    assert workers / (size * each) <= MAX_BATCH_RATE * 1.02
    assert size * each <= max(BATCH_SECONDS, workers / MAX_BATCH_RATE)


@pytest.mark.parametrize("workers", [1, 7, 300])
def test_the_last_batches_are_smaller_and_every_chunk_is_in_one(workers: int) -> None:
    waiting, sizes = 54_321, []
    while waiting:
        sizes.append(batch_size(waiting, 0.004, workers))
        waiting -= sizes[-1]
    assert sum(sizes) == 54_321
    assert min(sizes) >= 1
    assert all(later <= earlier for earlier, later in pairwise(sizes))
    # What one worker may still have to do when all others have ended.
    assert sizes[-1] * 0.004 <= max(0.004, 0.25 * batch_seconds(workers))
