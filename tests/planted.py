"""Faults planted in a copy of the project, each of which the tests of its room must catch.

``python -m tests.planted`` plants them one after another, with the tests of README's command that
cover the room, until the first one fails; ``python -m tests.planted time_history jobs`` some.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]


class Fault(NamedTuple):
    """A line that is wrong, as by somebody who misread an equation or a rule."""

    file: str
    right: str
    wrong: str
    tests: tuple[str, ...]


SOLVERS, SERVICE = "solvers/vibroimpact_solvers", "service/vibroimpact_service"
FAULTS = {
    "impact_modes": Fault(
        f"{SOLVERS}/impact_modes/modal.py",
        "velocity = (p[:, list(struck)] @ rows) / omega[:, np.newaxis]",
        "velocity = (p[:, list(struck)] @ rows) * omega[:, np.newaxis]",
        ("tests/solvers/impact_modes", "tests/solvers/test_stability.py"),
    ),
    "existence_bands": Fault(  # the last pole of each mode is left out
        f"{SOLVERS}/existence_bands/certified.py",
        "highest = np.floor(self.q_stop * roots / np.pi + 0.5).astype(np.int64) + 1",
        "highest = np.floor(self.q_stop * roots / np.pi + 0.5).astype(np.int64)",
        ("tests/solvers/existence_bands", "tests/solvers/stress/test_existence_bands.py"),
    ),
    "periodic_motions": Fault(
        f"{SOLVERS}/periodic_motions/closed_form.py",
        "velocity_error = p_error * mu / (1.0 + k) + np.abs(velocity)",
        "velocity_error = 0.1 * p_error * mu / (1.0 + k) + 0.1 * np.abs(velocity)",
        ("tests/solvers/periodic_motions",),
    ),
    "branches": Fault(
        f"{SOLVERS}/branches/special.py",
        "kinds.append((Type.SYMMETRY if curve.base.symmetric else Type.FLIP, 0))",
        "kinds.append((Type.FLIP, 0))",
        ("tests/solvers/branches",),
    ),
    "calibration": Fault(  # all that is known is twice as uncertain
        f"{SOLVERS}/calibration/statistics.py",
        "deviation = np.where(told & (values > 0.0), 1.0 / values, np.inf)",
        "deviation = np.where(told & (values > 0.0), 2.0 / values, np.inf)",
        ("tests/service/test_calibrations.py",),
    ),
    "attractors": Fault(  # of an impact as a reflection that loses what it should keep
        f"{SOLVERS}/attractors/exponents.py",
        "self._factor = (1.0 + restitution) / np.diagonal(driven.mobility)",
        "self._factor = (2.0 * restitution) / np.diagonal(driven.mobility)",
        ("tests/solvers/attractors",),
    ),
    "time_history": Fault(  # bounces that last for as long as the first one
        f"{SOLVERS}/time_history/at_walls.py",
        "duration = 2.0 * u / (push * (1.0 - k))",
        "duration = 2.0 * u / push",
        ("tests/solvers/time_history",),
    ),
    "slow_flow": Fault(
        f"{SOLVERS}/slow_flow/bouncing_ball.py",
        "return self.fall * (1.0 + 2.0 * self.k * terms)",
        "return self.fall * (1.0 + 2.0 * terms)",
        ("tests/solvers/slow_flow",),
    ),
    "evaluate": Fault(  # requests that share one computation are charged for it each
        f"{SERVICE}/use_case/evaluation.py",
        "if not self.threads.running(name):",
        "if True:",
        ("tests/service/test_evaluate.py",),
    ),
    "jobs": Fault(  # what a dead process held is not taken over
        f"{SERVICE}/jobs/claims.py",
        "expired = sa.exists().where(RUNNING, jobs.c.claim_until < clock)",
        "expired = sa.exists().where(RUNNING, jobs.c.claim_until > clock)",
        ("tests/service/jobs/test_claims.py", "tests/service/jobs/test_queue.py"),
    ),
    "results": Fault(  # numbers in place of words in JSON
        f"{SERVICE}/results/encode.py",
        "return np.array(meaning.flags, dtype=object)[values].tolist()",
        "return values.tolist()",
        ("tests/service/results", "tests/service/test_result_documents.py"),
    ),
    "client": Fault(  # it does not wait for as long as the service says
        "client/vibroimpact/conversations.py",
        "return min(float(retry_after), _LONGEST_PAUSE)",
        "return min(float(attempt), _LONGEST_PAUSE)",
        ("tests/client/test_conversations.py", "tests/client/test_transport.py"),
    ),
}
"""Room -> its fault. Kernels stay as they are: they would be compiled anew for each."""


def planted(text: str, fault: Fault) -> str:
    """Return the text of a file with a fault.

    Raises
    ------
    ValueError
        Where the right line is not there once.
    """
    if text.count(fault.right) != 1:
        raise ValueError(f"{fault.file} has not once: {fault.right}")
    return text.replace(fault.right, fault.wrong)


def catch(fault: Fault, copy: Path) -> str | None:
    """Plant a fault in a copy; return the test that fails by it, None where none does."""
    from vibroimpact_solvers.kernels import cache

    file, environment = copy / fault.file, dict(os.environ)
    right = file.read_text(encoding="utf-8")
    packages = (str(copy / name) for name in ("solvers", "openapi", "service", "client"))
    environment["PYTHONPATH"] = os.pathsep.join(packages)
    if (kernels := cache.folder()) is not None:
        environment["NUMBA_CACHE_DIR"] = str(kernels.parent)
    file.write_text(planted(right, fault), encoding="utf-8")
    try:
        ended = subprocess.run(
            [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", *fault.tests],
            cwd=copy, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip
    finally:
        file.write_text(right, encoding="utf-8")
    if ended.returncode not in (0, 1):  # not by a test
        raise RuntimeError(ended.stdout[-2000:] + ended.stderr[-2000:])
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", ended.stdout, re.M)
    return failed[1] if failed else None


def main(rooms: list[str]) -> int:
    """Plant the faults of some rooms, or of all; return how many are not caught."""
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        archive = ["git", "archive", "--format", "tar", "HEAD"]
        tar = subprocess.run(archive, cwd=ROOT, capture_output=True, check=True).stdout
        subprocess.run(["tar", "-x", "-C", folder], input=tar, check=True)
        for room in rooms or FAULTS:
            by = catch(FAULTS[room], Path(folder))
            missed += by is None
            print(f"{room}: {'NOT CAUGHT' if by is None else f'caught by {by}'}", flush=True)
    return missed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
