"""Compares this checkout's service with that of another: ``python -m benchmarks.service``."""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.service.compare import ROUNDS, SECONDS, against
from benchmarks.writing import text


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.service", description=__doc__)
    parser.add_argument("--against", type=Path, required=True, help="the other checkout")
    parser.add_argument("--python", type=Path, help="its interpreter; else that of its .venv")
    parser.add_argument("--only", default="", help="a part of the names of the loads to measure")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="length of a load")
    given = parser.parse_args()
    checkout = given.against.resolve()
    print(text(against(checkout, given.python, given.only, given.rounds, given.seconds)))


if __name__ == "__main__":
    main()
