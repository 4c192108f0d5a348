"""Periodic attractors with stops of finite stiffness by Newton's method in their switchings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import EPS
from vibroimpact_solvers.attractors.observed import Observed
from vibroimpact_solvers.attractors.problem import Problem
from vibroimpact_solvers.attractors.verdicts import Verdict
from vibroimpact_solvers.errors import attempt
from vibroimpact_solvers.periodic_motions.multipliers import error_of_largest
from vibroimpact_solvers.periodic_motions.stops.orbit_columns import contact_rows
from vibroimpact_solvers.periodic_motions.stops.orbit_errors import errors, multipliers
from vibroimpact_solvers.periodic_motions.stops.orbit_existence import verdict
from vibroimpact_solvers.periodic_motions.stops.orbits import newton
from vibroimpact_solvers.periodic_motions.stops.scenes import Cell, Scenes
from vibroimpact_solvers.periodic_motions.stops.sequences import Contact, Start, start_of
from vibroimpact_solvers.results.attractors import Nature, Verification
from vibroimpact_solvers.results.impact_modes import Reason

MOST_CONTACTS: Final = 32
"""Contacts per period up to which motions are confirmed."""
_SAME: Final = 1e-3  # of the drive's phase, rad
Row = dict[str, Any]


@dataclass(frozen=True, eq=False, slots=True)
class ConfirmedContacts:
    """The contacts of one period of an attractor, and what Newton's method says of them.

    Errors are nan where it does not confirm the motion, whose contacts are then those of its time
    history. Times are those of motions, from t = 0.
    """

    verification: Verification
    rows: list[Row] = field(default_factory=list)
    stability: float = math.nan
    stability_error: float = math.inf


def confirmed(
    problem: Problem, scenes: Scenes, settled: Verdict, *, wanted: bool
) -> ConfirmedContacts:
    """Confirm an attractor, where that is asked for and possible."""
    if settled.nature is not Nature.PERIODIC:
        return ConfirmedContacts(Verification.NOT_PERIODIC)
    length = settled.period * problem.period
    begin = _begin(problem, settled, length)
    rows = rows_between(problem, settled.motion, begin, begin + length)
    if len(rows) > MOST_CONTACTS:
        return ConfirmedContacts(Verification.TOO_LONG, rows)
    proof = attempt(_by_newton, problem, scenes, settled, begin) if wanted else None
    if isinstance(proof, ConfirmedContacts):
        return proof
    return ConfirmedContacts(Verification.NOT_REACHED, rows)


def _by_newton(
    problem: Problem, scenes: Scenes, settled: Verdict, begin: float
) -> ConfirmedContacts | None:
    """Return what Newton's method confirms, None: it does not."""
    cell = Cell(scenes, float(problem.Omega[0]), settled.period)
    start = _start(scenes, settled.motion, begin, cell.length)
    if start is None:
        return None
    one = newton(cell, *start)
    if one is None or np.abs(one.times - start.times).max(initial=0.0) * cell.Omega > _SAME:
        return None
    off = errors(one)
    if verdict(one, off).reason != Reason.OK:
        return None
    values, doubts = multipliers(one, off.times)
    modulus = abs(complex(values[0]))
    error = float(error_of_largest(values[np.newaxis], doubts[np.newaxis])[0]) + 2.0 * EPS * modulus
    why = Verification.UNSTABLE if modulus > 1.0 + error else Verification.CONFIRMED
    return ConfirmedContacts(why, contact_rows(one, off), modulus, error)


def _start(scenes: Scenes, motion: Observed, begin: float, length: float) -> Start | None:
    """Return the switchings of a motion in a period, by the basis' time."""
    table, scale = motion.contacts, scenes.scale
    columns = (
        table["constraint"].tolist(), table["side"].tolist(), (scale * table["start"]).tolist(),
        (scale * table["stop"]).tolist(), table["velocity"].tolist(),
    )  # fmt: skip
    contacts = [Contact(*row) for row in zip(*columns, strict=True)]
    return start_of(contacts, scale * begin, length)


def _begin(problem: Problem, settled: Verdict, length: float) -> float:
    """Return where the last period of a motion begins, as far from switchings as possible."""
    end = float(problem.sections[settled.motion.periods])
    table = settled.motion.contacts
    times = np.sort(np.concatenate([table["start"], table["stop"]]))
    early = times[(times >= end - 2.0 * length) & (times < end - length)]
    ends = np.concatenate([[end - 2.0 * length], early, [end - length]])
    widest = int(np.diff(ends).argmax())
    return float(0.5 * (ends[widest] + ends[widest + 1]))


def rows_between(problem: Problem, motion: Observed, start: float, stop: float) -> list[Row]:
    """Return the rows of contacts that begin in a time, as the time history has them."""
    table, Omega = motion.contacts, float(problem.Omega[0])
    rows = list[Row]()
    for k in np.flatnonzero((table["start"] >= start) & (table["start"] < stop)).tolist():
        row: Row = {name: float(values[k]) for name, values in table.items()}
        begin, length = row.pop("start"), row.pop("stop")
        row |= {
            "constraint": int(row["constraint"]), "side": int(row["side"]), "time": begin,
            "phase": math.fmod(Omega * begin, 2.0 * math.pi), "duration": length - begin,
            "start_indentation": math.nan,
        }  # fmt: skip
        names = [name for name in row if name not in {"constraint", "side"}]
        rows.append(row | {f"error_{name}": math.nan for name in names})
    return rows
