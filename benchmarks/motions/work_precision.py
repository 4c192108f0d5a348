"""Run time against error of all integrators, and who is first at each level of error."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, Final

from benchmarks.harness import Timing, measure, ratio
from benchmarks.motions import cases, ours
from benchmarks.motions.cases import Case
from benchmarks.motions.peers import SLOW, Point, installed, ladder, settings, timed
from benchmarks.tables import Goal, Plot, Table

CAP: Final = 3.0
"""Seconds after which an integrator tries no tighter tolerance."""
LEVELS: Final = (1e-3, 1e-6, 1e-9, 1e-12)
_NEAR: Final = 4.0
"""The best level is this many times the least error that anybody reached: below, luck decides."""
WHOLE: Final = "Vibroimpact, whole call"
PREPARED: Final = "Vibroimpact, prepared"
_MS: Final = 1e3


@dataclass(frozen=True, slots=True)
class Entry:
    """A run of an integrator on a case, judged."""

    name: str
    point: Point
    missed: int
    error: float

    @property
    def is_ours(self) -> bool:
        """Whether it is one of `WHOLE` and `PREPARED`."""
        return self.name in {WHOLE, PREPARED}


@dataclass(frozen=True, slots=True)
class Leader:
    """Who is first at a level of error: the fastest peer, ours, and how many times faster it is.

    A ratio is None where nobody else is there, and 0 where ours is not.
    """

    level: float
    is_best: bool
    peer: Entry | None
    ours: dict[str, Entry | None]
    times: dict[str, float | None]


def entries(case: Case, names: Sequence[str], cap: float = CAP) -> list[Entry]:
    """Return the runs of ours and of the named integrators on a case."""
    runs: list[tuple[str, Point]] = [(name, point) for name, point in _mine(case)]
    for name in names:
        if name not in case.without:
            points = ladder(name, case.scene, case.missed, case.step, cap)
            runs += [(name, point) for point in points]
    return [Entry(name, point, *case.judged(point.outcome)) for name, point in runs]


def _mine(case: Case) -> Iterator[tuple[str, Point]]:
    if case.scene.limiter is None:
        yield PREPARED, timed(ours.prepared(case.scene), "–")
        yield WHOLE, timed(partial(ours.whole, case.scene), "–")
        return
    for tolerance in LEVELS:
        label = f"{tolerance:.2g}"
        yield PREPARED, timed(ours.prepared(case.scene, tolerance), label)
        yield WHOLE, timed(partial(ours.whole, case.scene, tolerance), label)


def leaders(found: Sequence[Entry], rounds: int = 7) -> Iterator[Leader]:
    """Yield who is first at each level of error that anybody reached, and at the best.

    Quick runs are timed once more, in turns.
    """
    errors = [one.error for one in found if not math.isnan(one.error)]
    best = _NEAR * min(errors)
    for level in (*(level for level in LEVELS if level > best), best):
        peer = _fastest(found, level, None)
        mine = {name: _fastest(found, level, name) for name in (PREPARED, WHOLE)}
        times = _times(peer, mine, rounds)
        yield Leader(level, level == best, peer, mine, times)


def _fastest(found: Sequence[Entry], level: float, name: str | None) -> Entry | None:
    """Return the fastest run of that name, None for any peer, that is as accurate as the level."""
    there = [
        one
        for one in found
        if (not one.is_ours if name is None else one.name == name) and one.error <= level
    ]
    return min(there, key=lambda one: one.point.seconds, default=None)


def _times(
    peer: Entry | None, mine: dict[str, Entry | None], rounds: int
) -> dict[str, float | None]:
    if peer is None:
        return dict.fromkeys(mine)
    found: dict[str, float | None] = {
        name: 0.0 if one is None else peer.point.seconds / one.point.seconds
        for name, one in mine.items()
    }
    again: dict[str, Any] = {
        name: one.point.again for name, one in mine.items() if one and one.point.again
    }
    if peer.point.again is not None and peer.point.seconds < SLOW and again:
        timings: dict[str, Timing] = measure(rounds, **again, peer=peer.point.again)
        for name in again:
            found[name] = ratio(timings["peer"], timings[name])
    return found


@cache
def _compared() -> tuple[tuple[Case, list[Entry]], ...]:
    names = installed()
    found = [(case, entries(case, names)) for case in cases.rigid()]
    soft = cases.soft()
    return (*found, (soft, entries(soft, names)))


def work_precision() -> Table:
    """Run time against error from loose to tight tolerances, all integrators in one run.

    A: error of the time of the hundredth impact. B and C: error of the state after whole
    periods of an impact mode, whose first state is exact to rounding; the modes are unstable,
    which magnifies that rounding. D and F: the largest error of the times of impacts and of the
    final state, against a motion of forty digits. E: error of the time of rest and of the final
    place. S: error of the final state, against Taylor series of thirty digits.
    """
    rows: list[tuple[Any, ...]] = []
    for case, found in _compared():
        for one in found:
            point = one.point
            spent = point.seconds * _MS, point.preparing * _MS
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


_REASONS: Final = {
    "B: chain N=13, elastic, 1 period": "two impacts: of a prepared call compiled code is a "
    "quarter, the way of some forty arrays into it a tenth, and the rest makes the result",
    "S: ": "Taylor series against Taylor series: a third fewer steps, in loops over limiters and "
    "orders where heyoka's code is unrolled for these two masses; forces are checked at every step",
}
"""Why peers are ahead, by the beginning of the case."""


def ahead() -> Table:
    """Time for an answer of some accuracy with no impact missed: ours and the fastest peer.

    Like with like: both prepared, or both from nothing. The best level is four times the least
    error that anybody reached.
    """
    rows: list[tuple[Any, ...]] = []
    for case, found in _compared():
        for leader in leaders(found):
            peer, whole = leader.peer, leader.ours[WHOLE]
            rows.append(
                (
                    case.label,
                    f"{'best, ' if leader.is_best else ''}{leader.level:.0e}",
                    "nobody" if peer is None else peer.name,
                    None if peer is None else peer.point.setting,
                    None if peer is None else peer.point.seconds * _MS,
                    None if peer is None else peer.point.preparing * _MS,
                    *(
                        None if one is None else one.point.seconds * _MS
                        for one in leader.ours.values()
                    ),
                    None if whole is None else whole.error,
                    leader.times[PREPARED],
                    _made_anew(leader),
                    leader.times[WHOLE],
                    None if peer is None else 1.0,
                )
            )
    table = Table(
        "Ahead at every level of error",
        (
            "case",
            "error at most",
            "fastest peer",
            "its tolerance",
            "its time [ms]",
            "its preparing [ms]",
            "prepared [ms]",
            "whole call [ms]",
            "our error",
            "both prepared, times faster",
            "both from nothing, times faster",
            "whole call over prepared peer, times faster",
            "goal",
        ),
        rows,
        "Prepared: made and compiled, with the state as all that is new; from nothing: our whole "
        "call, which is problem, plan and solution with estimates of errors, and the peer with "
        "its preparing, as for a structure not seen before. Quick ones take turns once more for "
        "the ratios. 0: ours is not as accurate.",
        Goal("both prepared, times faster", "goal", at_least=True),
    )
    reasons = {
        label: why
        for label in table.labels()
        for start, why in _REASONS.items()
        if label.startswith(start)
    }
    return replace(table, reasons=reasons)


def _made_anew(leader: Leader) -> float | None:
    """Return how many times faster the whole call is than a peer that is prepared for it."""
    peer, times = leader.peer, leader.times[WHOLE]
    if peer is None or not times:
        return times
    return times * (1.0 + peer.point.preparing / peer.point.seconds)


def rest() -> Table:
    """Tell how every integrator ends when a ball drops from 1 m, k = 0.9, and comes to rest."""
    rows: list[tuple[Any, ...]] = []
    for case, found in _compared():
        if case.name != "E":
            continue
        for one in found:
            outcome = one.point.outcome
            place = float(outcome.state[0])
            fallen = "falls through the floor" if place < -0.1 else "rests"
            seconds = None if math.isnan(one.point.seconds) else one.point.seconds * _MS
            row = (one.name, one.point.setting, outcome.end or fallen, len(outcome.times), place)
            rows.append((*row, seconds))
    return Table(
        "E: how the bouncing ball ends",
        ("integrator", "tolerance", "outcome", "impacts", "x in the end", "time [ms]"),
        rows,
        "It rests at t = 8.5789… and is followed to t = 20. Stalls: after 400 impacts, when "
        "the ball is lower than the rounding of the times, or when an impact is no later than the "
        "last.",
    )
