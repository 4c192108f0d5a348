"""Newton's law of impact in balls: who is given an impulse is certain, or it is refused."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import flint

from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.time_history.extended.precision import (
    Matrix,
    Real,
    column,
    matrix,
    undecided,
)
from vibroimpact_solvers.time_history.extended.structure import Body, Contact

MOST_SIMULTANEOUS: Final = 8
"""Largest number of constraints that an impact may concern."""


@dataclass(frozen=True, eq=False, slots=True)
class Blow:
    """What one struck constraint does.

    Parameters
    ----------
    contact : Contact
    active : tuple of Contact
        Those that are given an impulse: it, and constraints in contact that are pressed.
    released : tuple of Contact
        Constraints in contact that leave their walls.
    impulses : matrix, shape (active, dof)
        The impulses, of the velocities before.
    changes : matrix, shape (dof, active)
        The changes of velocities by the impulses.
    """

    contact: Contact
    active: tuple[Contact, ...]
    released: tuple[Contact, ...]
    impulses: Matrix
    changes: Matrix


def blows(
    body: Body,
    fresh: list[Contact],
    held: tuple[Contact, ...],
    speeds: list[Real],
    now: Real,
) -> list[Blow]:
    """Return the blows of the constraints that are struck.

    Parameters
    ----------
    speeds : list of arb
        Velocities of the struck constraints, of all motions that are enclosed.

    Raises
    ------
    PlanError
        Where the order of impacts or the sign of an impulse matters, and is not certain.
    """
    groups = [_pressed_on(body, contact, fresh, held) for contact in fresh]
    seen: set[Contact] = set()
    for group in groups:
        if seen & set(group):
            names = " and ".join(sorted({str(index) for index, _ in fresh}))
            raise undecided(f"in which order constraints {names} strike, which matters", now)
        seen |= set(group)
    return [_blow(body, g, u, now) for g, u in zip(groups, speeds, strict=True)]


def _pressed_on(
    body: Body, contact: Contact, fresh: list[Contact], held: tuple[Contact, ...]
) -> list[Contact]:
    """Return a struck constraint and those that its impulse moves, directly or not."""
    group, rest = [contact], [c for c in (*fresh, *held) if c != contact]
    for one in group:
        change = body.change(one)
        for other in list(rest):
            if not (body.row(other) * change)[0, 0].is_zero():
                group.append(other)
                rest.remove(other)
    if len(group) > MOST_SIMULTANEOUS:
        raise PlanError(f"more than {MOST_SIMULTANEOUS} constraints meet in one impact")
    return group


def _blow(body: Body, group: list[Contact], speed: Real, now: Real) -> Blow:
    """Return the one blow that satisfies the law: impulses push, and nobody goes on."""
    struck, held = group[0], group[1:]
    k = flint.arb(body.system.constraints[struck[0]].restitution)
    for size in range(len(held) + 1):
        for pressed in itertools.combinations(held, size):
            active = (struck, *pressed)
            rows = matrix([body.row(c).entries() for c in active])
            changes = matrix([body.change(c).entries() for c in active]).transpose()
            inverse = (rows * changes).inv()
            unit = inverse * column([1 + k, *[flint.arb(0)] * size])
            left = [c for c in held if c not in pressed]
            leaves = [(body.row(c) * changes * unit)[0, 0] for c in left]
            if all(p > 0 for p in unit.entries()) and all(w > 0 for w in leaves) and speed > 0:
                return Blow(struck, active, tuple(left), unit * body.row(struck), changes)
    raise undecided(f"what the impact of constraint {struck[0]} does", now)
