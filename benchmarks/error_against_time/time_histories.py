"""Time histories: all integrators from loose to tight tolerances."""

from __future__ import annotations

from typing import Any

from benchmarks.peers.ahead import CAP, compared
from benchmarks.peers.integrators import settings
from benchmarks.tables import Plot, Table


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
