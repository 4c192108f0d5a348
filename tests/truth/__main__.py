"""``python -m tests.truth``: the random sets against their references."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from tests.truth.campaign import Outcome, checked, follow
from tests.truth.sets import SETS
from tests.truth.verdicts import Case, Report


def main() -> int:
    """Run the sets; the exit code tells whether anything failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.truth", description=__doc__)
    parser.add_argument("sets", nargs="*", metavar="SET", help=", ".join(SETS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, help="cases of each set")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--folder", type=Path, help="where outcomes are kept, to be continued")
    parser.add_argument("--show", type=int, metavar="INDEX", help="print one case and check it")
    parser.add_argument("--case", type=Path, help="check one case, as --show prints it")
    parser.add_argument("--most", type=int, default=5, help="failures shown of each kind")
    arguments = parser.parse_args()
    names = arguments.sets or list(SETS)
    if set(names) - set(SETS):
        parser.error(f"sets are {', '.join(SETS)}")
    if arguments.case is not None:
        document = json.loads(arguments.case.read_text())
        return _check(names[0], Case(arguments.case.stem, document))
    if arguments.show is not None:
        return _check(names[0], SETS[names[0]].case(arguments.seed, arguments.show))
    failed = False
    for name in names:
        count = SETS[name].usual if arguments.count is None else arguments.count
        outcome = follow(name, arguments.seed, count, arguments.jobs, arguments.folder)
        print(summary(outcome, arguments.most))
        failed |= bool(outcome.failures)
    return int(failed)


def _check(name: str, case: Case) -> int:
    """Print a case, check it and print what fails."""
    report = Report()
    print(case.name)
    print(json.dumps(case.document))
    checked(name, case, report)
    for kind, message in report.failures:
        print(f"FAILED {kind}: {message}")
    for what in report.counts:
        print(what)
    for what, ratios in report.ratios.items():
        print(f"{what}: stated / true error at least {min(ratios):.3g}")
    return int(bool(report.failures))


def summary(outcome: Outcome, most: int) -> str:
    """Return counts, the table of pessimism and the failures of a set."""
    lines = [f"{outcome.name}: {outcome.cases} cases, {len(outcome.failures)} failures"]
    lines += [f"  {n:7} {what}" for what, n in sorted(outcome.counts.items())]
    if outcome.ratios:
        lines.append(f"  {'stated / true error':42} {'cases':>7} {'least':>9} "
                     f"{'median':>9} {'90 %':>9} {'most':>9}")  # fmt: skip
    for what, values in sorted(outcome.ratios.items()):
        r = np.array(values)
        least, median, high, top = (
            r.min(),
            np.median(r),
            np.quantile(r, 0.9, method="higher"),
            r.max(),
        )
        lines.append(f"  {what:42} {r.size:7} {least:9.3g} {median:9.3g} {high:9.3g} {top:9.3g}")
    for kind, n in sorted(outcome.failed.items()):
        lines.append(f"  FAILED {n:6} {kind}")
        chosen = [f for f in outcome.failures if f["kind"] == kind][:most]
        lines += [f"      {f['index']} ({f['case']}): {f['message']}" for f in chosen]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
