"""Time histories: all integrators from loose to tight tolerances, and ten million impacts."""

from __future__ import annotations

import math
import time
from typing import Any

import mpmath
import numpy as np

from benchmarks.peers.ahead import CAP, compared
from benchmarks.peers.integrators import settings
from benchmarks.tables import Plot, Table
from vibroimpact_solvers import presets, time_history
from vibroimpact_solvers.model import Constraint
from vibroimpact_solvers.time_history import Problem, State


def time_histories() -> Table:
    """Run time against error from loose to tight tolerances, all integrators in one run.

    A: error of the time of the hundredth impact. B and C: error of the state after whole
    periods of an impact mode, whose first state is exact to rounding; the modes are unstable,
    which magnifies that rounding. D and F: the largest error of the times of impacts and of the
    final state, against a motion of forty digits. E: error of the time of rest and of the final
    place. S: error of the final state, against Taylor series of thirty digits.
    """
    rows: list[tuple[Any, ...]] = []
    for case, entries in compared():
        for one in entries:
            point = one.point
            spent = point.seconds * 1e3, point.preparing * 1e3
            missed = one.missed if case.impacts else None
            rows.append((case.label, one.name, point.setting, *spent, missed, one.error))
    return Table(
        "Run time against error: time histories",
        (
            "case",
            "integrator",
            "tolerance",
            "time [ms]",
            "preparing [ms]",
            "impacts missed",
            "error",
        ),
        rows,
        f"Time of the processor, compiled beforehand; preparing is what the first run took more. "
        f"{settings()} Relative tolerances; absolute ones are a hundredth of them. Where impacts "
        f"are missed, integrators that can are run again with steps short enough for the motion; "
        f"no number: impacts are missing. A run that takes {CAP:g} s is an integrator's last.",
        plots=(Plot("time [ms]", "error", by="integrator", panel="case"),),
    )


def ten_million_impacts() -> Table:
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
    result = motion.solve()
    seconds = time.process_time() - start
    assert result.impact_time is not None
    assert result.impact_velocity is not None
    row = (
        result.count_impacts,
        seconds / result.count_impacts * 1e6,
        abs(float(result.impact_time[-1] / last - 1)),
        float(np.abs(np.abs(result.impact_velocity) / math.sqrt(24.0) - 1.0).max()),
    )
    return Table(
        "Ten million impacts",
        ("impacts", "[µs/impact]", "error of the last time", "largest error of a velocity"),
        [row],
        "Elastic oscillator between walls; errors are relative, times known to 40 digits.",
    )
