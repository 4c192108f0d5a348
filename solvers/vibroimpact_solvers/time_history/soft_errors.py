"""Absolute errors of motions with soft limiters, from the distance of two runs.

Of a number ``form . z`` the error is the largest distance of both runs at the output times that
are known, or half of what the largest distances of all pairs make of it,

    max_t |form . (z - z')| ,    sum over the pairs of |form| max_t |z - z'| / 2 ,

whichever is more: single numbers of two runs cross each other now and then, at a single output
time perhaps just there, all pairs do not. A pair turns, so that its distance is that of both of
its numbers together; and where a pair of one run crosses the other's, an eighth of the largest
distance of all pairs counts, or what the series of the steps leave out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.time_history.basis import Basis
from vibroimpact_solvers.time_history.problem import Problem
from vibroimpact_solvers.time_history.soft_laws import SoftLaws
from vibroimpact_solvers.time_history.stated_errors import LEAST
from vibroimpact_solvers.time_history.structure import Structure

_CROSSING: Final = 0.5
"""Of what distances of pairs make of a number, in its error at least."""
_AT_LEAST: Final = 0.125
"""Of the largest distance of all pairs, in that of each."""
_RATES: Final = 1.5
"""Of the largest distance of velocities: they change fast, and output times are few."""
_ROUNDED: Final = 64.0 * 2.0**-52  # part of a force, whose exponent is 64 at most
_TIMES: Final = 256  # output times at a time


@dataclass(frozen=True, eq=False, slots=True)
class Distance:
    """How far two runs are from each other.

    Parameters
    ----------
    known : array of bool, shape (time,)
        Output times at which the motion is known to the tolerance.
    states : array, shape (known time, 2, pair)
        Differences of the states at these times, and at the end where it is known.
    whole : array, shape (known time, 2, pair)
        Their sizes with what loads carry of them, in the measure of the size of states.
    cut : float
        What the series leave out, of each pair.
    sampled : float
        What a difference is multiplied by, as one sample of roundings.
    rounding : float
        Roundings that both runs share, of each pair.
    """

    known: Booleans
    states: Floats
    whole: Floats
    cut: float
    sampled: float
    rounding: float

    def pairs(self) -> Floats:
        """Return the largest distances of pairs, of both numbers together, shape (pair,)."""
        far = np.hypot(self.whole[:, 0], self.whole[:, 1]).max(axis=0, initial=0.0)
        return np.asarray(np.maximum(far, max(_AT_LEAST * float(far.max(initial=0.0)), self.cut)))

    def of(self, forms: Floats, basis: Basis) -> Floats:
        """Return the errors of linear forms (row, 2, pair), shape (row,)."""
        sizes = np.hypot(forms[:, 0] * basis.grain, forms[:, 1]) * basis.own[0]
        flat, largest = forms.reshape(forms.shape[0], -1), np.zeros(forms.shape[0])
        for first in range(0, self.states.shape[0], _TIMES):
            some = self.states[first : first + _TIMES]
            off = np.abs(some.reshape(some.shape[0], -1) @ flat.T)
            largest = np.maximum(largest, off.max(axis=0, initial=0.0))
        largest = np.maximum(largest, _CROSSING * (sizes @ self.pairs()))
        return np.asarray(self.sampled * largest + self.rounding * sizes.sum(axis=1))


def rows_of(structure: Structure, distance: Distance, rows: Floats) -> tuple[Floats, Floats]:
    """Return the errors of ``rows . q`` and of its rate, q being modal coordinates, each (row,)."""
    basis = structure.configuration().basis
    place, rate = (distance.of(form(rows), basis) for form in (basis.displacement, basis.velocity))
    return np.maximum(place, LEAST), np.maximum(_RATES * structure.scale * rate, LEAST)


def stated(
    problem: Problem,
    structure: Structure,
    laws: SoftLaws,
    distance: Distance,
    x: Floats,
    v: Floats,
) -> dict[str, Any]:
    """Return the errors of a history, which is that of all dofs where energy or forces are outputs.

    Parameters
    ----------
    problem : Problem
    structure : Structure
    laws : SoftLaws
    distance : Distance
    x, v : array, shape (time, dof)
    """
    outputs, known = problem.outputs, distance.known
    values = dict[str, Any]()

    def off(rows: Floats) -> tuple[Floats, Floats]:
        return rows_of(structure, distance, rows)

    each = np.where(known, 1.0, np.inf)
    if outputs & {"x", "v"}:
        for name, error in zip("xv", off(structure.shapes[problem.output_dofs]), strict=True):
            if name in outputs:
                values[f"error_{name}"] = np.outer(each, error)
    if "energy" in outputs:
        values["error_energy"] = each
        dx, dv = off(structure.shapes)
        dy = off(structure.W @ structure.shapes)[0]
        each[known] = _of_energy(problem, structure, laws, (x[known], v[known]), (dx, dv, dy))
    if "force" in outputs:
        error = np.full((x.shape[0], len(structure.W)), np.inf)
        error[known] = _of_forces(
            laws, x[known] @ structure.W.T, off(structure.W @ structure.shapes)[0]
        )
        values["error_force"] = error
    return values


def _of_forces(laws: SoftLaws, y: Floats, dy: Floats) -> Floats:
    """Return the errors of forces by those of coordinates, shape (time, constraint)."""
    force = laws.forces(y)
    changes = (np.abs(laws.forces(y + off) - force) for off in (-dy, dy))
    return np.asarray(np.maximum(*changes) + _ROUNDED * np.abs(force) + LEAST)


def _of_energy(
    problem: Problem,
    structure: Structure,
    laws: SoftLaws,
    history: tuple[Floats, Floats],
    errors: tuple[Floats, Floats, Floats],
) -> Floats:
    """Return the errors of energies by those of displacements, velocities and coordinates."""
    (x, v), (dx, dv, dy), system = history, errors, problem.system
    M, K = (SymmetricMatrix(np.abs(A.data), A.form, A.pattern) for A in (system.M, system.K))
    push = np.abs((system.K @ x.T).T - structure.force) + 0.5 * (K @ dx)
    moves = np.abs((system.M @ v.T).T) + 0.5 * (M @ dv)
    y = x @ structure.W.T
    # As far as it may be off, a coordinate is pushed by no more than there.
    pushed = np.maximum(*(np.abs(laws.forces(y + off)) for off in (-dy, dy)))
    return np.asarray(push @ dx + moves @ dv + pushed @ dy)
