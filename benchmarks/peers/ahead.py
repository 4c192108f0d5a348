"""Who is first at each level of error, and how each ends where impacts accumulate."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, Final, NamedTuple

from benchmarks.harness import measure, ratio
from benchmarks.peers import cases, ours
from benchmarks.peers.cases import Case
from benchmarks.peers.integrators import SLOW, Point, installed, ladder, timed
from benchmarks.peers.scene import Outcome
from benchmarks.tables import Goal, Table

CAP: Final = 3.0
"""Seconds after which an integrator tries no tighter tolerance."""
LEVELS: Final = (1e-3, 1e-6, 1e-9, 1e-12)
_NEAR: Final = 4.0
"""The best level is this many times the least error that is reached: below, luck decides."""
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


class Leader(NamedTuple):
    """Who is first at a level of error: the fastest peer, ours, and how many times faster it is.

    A ratio is None where no peer is as accurate, and 0 where ours is not.
    """

    level: float
    is_best: bool
    peer: Entry | None
    ours: dict[str, Entry | None]
    times: dict[str, float | None]


@cache
def compared() -> tuple[tuple[Case, list[Entry]], ...]:
    """Return the runs of all integrators on all cases, made once in a process."""
    names = installed()
    return tuple((case, list(_entries(case, names))) for case in cases.every())


def _entries(case: Case, names: Sequence[str]) -> Iterator[Entry]:
    """Yield the runs of ours and of the named integrators on a case."""
    soft = case.scene.limiter is not None
    for tolerance in LEVELS if soft else (None,):
        label = "–" if tolerance is None else f"{tolerance:.2g}"
        ways: dict[str, Callable[[], Outcome]] = {
            PREPARED: ours.prepared(case.scene, tolerance),
            WHOLE: partial(ours.whole, case.scene, tolerance),
        }
        for name, way in ways.items():
            point = timed(way, label)
            yield Entry(name, point, *case.judged(point.outcome))
    for name in names:
        if name not in case.without:
            for point in ladder(name, case.scene, case.missed, case.step, CAP):
                yield Entry(name, point, *case.judged(point.outcome))


def leaders(entries: Sequence[Entry], rounds: int = 7) -> Iterator[Leader]:
    """Yield who is first at each level of error that is reached, and at the best.

    Quick runs are timed once more, in turns.
    """
    errors = [one.error for one in entries if not math.isnan(one.error)]
    best = _NEAR * min(errors)
    for level in (*(level for level in LEVELS if level > best), best):
        accurate = [one for one in entries if one.error <= level]
        peer = _fastest(one for one in accurate if not one.is_ours)
        mine = {
            name: _fastest(one for one in accurate if one.name == name)
            for name in (PREPARED, WHOLE)
        }
        yield Leader(level, level == best, peer, mine, _times(peer, mine, rounds))


def _fastest(entries: Iterator[Entry]) -> Entry | None:
    return min(entries, key=lambda one: one.point.seconds, default=None)


def _times(
    peer: Entry | None, mine: dict[str, Entry | None], rounds: int
) -> dict[str, float | None]:
    """Return how many times faster each way of ours is; quick ones are timed anew, in turns."""
    if peer is None:
        return dict.fromkeys(mine)
    times: dict[str, float | None] = {
        name: 0.0 if one is None else peer.point.seconds / one.point.seconds
        for name, one in mine.items()
    }
    again: dict[str, Any] = {
        name: one.point.again for name, one in mine.items() if one and one.point.again
    }
    if peer.point.again is not None and peer.point.seconds < SLOW and again:
        timings = measure(rounds, **again, peer=peer.point.again)
        times |= {name: ratio(timings["peer"], timings[name]) for name in again}
    return times


_REASONS: Final = {
    "B: chain N=13, elastic, 1 period": "two impacts: of a prepared call compiled code is a "
    "quarter, the way of some thirty arrays into it another, and the rest makes the result",
    "S: ": "Taylor series against Taylor series: a third fewer steps, in loops over limiters and "
    "orders where heyoka's code is unrolled for these two masses; forces are checked at every step",
}
"""Why peers are ahead, by the beginning of the case."""


def ahead() -> Table:
    """Time for an answer of some accuracy with no impact missed: ours and the fastest peer.

    Like with like: both prepared, or both from nothing. The best level is four times the least
    error that is reached.
    """
    rows = [_row(case, leader) for case, entries in compared() for leader in leaders(entries)]
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


def _row(case: Case, leader: Leader) -> tuple[Any, ...]:
    level, is_best, peer, mine, times = leader
    whole, nothing = mine[WHOLE], times[WHOLE]
    theirs: tuple[Any, ...] = ("none", None, None, None)
    if peer is not None:
        point = peer.point
        theirs = (peer.name, point.setting, point.seconds * _MS, point.preparing * _MS)
        # A peer that is prepared for this structure first.
        nothing = nothing and nothing * (1.0 + point.preparing / point.seconds)
    return (
        case.label,
        f"{'best, ' if is_best else ''}{level:.0e}",
        *theirs,
        *(None if one is None else one.point.seconds * _MS for one in mine.values()),
        None if whole is None else whole.error,
        times[PREPARED],
        nothing,
        times[WHOLE],
        None if peer is None else 1.0,
    )


def rest() -> Table:
    """Tell how every integrator ends when a ball drops from 1 m, k = 0.9, and comes to rest."""
    rows: list[tuple[Any, ...]] = []
    (entries,) = (entries for case, entries in compared() if case.name == "E")
    for one in entries:
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
