"""Estimates of plans against measured times: ``python -m benchmarks.prices --help``."""

from __future__ import annotations

import argparse
import itertools
import json
import os
from pathlib import Path

from benchmarks.prices import calibration, measured, table
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
        "--calibrate",
        action="store_true",
        help="measure the requests that prices are fitted to, and write the rates",
    )
    parser.add_argument(
        "--rows", type=Path, help="file with requests that were measured; others are appended"
    )
    chosen = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    first = CALIBRATION if chosen.calibrate else CHECKING
    names, seeds = chosen.names or list(DRAWN), range(first, first + chosen.count)
    rows = _measured(names, seeds, chosen.longest, chosen.rows)
    if chosen.calibrate:
        print("Held out: each half by rates that are fitted to the other\n")
        print(table.text(calibration.held_out(rows, chosen.longest), chosen.longest))
        calibration.write(*calibration.calibrate(rows, chosen.longest))
    else:
        print(table.text(calibration.estimates(rows), chosen.longest))


def _measured(
    names: list[str], seeds: range, longest: float, file: Path | None
) -> list[measured.Measured]:
    """Return the requests of these names and seeds; only those are measured that the file lacks."""
    known: dict[tuple[str, int], measured.Measured] = {}
    if file is not None and file.exists():
        kept = (measured.Measured(**json.loads(line)) for line in file.read_text().splitlines())
        known = {(row.name, row.seed): row for row in kept}
    rows, prepared = list[measured.Measured](), False
    for name, seed in itertools.product(names, seeds):
        row = known.get((name, seed))
        if row is None:
            if not prepared:
                measured.prepare()
                prepared = True
            row = measured.one(name, seed, longest)
            if row is not None and file is not None:
                with file.open("a") as out:
                    out.write(json.dumps(row._asdict()) + "\n")
        if row is not None:
            rows.append(row)
    return rows


if __name__ == "__main__":
    main()
