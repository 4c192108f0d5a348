"""The operating system ends a worker whose call takes far more processor time than it may."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

SPIN = """
import resource, time
from vibroimpact_service.jobs import process_limits
process_limits._MARGIN_SECONDS = 0.0
process_limits.limit_processor_time({seconds})
before = resource.getrlimit(resource.RLIMIT_CPU)[0]
process_limits.limit_processor_time(0.0)
assert resource.getrlimit(resource.RLIMIT_CPU)[0] >= before  # a smaller one takes nothing away
end = time.process_time() + {spin}
while time.process_time() < end:
    pass
"""


def spin(seconds: float, spent: float) -> int:
    text = SPIN.format(seconds=seconds, spin=spent)
    return subprocess.run([sys.executable, "-c", text], check=False, timeout=120).returncode


def test_a_call_that_does_not_look_at_its_signal_ends_with_its_process() -> None:
    assert spin(0.5, 30.0) == -signal.SIGXCPU


def test_a_limit_of_the_parent_does_not_count() -> None:
    """A child of a worker, or of a program that computes, begins with no time of its own."""
    child = [sys.executable, "-c", SPIN.format(seconds=0.5, spin=30.0)]
    parent = f"""
import resource, subprocess, sys
resource.setrlimit(resource.RLIMIT_CPU, (60, resource.getrlimit(resource.RLIMIT_CPU)[1]))
sys.exit(-subprocess.run({child!r}).returncode)
"""
    ended = subprocess.run([sys.executable, "-c", parent], check=False, timeout=120)
    assert ended.returncode == signal.SIGXCPU


def test_a_call_within_its_limit_is_left_alone() -> None:
    assert spin(20.0, 1.0) == 0


JOB = """
import json, sys
from vibroimpact_service import use_case
from vibroimpact_service.use_case import chunks
from vibroimpact_service.documents import digest, limits, planning, requests
from vibroimpact_service.jobs import process_limits
from vibroimpact_service.kinds import KINDS
from vibroimpact_service.settings import Settings
from vibroimpact_service.store import Store

folder, kind, content = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
use_case.load()
store, asked = Store(folder), requests.read("ann", KINDS[kind], content)
open_end = Settings(data=folder)
plan = planning.plan(store, asked.kind, asked.document, open_end).plan
size = limits.result_bytes(plan)
limit = int(limits._LIBRARIES + plan.bytes - size + limits._COPIES * size) + 1
exact = Settings(data=folder, worker_memory_bytes=max(limit, 2**29))
planning.plan(store, asked.kind, asked.document, exact)
process_limits.limit_memory(exact.worker_memory_bytes)
block = requests.stored_form("ann", asked.canonical)
name = digest.content(block)
store.requests.put(name, block)
job = folder, kind, name, asked.digest
pieces = chunks.split(*job)
chunks.solve(*job, range(len(pieces)))
chunks.join(*job, pieces)
print(store.results.size(asked.digest) / size)
"""


@pytest.mark.parametrize("outputs", [["waveform"], ["impulse", "shape"]])
def test_a_plan_that_is_accepted_fits_into_the_memory_of_a_worker(
    tmp_path: Path, outputs: list[str]
) -> None:
    """With a limit of which the plan says that it is just enough."""
    content = {
        "system": {"preset": "chain", "n": 13, "constraints": [{"dof": 5, "gap": 0.2}]},
        "frequency": {"start": 0.6, "stop": 1.9, "num": 1000 if "waveform" in outputs else 600_000},
        "outputs": outputs,
    }
    if "waveform" in outputs:
        content["tau"] = [i / 1000 for i in range(1000)]
    command = [sys.executable, "-c", JOB, str(tmp_path), "impact-modes", json.dumps(content)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=1000)
    assert ended.returncode == 0, ended.stderr[-2000:]
    assert 0.3 < float(ended.stdout.split()[-1]) < 1.1  # it is as large as planned


WATCHED = """
import math, time
from vibroimpact_service.jobs import process_limits
process_limits._LATE_SECONDS, process_limits._LOOK_SECONDS = {late}, 0.1
process_limits.limit_call("slow", 0.2, lambda name: print(name, flush=True))
if {ended}:
    process_limits.call_ended()
end = time.process_time() + {spin}
while time.process_time() < end:
    pass
"""


def test_a_process_is_ended_for_a_call_and_says_for_which() -> None:
    """Long before the limit of the operating system, which counts for all calls of the process."""
    text = WATCHED.format(late=0.3, ended=False, spin=30.0)
    ended = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, check=False, timeout=120
    )
    assert (ended.returncode, ended.stdout) == (-signal.SIGXCPU, "slow\n")


def test_a_thread_whose_call_has_ended_may_do_anything() -> None:
    text = WATCHED.format(late=0.0, ended=True, spin=2.0)
    subprocess.run([sys.executable, "-c", text], check=True, timeout=120)
