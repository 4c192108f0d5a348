"""Siconos, which Debian packages for its own Python: it runs in a process of that one."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.peers.scene import Outcome, Scene

PYTHON: Final = Path("/usr/bin/python3")
VARIANTS: Final = {
    "Siconos, time stepping": (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5),
    "Siconos, event-driven": (1e-3, 1e-6, 1e-9, 1e-12, 2.5e-14),
}
"""Ways it follows a motion, and their settings: steps, and tolerances of LSODAR."""
SETTINGS: Final = (
    "Siconos: time stepping by Moreau and Jean, theta = 1/2, with steps for tolerances; or "
    "event-driven with LSODAR; Newton's impact law, Lemke's method; loads as undamped masses "
    "beside the structure, so that its loop calls no Python; its loop alone is timed, stepped "
    "from Python as in its examples"
)
_WORKER: Final = Path(__file__).with_name("siconos_worker.py")


@cache
def version() -> str | None:
    """Return the version of Debian's Siconos, None where it cannot be imported."""
    if not PYTHON.exists():
        return None
    done = subprocess.run(
        [str(PYTHON), "-I", str(_WORKER), "--version"],
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout.strip() or None if done.returncode == 0 else None


def runs(variant: str, scene: Scene, cap: float) -> Iterator[tuple[str, Outcome, float]]:
    """Yield setting, outcome and seconds of the processor, from loose to tight.

    A run that would take longer than the cap is left out, and so are all after it.
    """
    request = {
        "stepping": variant == "Siconos, time stepping",
        "settings": VARIANTS[variant],
        "cap": cap,
        "K": scene.stiffness.tolist(),
        "C": None if scene.damping is None else scene.damping.tolist(),
        "force": None if scene.system.force is None else scene.system.force.tolist(),
        "loads": [[one.dof, one.amplitude, one.frequency, one.phase] for one in scene.load],
        "walls": [[wall.dof, wall.side, wall.gap, wall.restitution] for wall in scene.walls],
        "state": scene.state.tolist(),
        "t_end": scene.t_end,
        "most": scene.most,
    }
    done = subprocess.run(
        [str(PYTHON), "-I", str(_WORKER)],
        input=json.dumps(request),
        capture_output=True,
        text=True,
        check=False,
    )
    # A run that ends the process leaves the lines of those before it.
    for line in done.stdout.splitlines():
        if not line.startswith("{"):
            continue
        record: dict[str, Any] = json.loads(line)
        label = f"{'h = ' if request['stepping'] else ''}{record['setting']:.2g}"
        outcome = Outcome(tuple(record["times"]), np.array(record["state"]), record["end"])
        yield label, outcome, record["seconds"] or float("nan")
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"ends with {done.returncode}"])[-1]
        state = np.full(2 * scene.n, np.nan)
        yield "–", Outcome((), state, f"fails: {last[:60]}"), float("nan")
