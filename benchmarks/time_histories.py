"""Time histories: run time against error, impacts missed, long motions, and a chaotic one."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import mpmath
import numpy as np

from benchmarks.harness import Timing, measure, ratio
from benchmarks.motions import cases, ours
from benchmarks.motions.cases import GAP, from_mode
from benchmarks.motions.peers import PEERS, installed
from benchmarks.motions.scene import Outcome, Scene
from benchmarks.motions.work_precision import ahead, rest, work_precision
from benchmarks.tables import Goal, Table
from vibroimpact_solvers import presets, spectrum, time_history
from vibroimpact_solvers.model import Constraint
from vibroimpact_solvers.time_history import Problem, State

_MICRO = 1e6
_FULL: Final = 2.0**-52
"""heyoka's tolerance for full double precision."""


def against_heyoka() -> Table:
    """Compare with heyoka at full precision, taking turns in one run."""
    if "heyoka" not in installed():
        return Table("Against heyoka", ("case",), [], "heyoka is not installed")
    rows = []
    goals = {"A": 8.0, "B": 8.0, "C": 5.0}
    for case in (cases.oscillator(), *cases.short_chains(), cases.long_chain(100)):
        solve = PEERS["heyoka"].prepare(case.scene)
        goal = None if case.title.endswith("1 period") else goals[case.name]
        found, impacts = turns(7, case.scene, partial(solve, case.scene, _FULL))
        each = [found[name].processor / impacts * _MICRO for name in WAYS]
        times = [ratio(found["heyoka"], found[name]) for name in WAYS[:3]]
        rows.append((case.label, impacts, *each, *times, goal))
    return Table(
        "Against heyoka",
        (
            "case",
            "impacts",
            "prepared [µs/impact]",
            "with errors [µs/impact]",
            "whole call [µs/impact]",
            "heyoka [µs/impact]",
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


WAYS: Final = ("prepared", "with errors", "whole", "heyoka")


def turns(
    rounds: int, scene: Scene, peer: Callable[[], Outcome] | None
) -> tuple[dict[str, Timing], int]:
    """Return times of the ways to a motion, taking turns, and its impacts."""
    functions: dict[str, Any] = {
        "prepared": ours.prepared(scene),
        "with errors": ours.prepared(scene, estimate=True),
        "whole": partial(ours.whole, scene),
    }
    impacts = len(functions["prepared"]().times)
    if peer is not None:
        functions["heyoka"] = peer
    return measure(rounds, **functions), impacts


_FEW_MODES: Final = (
    "with few modes an impact is one number after the other: of thirteen, two fifths are the "
    "certified search for the first passage, which the others do without, a quarter sines, "
    "cosines and two advances, the rest the impact and passing from one step to the next; of a "
    "short motion, 8 µs are the way into compiled code and the result's way out"
)
_FLOORS: Final = {13: 0.25, 100: 1.1, 1000: 10.0}
"""Three evaluations and one advance of all modes, µs, by the number of modes."""


def long_motions() -> Table:
    """Compare with heyoka in elastic motions with many impacts, where starting costs nothing."""
    rows: list[tuple[Any, ...]] = []
    for title, n, dof, factor, periods, goal in (
        ("oscillator", 1, 0, 1.5, 5000, 8.0),
        ("chain N=13", 13, 5, 1.5, 500, 8.0),
        ("chain N=100", 100, 49, 1.5, 250, 5.0),
        ("chain N=1000", 1000, 499, 1.5, 20, 3.0),
    ):
        top = spectrum.spectrum(presets.chain(n, [Constraint.at(dof, GAP)])).largest_frequency
        scene = from_mode(n, dof, factor * 2.0 / np.pi * top, periods)
        there = "heyoka" in installed()
        solve = PEERS["heyoka"].prepare(scene) if there else None
        peer = None if solve is None else partial(solve, scene, _FULL)
        found, impacts = turns(3, scene, peer)
        each = [
            found[name].processor / impacts * _MICRO if name in found else None for name in WAYS
        ]
        times = None
        if peer is not None:
            theirs = len(peer().times)
            each[3] = found["heyoka"].processor / theirs * _MICRO
            times = found["heyoka"].processor / theirs / (found["prepared"].processor / impacts)
        floor = _FLOORS.get(n)
        best = found["prepared"].processor / impacts * _MICRO
        above = None if floor is None else best / floor
        rows.append((title, impacts, *each, above, times, goal if times else None))
    return Table(
        "Against heyoka, long motions",
        (
            "case",
            "impacts",
            "prepared [µs/impact]",
            "with errors [µs/impact]",
            "whole call [µs/impact]",
            "heyoka [µs/impact]",
            "over the floor",
            "times faster",
            "goal",
        ),
        rows,
        "heyoka at full double precision. The floor "
        "is three evaluations of the constrained coordinate and one advance of all modes: "
        "0.25, 1.1 and 10 µs for 13, 100 and 1000 modes.",
        Goal("times faster", "goal", at_least=True),
        reasons={"": _FEW_MODES},
    )


def stress() -> Table:
    """Follow one motion through ten million impacts: time, energy, and the last impact."""
    count = 10**7
    with mpmath.workdps(40):
        half = mpmath.asin(mpmath.mpf(1) / 5)
        end, last = float(2 * half * count), half * (2 * count - 1)
    system = presets.oscillator([Constraint.at(0, 1.0)], 1.0)
    state = State(np.zeros(1), np.array([5.0]))
    problem = Problem(system, state, end, estimate=False)
    motion = time_history.prepare(problem, time_history.plan(problem))
    motion.solve()
    start = time.process_time()
    found = motion.solve()
    seconds = time.process_time() - start
    assert found.impact_time is not None
    assert found.impact_velocity is not None
    row = (
        found.count_impacts,
        seconds / found.count_impacts * _MICRO,
        abs(float(found.impact_time[-1] / last - 1)),
        float(np.abs(np.abs(found.impact_velocity) / math.sqrt(24.0) - 1.0).max()),
    )
    return Table(
        "Ten million impacts",
        ("impacts", "[µs/impact]", "error of the last time", "largest error of a velocity"),
        [row],
        "Elastic oscillator between walls; errors are relative, times known to 40 digits.",
    )


def chaos() -> Table:
    """Follow case F, a random start of a chain between two pairs of lossy walls, to t = 200.

    Past the time until which it is predictable no method in double precision is right; the
    balance of its energy holds all the same.
    """
    scene = cases.chaotic(200.0)
    problem = Problem(
        scene.system,
        State(scene.state[: scene.n], scene.state[scene.n :]),
        scene.t_end,
        t=np.linspace(0.0, scene.t_end, 201),
        outputs=frozenset({"impacts", "energy"}),
    )
    found = time_history.solve(problem, time_history.plan(problem))
    assert found.impact_velocity is not None
    assert found.energy is not None
    timed = measure(rounds=3, ours=lambda: time_history.solve(problem, time_history.plan(problem)))
    # What impacts take: the mobility of one mass is 1.
    lost = 0.5 * (1.0 - 0.9**2) * float((found.impact_velocity**2).sum())
    balance = abs(found.energy[0] - lost - found.energy[-1]) / found.energy[0]
    until, spent = found.error_predictable_until, timed["ours"].processor * 1e3
    return Table(
        "F: two limiters, chaotic, to t = 200",
        ("impacts", "predictable until", "energy balance", "time [ms]"),
        [(found.count_impacts, until, balance, spent)],
        "The energy balance is what impacts take and what is left, relative to the start. Up to "
        "the time until which it is predictable the motion is compared above.",
    )


TABLES: Final = (work_precision, ahead, rest, against_heyoka, long_motions, stress, chaos)
