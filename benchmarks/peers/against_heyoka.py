"""Time for an impact against heyoka at full double precision, the fastest of the peers."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.harness import Timing, measure, ratio
from benchmarks.peers import cases, ours
from benchmarks.peers.cases import GAP, from_mode
from benchmarks.peers.integrators import PEERS
from benchmarks.peers.scene import Scene
from benchmarks.tables import Goal, Table
from vibroimpact_solvers import presets, spectrum
from vibroimpact_solvers.model import Constraint

_MICRO: Final = 1e6
_FULL: Final = 2.0**-52
"""heyoka's tolerance for full double precision."""
_WAYS: Final = ("prepared", "with errors", "whole call", "heyoka")
_TIMES: Final = tuple(f"{way} [µs/impact]" for way in _WAYS)
_FEW_MODES: Final = (
    "with few modes an impact is one number after the other: of thirteen, two fifths are the "
    "certified search for the first passage, which the others do without, a quarter sines, "
    "cosines and two advances, the rest the impact and passing from one step to the next; of a "
    "short motion, 8 µs are the way into compiled code and the result's way out"
)


def _turns(rounds: int, scene: Scene) -> tuple[dict[str, Timing], int, int]:
    """Return times of the ways to a motion, taking turns, and impacts of ours and heyoka's."""
    solve = PEERS["heyoka"].prepare(scene)
    functions: dict[str, Any] = {
        "prepared": ours.prepared(scene),
        "with errors": ours.prepared(scene, estimate=True),
        "whole call": partial(ours.whole, scene),
        "heyoka": partial(solve, scene, _FULL),
    }
    impacts, theirs = (len(functions[name]().times) for name in ("prepared", "heyoka"))
    return measure(rounds, **functions), impacts, theirs


def against_heyoka() -> Table:
    """Compare with heyoka at full precision, taking turns in one run."""
    rows: list[tuple[Any, ...]] = []
    goals = {"A": 8.0, "B": 8.0, "C": 5.0}
    for case in (cases.oscillator(), *cases.short_chains(), cases.long_chain(100)):
        goal = None if case.title.endswith("1 period") else goals[case.name]
        timings, impacts, _ = _turns(7, case.scene)
        each = [timings[name].processor / impacts * _MICRO for name in _WAYS]
        times = [ratio(timings["heyoka"], timings[name]) for name in _WAYS[:3]]
        rows.append((case.label, impacts, *each, *times, goal))
    return Table(
        "Against heyoka",
        (
            "case",
            "impacts",
            *_TIMES,
            "times faster",
            "with errors, times faster",
            "whole call, times faster",
            "goal",
        ),
        rows,
        "Like with like: heyoka's integrator is made beforehand and gets a state, and so does the "
        "prepared motion; with errors it also tells how far it can be trusted. Whole call: "
        "problem, plan and solution, with errors.",
        Goal("times faster", "goal", at_least=True),
        reasons={"": _FEW_MODES},
    )


def long_motions() -> Table:
    """Compare with heyoka in elastic motions with many impacts, where starting costs nothing."""
    rows: list[tuple[Any, ...]] = []
    for title, n, dof, periods, goal in (
        ("oscillator", 1, 0, 5000, 8.0),
        ("chain N=13", 13, 5, 500, 8.0),
        ("chain N=100", 100, 49, 250, 5.0),
        ("chain N=1000", 1000, 499, 20, 3.0),
    ):
        top = spectrum.spectrum(presets.chain(n, [Constraint.at(dof, GAP)])).largest_frequency
        scene = from_mode(n, dof, 1.5 * 2.0 / np.pi * top, periods)
        timings, impacts, theirs = _turns(3, scene)
        each = [timings[name].processor / impacts * _MICRO for name in _WAYS[:3]]
        heyoka = timings["heyoka"].processor / theirs * _MICRO
        rows.append((title, impacts, *each, heyoka, heyoka / each[0], goal))
    return Table(
        "Against heyoka, long motions",
        ("case", "impacts", *_TIMES, "times faster", "goal"),
        rows,
        "heyoka at full double precision.",
        Goal("times faster", "goal", at_least=True),
        reasons={"": _FEW_MODES},
    )
