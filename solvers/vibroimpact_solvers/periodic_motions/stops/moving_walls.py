"""Walls that move with the drive, as loads on what moves with them.

With displacements r(t) that follow the walls at each stop, ``W r = wall``, deviations from them,
``u = x - r``, see walls at rest:

    M u'' + C u' + K u = f - (M r'' + C r' + K r) .

Forces, contacts and multipliers of x are those of u; displacements and energies are not.
"""

from __future__ import annotations

import cmath
from dataclasses import replace
from typing import Any, Final

import numpy as np

from vibroimpact_solvers import walls as moving
from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.flexibility import in_series
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.model import System
from vibroimpact_solvers.periodic_motions.frame import Frame
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.problem import Force, Problem, harmonic_forces

_WIDE: Final = np.clongdouble  # the terms cancel near natural frequencies
_DEPENDENT: Final = 1e-8
"""Part of the walls' motion that may be missed where coordinates depend on one another."""


def at_rest(problem: Problem) -> Problem:
    """Return the problem of u at one frequency of the drive: with walls at rest, and a frame.

    Raises
    ------
    ModelError
        Where coordinates of stops depend on one another and their walls do not.
    """
    system, (Omega,) = problem.system, problem.Omega.tolist()
    load = tuple(each.at(Omega) for each in problem.load)
    harmonics = np.array(sorted(problem.harmonics), dtype=np.float64)
    walls = np.zeros((harmonics.size, len(system.constraints)), dtype=np.complex128)
    for a, constraint in enumerate(system.constraints):
        for term in moving.turns(constraint.wall):
            row = int(np.searchsorted(harmonics, term.harmonic))
            walls[row, a] += cmath.rect(term.amplitude, term.phase)
    shift = np.asarray(walls @ _carrier(system, walls).T)
    _, _, forces = harmonic_forces(load, system.n, harmonics)
    pushes = [
        Force((dof,), (1.0,), abs(force), int(harmonic), cmath.phase(force))
        for harmonic, r in zip(harmonics.tolist(), shift, strict=True)
        for dof, force in enumerate((-_resistance(system, r, harmonic * Omega)).tolist())
        if force != 0.0
    ]
    still = system.limited([replace(each, wall=()) for each in system.constraints])
    if system.flexibility is not None:
        still = in_series(still, system.flexibility)
    frame = Frame(harmonics, shift, walls, forces)
    return replace(problem, system=still, load=(*load, *pushes), frame=frame)


def _carrier(system: System, walls: Complexes) -> Floats:
    """Return displacements by unit displacements of the walls, shape (dof, constraint)."""
    W = system.directions(range(len(system.constraints)))
    carrier = np.linalg.pinv(W, rcond=_DEPENDENT)
    missed = np.abs(walls @ (W @ carrier).T - walls).max(axis=0, initial=0.0)
    if (missed > _DEPENDENT * np.abs(walls).max(initial=0.0)).any():
        message = "coordinates of stops depend on one another, and their walls do not move alike"
        pointer = ("system", "constraints", int(missed.argmax()), "wall")
        raise ModelError(pointer, message, code="not_possible")
    carrier[np.abs(carrier) <= 4.0 * EPS * np.abs(carrier).max(initial=0.0)] = 0.0
    return np.asarray(carrier)


def _resistance(system: System, r: Complexes, turning: float) -> Complexes:
    """Return amplitudes of ``M r'' + C r' + K r``, (dof,)."""
    moved = np.flatnonzero(r)
    wide = r[moved].astype(_WIDE)

    def product(A: SymmetricMatrix) -> Any:
        return A.block(np.arange(A.n), moved).toarray() @ wide

    forces = product(system.K) - turning * (turning * product(system.M))
    if system.C is not None:
        forces = forces + 1j * turning * product(system.C)
    return np.asarray(forces, dtype=np.complex128)
