"""Estimates of plans against measured times: ``python -m benchmarks.prices --help``."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

from benchmarks.prices import measured, table
from benchmarks.prices.requests import DRAWN

CALIBRATION, CHECKING = 0, 10_000
"""First seeds of the requests that the prices were fitted to, and of those they are checked by."""


def main() -> None:
    """Measure requests of some kinds and print the table of ratios."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.prices", description=__doc__)
    parser.add_argument("names", nargs="*", help=f"out of: {', '.join(DRAWN)}")
    parser.add_argument("--count", type=int, default=40, help="requests of each name")
    parser.add_argument("--longest", type=float, default=20.0, help="seconds of one request")
    parser.add_argument(
        "--calibration", action="store_true", help="those that prices are fitted to"
    )
    parser.add_argument("--rows", type=Path, help="file to which each request is appended as JSON")
    chosen = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    first = CALIBRATION if chosen.calibration else CHECKING
    measured.prepare()
    rows = []
    seeds = range(first, first + chosen.count)
    for row in measured.each(chosen.names or DRAWN, seeds, chosen.longest):
        rows.append(row)
        if chosen.rows is not None:
            with chosen.rows.open("a") as file:
                file.write(json.dumps(row._asdict()) + "\n")
    print(table.text(rows, chosen.longest))


if __name__ == "__main__":
    main()
