"""schemathesis against a service of its own: all checks, examples, coverage, fuzzing, stateful.

    python tests/fuzz/conformance.py [--cases 5000] [--seed 1]

Fails on any failed check, and where fewer cases ran than were asked for.
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
from pathlib import Path

HERE = Path(__file__).parent


def start(data: Path) -> tuple[subprocess.Popen[bytes], str, str]:
    """Start a service with keys; return its process, its address and a key for everything."""
    command = [sys.executable, "-m", "vibroimpact_service.access.commands", "create", "fuzz"]
    scopes = [part for name in ("read", "submit", "metrics", "admin") for part in ("--scope", name)]
    more = ["--requests-per-minute", "10000000", "--seconds-per-hour", "1e9", "--data", str(data)]
    key = subprocess.run([*command, *scopes, *more], capture_output=True, text=True, check=True)
    settings = {"MAX_DOFS": "200", "MAX_POINTS": "100000", "WORKERS": "1", "INLINE_SECONDS": "0.2"}
    process = subprocess.Popen(
        [sys.executable, "-m", "vibroimpact_service", "--port", "0", "--data", str(data)],
        env={
            **os.environ,
            "OMP_NUM_THREADS": "1",
            **{f"VIBROIMPACT_{name}": value for name, value in settings.items()},
        },
        stdout=subprocess.DEVNULL,
        stderr=(data / "stderr.txt").open("wb"),
    )
    note, end = data / "service.json", time.monotonic() + 60
    while not note.exists():
        if process.poll() is not None or time.monotonic() > end:
            sys.exit((data / "stderr.txt").read_text())
        time.sleep(0.05)
    return process, json.loads(note.read_text())["url"], key.stdout.strip()


def run(url: str, key: str, examples: int, seed: int) -> tuple[int, int]:
    """Run schemathesis; return its exit code and the number of cases."""
    command = [
        *(str(Path(sys.executable).with_name("st")), "--config-file", "schemathesis.toml"),
        *("run", f"{url}/openapi.json", "--checks", "all", "--header"),
        *(f"Authorization: Bearer {key}", "--max-examples", str(examples), "--seed", str(seed)),
        *("--phases", "examples,coverage,fuzzing,stateful", "--workers", "1"),
        *("--generation-database", "none", "--continue-on-failure", "--no-color"),
        *("--request-timeout", "30", "--warnings", "off"),
    ]
    hooks = {**os.environ, "SCHEMATHESIS_HOOKS": "hooks", "PYTHONPATH": str(HERE)}
    process = subprocess.Popen(command, cwd=HERE, env=hooks, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    words = []
    for line in process.stdout:
        sys.stdout.write(line)
        words.append(line)
    found = re.findall(r"([\d,]+) (?:generated|passed|total)", "".join(words))
    return process.wait(), max((int(each.replace(",", "")) for each in found), default=0)


def main() -> None:
    """Run, and judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=5000, help="fewer are a failure")
    parser.add_argument("--examples", type=int, default=0, help="per operation [from the cases]")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder)
        process, url, key = start(data)
        began = time.monotonic()
        code, cases = run(url, key, given.examples or max(10, given.cases // 60), given.seed)
        print(f"{cases} cases in {time.monotonic() - began:.0f} s, seed {given.seed}")
        process.terminate()
        stopped = process.wait(60)
        errors = [
            line
            for line in (data / "stderr.txt").read_text().splitlines()
            if '"level":"error"' in line or "Traceback" in line
        ]
    print(*errors[:20], sep="\n")
    sys.exit(1 if code or stopped or errors or cases < given.cases else 0)


if __name__ == "__main__":
    main()
