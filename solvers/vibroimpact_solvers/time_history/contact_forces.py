"""Forces of walls on the coordinates that rest at them, and impulses that keep them closed."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Final

import numpy as np

from vibroimpact_solvers import condensation
from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.kernels import rigid_state
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.model import System
from vibroimpact_solvers.time_history.basis import Basis
from vibroimpact_solvers.time_history.modal_equations import Forces

_EPS: Final = float(np.finfo(np.float64).eps)
_UNCOUPLED: Final = 64.0 * _EPS  # of its terms, where a mobility or a force is rounding
_DEPENDENT: Final = 1e12  # condition of mobilities, in units of their roots
_REFINED: Final = 8  # passes, each of which gains four digits or more
Contact = tuple[int, int]
"""A constraint at rest at a wall: its index, and 1 for the upper or -1 for the lower wall."""


def require_independent(mobility: Floats, contacts: tuple[Contact, ...]) -> None:
    """Refuse contacts of which one is a combination of the others: forces are not unique."""
    held = [index for index, _ in contacts]
    among, sizes = mobility[np.ix_(held, held)], np.sqrt(mobility.diagonal()[held])
    if len(held) > 1 and np.linalg.cond(among / np.outer(sizes, sizes)) > _DEPENDENT:
        which = ", ".join(map(str, held))
        message = f"the constraints {which} depend on one another and rest at the same time"
        raise ConvergenceError(f"{message}: how they share their force is not known")


def at_walls(system: System, contacts: tuple[Contact, ...], W: Floats, solved: Floats) -> Floats:
    """Return the combination of the columns ``M^-1 W^T`` that is at the walls, shape (dof,).

    Of coordinates that are nearly the same a few digits would be lost: what is left is computed
    exactly, until nothing changes.
    """
    base, among = np.zeros(W.shape[1]), W @ solved
    for _ in range(_REFINED):
        left = [_left(system, contact, base) for contact in contacts]
        moved = base + solved @ np.linalg.solve(among, left)
        if (moved == base).all():
            break
        base = moved
    return base


def _left(system: System, contact: Contact, x: Floats) -> float:
    """Return how far the coordinate of a contact is from its wall, rounded once."""
    index, side = contact
    constraint = system.constraints[index]
    y = sum(
        (Fraction(w) * Fraction(float(x[dof])) for dof, w in constraint.coordinate), Fraction(0)
    )
    wall = constraint.upper if side > 0 else constraint.lower
    assert wall is not None
    return float(Fraction(side * wall) - y)


def answers(mobility: Floats, free: tuple[int, ...], contacts: tuple[Contact, ...]) -> Floats:
    """Return the impulses by which contacts keep closed, shape (contact, free constraint)."""
    if not free:
        return np.zeros((len(contacts), len(free)))
    held = [index for index, _ in contacts]
    sides = np.array([side for _, side in contacts], dtype=np.float64)
    among = mobility[np.ix_(held, held)] * np.outer(sides, sides)
    coupling = mobility[np.ix_(held, free)]
    sizes = np.sqrt(np.outer(mobility.diagonal()[held], mobility.diagonal()[[*free]]))
    coupling = np.where(np.abs(coupling) <= _UNCOUPLED * sizes, 0.0, coupling)
    return np.asarray(-np.linalg.solve(among, sides[:, np.newaxis] * coupling))


def opening(forces: Floats, kicks: Floats, answers: Floats) -> Integers:
    """Return whether impulses at lower and at upper walls open a contact, shape (2, free).

    By the coupling of masses a contact may have to pull in the impact; damping that couples
    velocities to its force may take from that what it has.
    """
    terms = forces[:, np.newaxis] * kicks  # (contact, free, 2, pair)
    pushes, sizes = terms.sum(axis=(2, 3)), np.abs(terms).sum(axis=(2, 3))
    pushes[np.abs(pushes) <= _UNCOUPLED * sizes] = 0.0
    # The state changes by minus the kick at an upper wall.
    less = np.array([(pushes < 0.0).any(axis=0), (pushes > 0.0).any(axis=0)])
    pulls = np.array([(answers > 0.0).any(axis=0), (answers < 0.0).any(axis=0)])
    return np.where(
        pulls, rigid_state.MAYBE, np.where(less, rigid_state.BY_FORCE, rigid_state.NEVER)
    )


def force_forms(
    system: System, forces: Forces, W: Floats, basis: Basis, contacts: tuple[Contact, ...]
) -> tuple[Floats, Floats, Booleans]:
    """Return the forms of the contact forces, their levels, and where all are rounding.

    W has the coordinates of the contacts as rows, shape (contact, dof).
    """
    modes = basis.modes
    sides = np.array([side for _, side in contacts], dtype=np.float64)
    solve = condensation.solve_mass(system)
    solved = solve(np.ascontiguousarray(W.T))
    # The wall's force along W is -(W M^-1 W^T)^-1 W M^-1 (f - K x - C v); a coordinate is
    # pressed with side times its negative.
    onto = sides[:, np.newaxis] * np.linalg.solve(W @ solved, solved.T)
    by_x = -(system.K @ np.ascontiguousarray(onto.T)).T
    level = onto @ forces.constant + by_x @ modes.base
    rows = by_x @ modes.shapes
    sizes, stiffness = np.abs(onto), _magnitudes(system.K)
    by_x_sizes = (stiffness @ np.ascontiguousarray(sizes.T)).T
    idle = np.abs(level) <= _UNCOUPLED * (
        sizes @ np.abs(forces.constant) + by_x_sizes @ np.abs(modes.base)
    )
    # A shape has roundings of others' size: where it is zero, they are all of it.
    largest = np.abs(modes.shapes).max(axis=1, initial=0.0, keepdims=True)
    idle &= (np.abs(rows) <= _UNCOUPLED * (by_x_sizes @ largest)).all(axis=1)
    forms = basis.displacement(rows)
    level = level + basis.level(rows)
    if system.C is not None:
        by_v = -(system.C @ np.ascontiguousarray(onto.T)).T @ modes.shapes
        forms = forms + math.ldexp(1.0, basis.exponent) * basis.velocity(by_v)
        by_v_sizes = (_magnitudes(system.C) @ np.ascontiguousarray(sizes.T)).T
        idle &= (np.abs(by_v) <= _UNCOUPLED * (by_v_sizes @ largest)).all(axis=1)
    parts = forces.harmonic.cosine, forces.harmonic.sine, forces.ramps.directions
    for part in parts:
        idle &= (np.abs(onto @ part) <= _UNCOUPLED * (sizes @ np.abs(part))).all(axis=1)
    forms = forms + basis.load(*(onto @ part for part in parts))
    forms[idle], level[idle] = 0.0, 0.0  # roundings would open them, or not let them open
    return forms, level, idle


def _magnitudes(A: SymmetricMatrix) -> SymmetricMatrix:
    """Return the matrix of the magnitudes of all entries."""
    return SymmetricMatrix(np.abs(A.data), A.form, A.pattern)
