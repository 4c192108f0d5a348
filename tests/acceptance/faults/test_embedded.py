"""Kills of the workers, and of the service itself, where one process holds everything."""

from __future__ import annotations

import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from processes import Record, Replica, until
from shared import Machine
from users import User, continued, sweep, tiny, uninterrupted


def test_killed_workers(
    started: Callable[[Any], Any],
    tmp_path: Path,
    record: Record,
    moments: random.Random,
    machine: Machine,
) -> None:
    replica = started(Replica(tmp_path / "data", record))
    until(replica.ready, "no workers")
    user = User([replica])
    user.submit(sweep(0.6), *(tiny(0.7 + i / 100) for i in range(10)), sweep(0.61))
    seconds = []
    for _ in range(4):
        last = until(lambda: record.begun()[-1:], "nothing begins")[0]
        time.sleep(moments.uniform(0.0, 0.6))
        last = record.begun()[-1]
        moment = time.time()
        os.kill(last.pid, signal.SIGKILL)
        again = until(lambda m=moment, p=last.pid: record.after(m, p), "no other worker")
        seconds.append(machine.seconds(moment, again.time))
    print("seconds from a worker's death to the next chunk:", [round(s, 2) for s in seconds])
    user.check()
    record.check()
    assert record.repeated() <= 4 * 2  # one worker computes two chunks at a time
    assert max(seconds) <= 5.0


def test_a_continued_sweep_whose_workers_are_killed(
    started: Callable[[Any], Any], tmp_path: Path, record: Record, moments: random.Random
) -> None:
    replica = started(Replica(tmp_path / "data", record))
    until(replica.ready, "no workers")
    user = User([replica], kind="sweep")
    content = continued()
    user.submit(content)
    for _ in range(3):
        last = until(lambda: record.begun()[-1:], "nothing begins")[0]
        time.sleep(moments.uniform(0.0, 0.3))
        last = record.begun()[-1]
        moment = time.time()
        os.kill(last.pid, signal.SIGKILL)
        until(lambda m=moment, p=last.pid: record.after(m, p), "no other worker")
    job = next(iter(user.accepted.values()))[0]
    # The first history of a checkout compiles its kernels in the worker.
    done = until(lambda: user.final(job), "it does not end", 300.0)
    assert done["state"] == "succeeded", done["error"]
    killed = [each for each in done["history"] if "SIGKILL" in (each["why"] or "")]
    assert killed
    assert done["progress"]["total"] == 8  # a piece for each value of the second axis
    answer = user.ask("GET", done["result"]).json()
    x = np.array(answer["x"])
    np.testing.assert_array_equal(x, uninterrupted(content))
    record.check()


def test_killed_service(
    started: Callable[[Any], Any],
    tmp_path: Path,
    record: Record,
    moments: random.Random,
    machine: Machine,
) -> None:
    # Every other one computes quick jobs while they are submitted.
    on_submission_seconds = ("0", "0.02", "0", "0.02")
    moment = time.time()
    replica = started(
        Replica(tmp_path / "data", record, on_submission_seconds=on_submission_seconds[0])
    )
    user = User([replica])
    # Long enough to outlast three restarts on a machine that is busy with other tests.
    user.submit(sweep(0.6, 320_000), *(tiny(0.7 + i / 100) for i in range(10)))
    first = machine.seconds(moment, until(record.begun, "nothing begins")[0].time)
    seconds = []
    for round_ in range(3):
        before = len(record.begun())
        until(lambda b=before: len(record.begun()) > b, "nothing begins")
        time.sleep(moments.uniform(0.0, 0.6))
        replica.kill()
        moment = time.time()
        replica = started(
            Replica(
                tmp_path / "data", record, on_submission_seconds=on_submission_seconds[round_ + 1]
            )
        )
        user.replicas = [replica]
        again = until(lambda m=moment: record.after(m), "the jobs do not go on")
        seconds.append(machine.seconds(moment, again.time))
        user.submit(tiny(0.9 + round_ / 100))
    shown = [round(s, 2) for s in (first, *seconds)]
    print("seconds from the first start, and from each restart, to the next chunk:", shown)
    user.check()
    record.check()
    assert record.repeated() <= 3 * 2
    # As soon as there are workers again, however long these take here; claims last for longer.
    assert max(seconds) <= max(3.0, 1.5 * first)
