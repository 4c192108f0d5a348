"""Computations without a server: memory, processor time, and Ctrl-C."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import vibroimpact as vi
from vibroimpact_service import local

pytestmark = pytest.mark.needs("processes")

CHAIN = vi.chain(13, [vi.constraint(5, 0.2)])
ENDLESS = """
import itertools
from vibroimpact_service import local_process
from vibroimpact_service.use_case import computation
from vibroimpact_service.jobs import process_limits
process_limits._MARGIN_SECONDS = {margin}
{compute}
local_process.main()
"""
IN_COMPILED_CODE = "computation.compute = lambda *_: sum(itertools.repeat(0))"  # heeds nothing


@pytest.fixture(autouse=True)
def processes_end() -> Iterator[None]:
    """Other tests have processes of their own, with other limits."""
    local._end_all()
    yield
    local._end_all()


def command(monkeypatch: pytest.MonkeyPatch, compute: str, margin: float) -> None:
    """Let the process be one with other limits, or another computation."""
    text = ENDLESS.format(margin=margin, compute=compute)
    monkeypatch.setattr(local, "_COMMAND", [sys.executable, "-c", text])


def test_a_process_is_kept_for_the_next_computation() -> None:
    client = vi.Local()
    assert client.impact_modes(CHAIN, [1.4]).exists is not None
    (kept,) = local._idle
    client.impact_modes(CHAIN, [1.5])
    assert local._idle == [kept]
    assert kept.poll() is None


def test_memory_is_that_of_a_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    """512 MiB for a result of 320 MB and what it is made of; the caller lives, and goes on."""
    monkeypatch.setenv("VIBROIMPACT_WORKER_MEMORY_BYTES", str(2**29))
    client, long = vi.Local(), vi.chain(1000, [vi.constraint(5, 0.2)])
    with pytest.raises(vi.VibroimpactError, match="memory"):
        client.impact_modes(long, (2.1, 3.0, 40_000), outputs=["shape"])
    assert client.impact_modes(CHAIN, [1.4]).exists is not None


ENDLESSLY_HIT = vi.system([[1.0]], [[1.0]], [vi.constraint(0, 0.2)])
"""A rigid stop without loss, from which a mass rebounds for ever."""


def test_processor_time_is_what_the_caller_gives() -> None:
    """A computation that tells its progress ends with the sentence of its limit."""
    for_a_moment = vi.Local(seconds=0.2)
    with pytest.raises(
        vi.VibroimpactError, match=r"0\.2 s of processor time that .* \d+% was done"
    ):
        for_a_moment.time_history(ENDLESSLY_HIT, ([0.0], [1.0]), 1e9, outputs=["impacts"])
    assert for_a_moment.impact_modes(CHAIN, [1.4]).exists is not None


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan")])
def test_processor_time_that_is_no_time(seconds: float) -> None:
    with pytest.raises(ValueError, match="seconds must be positive"):
        vi.Local(seconds=seconds)


def test_processor_time_ends_compiled_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that heeds nothing is ended by the operating system, and another can follow."""
    command(monkeypatch, IN_COMPILED_CODE, 1.0)
    with pytest.raises(vi.VibroimpactError, match="processor time"):
        vi.Local(seconds=0.1).impact_modes(CHAIN, [1.4])
    monkeypatch.undo()
    assert vi.Local().impact_modes(CHAIN, [1.4]).exists is not None


def test_ctrl_c_ends_compiled_code(tmp_path: Path) -> None:
    """The program goes on at once, its process is gone, and the next computation works."""
    text = ENDLESS.format(margin=60.0, compute=IN_COMPILED_CODE)
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(f"""
        import signal
        import sys
        import vibroimpact as vi
        from vibroimpact_service import local
        # A shell lets what it runs in the background ignore Ctrl-C.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        usual, local._COMMAND = local._COMMAND, [sys.executable, "-c", {text!r}]
        begin = local._started
        def started():
            process = begin()
            print(process.pid, flush=True)
            return process
        local._started = started
        chain = vi.chain(13, [vi.constraint(5, 0.2)])
        try:
            vi.Local().impact_modes(chain, [1.4])
        except KeyboardInterrupt:
            print("interrupted", flush=True)
        local._COMMAND = usual
        print(vi.Local().impact_modes(chain, [1.4]).exists[0], flush=True)
        """)
    )
    program = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert program.stdout is not None
    pid = int(program.stdout.readline())
    until = time.monotonic() + 60.0
    while _seconds(pid) < 8.0 and time.monotonic() < until:  # it imports, and then computes
        time.sleep(0.1)
    program.send_signal(signal.SIGINT)
    assert program.stdout.readline() == "interrupted\n"
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert int(program.stdout.readline()) != pid
    assert program.stdout.readline() == "True\n"
    assert program.wait() == 0
    program.stdout.close()


def _seconds(pid: int) -> float:
    """Return the processor time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
