"""schemathesis against a service of its own: all checks, examples, coverage, fuzzing, stateful.

    python tests/fuzz/conformance.py [--cases 5000] [--seed 1] [--examples 50]

Fails on any failed check, on any error in the log of the service, and where fewer cases ran than
were asked for.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx2

HERE = Path(__file__).parent
USERS = ("ann", "bob")
"""All is done as the first, and then nothing of it may be there for the second."""
PHASES = ("examples,coverage", "fuzzing,stateful")
"""What runs at the same time: schemathesis itself keeps a core busy with making cases up."""
SETTINGS = {
    "WORKERS": "1",
    # Cases of schemathesis may be as large as these; larger ones are answered 413.
    "MAX_DOFS": "200",
    "MAX_POINTS": "20000",
    "MAX_SWEEP_POINTS": "2000",
    "MAX_JOB_SECONDS": "20",
    "INLINE_SECONDS": "0.2",
    "INLINE_OVERRUN_SECONDS": "1",
    "MAX_UNFINISHED_JOBS": "10000",
}


def make_key(data: Path, owner: str) -> str:
    """Return a key for everything."""
    command = [sys.executable, "-m", "vibroimpact_service.access.commands", "create", owner]
    scopes = [part for name in ("read", "submit", "metrics", "admin") for part in ("--scope", name)]
    more = ["--requests-per-minute", "10000000", "--seconds-per-hour", "1e9", "--data", str(data)]
    made = subprocess.run([*command, *scopes, *more], capture_output=True, text=True, check=True)
    return made.stdout.strip()


def start(data: Path) -> tuple[subprocess.Popen[bytes], str, dict[str, str]]:
    """Start a service; return its process, its address and the header of each of its users."""
    users = {name: f"Bearer {make_key(data, name)}" for name in USERS}
    process = subprocess.Popen(
        [sys.executable, "-m", "vibroimpact_service", "--port", "0", "--data", str(data)],
        env={
            **os.environ,
            "OMP_NUM_THREADS": "1",
            **{f"VIBROIMPACT_{name}": value for name, value in SETTINGS.items()},
        },
        stdout=subprocess.DEVNULL,
        stderr=(data / "stderr.txt").open("wb"),
    )
    note, end = data / "service.json", time.monotonic() + 600
    while not note.exists():
        if process.poll() is not None or time.monotonic() > end:
            sys.exit((data / "stderr.txt").read_text())
        time.sleep(0.05)
    return process, json.loads(note.read_text())["url"], users


def run(
    url: str, contract: Path, users: Path, phases: str, number: int, seed: int
) -> tuple[int, int]:
    """Run phases of schemathesis; return its exit code and the number of cases."""
    command: list[Any] = [
        *(Path(sys.executable).with_name("st"), "--config-file", HERE / "schemathesis.toml"),
        *("run", contract, "--url", url),
        *("--max-examples", number, "--seed", seed, "--phases", phases, "--workers", 1),
        *("--generation-database", "none", "--continue-on-failure", "--no-color"),
        # Where other steps have the processors, an answer waits for its turn: 30 s were not enough.
        *("--request-timeout", 300, "--warnings", "off"),
    ]
    place = users.with_name(phases)  # for what schemathesis keeps
    place.mkdir()
    process = subprocess.Popen(
        [str(part) for part in command],
        cwd=place,
        env={
            **os.environ,
            "SCHEMATHESIS_HOOKS": "hooks",
            "PYTHONPATH": str(HERE),
            "FUZZ_USERS": str(users),
        },
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    words = []
    for line in process.stdout:
        # Bodies that failed can be long; schemathesis shows them whole.
        sys.stdout.write(line if len(line) < 2000 else line[:2000] + "…\n")
        words.append(line)
    found = re.findall(r"([\d,]+) generated", "".join(words))
    return process.wait(), sum(int(each.replace(",", "")) for each in found)


def identity(name: str, authorization: str) -> dict[str, Any]:
    """Return a user as Web Fuzzing Commons describe one."""
    header = {"name": "Authorization", "value": authorization}
    return {"name": name, "fixedHeaders": [header]}


def failures(log: Path) -> list[str]:
    """Return what the service noted as its own failures."""
    words = ('"level":"error"', '"level":"critical"', "Traceback (most recent call last)")
    return [line for line in log.read_text().splitlines() if any(word in line for word in words)]


def main() -> None:
    """Run, and judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=5000, help="fewer are a failure")
    parser.add_argument("--examples", type=int, default=50, help="made up for each operation")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(len(PHASES)) as pool:
        data = Path(folder)
        began = time.monotonic()
        # Before a case has to wait for a kernel.
        subprocess.run([sys.executable, "-m", "vibroimpact_service.cli", "warm"], check=True)
        process, url, users = start(data)
        file, contract = data / "users.json", data / "openapi.json"
        file.write_text(json.dumps({"auth": [identity(*user) for user in users.items()]}))
        # schemathesis gives up after 10 s, which are not enough beside other work.
        contract.write_bytes(httpx2.get(f"{url}/openapi.json", timeout=300).content)
        print(f"kernels ready after {time.monotonic() - began:.0f} s", flush=True)
        runs = [
            pool.submit(run, url, contract, file, phases, given.examples, given.seed)
            for phases in PHASES
        ]
        codes, counts = zip(*(each.result() for each in runs), strict=True)
        print(f"{sum(counts)} cases in {time.monotonic() - began:.0f} s, seed {given.seed}")
        process.terminate()
        stopped = process.wait(60)
        errors = failures(data / "stderr.txt")
    print(f"schemathesis ended with {codes}, the service with {stopped}")
    print(*(line[:5000] for line in errors[:20]), sep="\n")
    sys.exit(1 if any(codes) or stopped or errors or sum(counts) < given.cases else 0)


if __name__ == "__main__":
    main()
