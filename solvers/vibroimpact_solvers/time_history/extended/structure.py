"""A structure with given constraints in contact, as linear equations of motion in balls.

Displacements are ``x = base + E q``, where E spans the motions that leave the coordinates in
contact at their walls, and

    q'' = p(t) - K q - C q' .

The first of the q are the coordinates that may still meet a wall, so that an impact changes few of
them; the others belong to natural modes with all coordinates fixed, in double precision. These
only serve to keep sums short: K and C are computed from E as it is, so that they are right to all
digits whether or not modes are, for any damping.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import flint
import numpy as np
import scipy

from vibroimpact_solvers import condensation
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import System
from vibroimpact_solvers.time_history.extended.precision import (
    Matrix,
    Real,
    above,
    column,
    doubles,
    exact,
    largest_radius,
    matrix,
    norm,
    real,
)
from vibroimpact_solvers.time_history.loads import Harmonic

Contact = tuple[int, int]
"""A constraint and its side: 1 for the upper, -1 for the lower wall."""
_INDEPENDENT: Final = 1e-6
REACH: Final = 4.0
"""Longest step, in units of the reciprocal norm of the equations."""


@dataclass(frozen=True, eq=False, slots=True)
class Load:
    """A load ``cosine cos(omega t) - sine sin(omega t)``, columns of the degrees of freedom."""

    omega: float
    cosine: Matrix
    sine: Matrix


@dataclass(frozen=True, eq=False)
class Body:
    """A structure to all digits, without the degrees of freedom that have no mass.

    Vectors and matrices are those of the condensed structure; `whole` returns all displacements.

    Parameters
    ----------
    system : System
    load : tuple of Harmonic
    t_end : float
        Gives the unit of time where nothing vibrates.
    """

    system: System
    load: tuple[Harmonic, ...]
    t_end: float
    configurations: dict[frozenset[Contact], Configuration] = field(default_factory=dict)
    condensed: condensation.InBalls = field(init=False)
    M: Matrix = field(init=False)
    K: Matrix = field(init=False)
    C: Matrix | None = field(init=False)
    rows: list[Matrix] = field(init=False)
    changes: list[Matrix] = field(init=False)
    force: Matrix = field(init=False)
    loads: tuple[Load, ...] = field(init=False)

    def __post_init__(self) -> None:
        system, condensed = self.system, condensation.in_balls(self.system)
        massive = condensed.massive
        n, places = massive.size, {dof: place for place, dof in enumerate(massive.tolist())}
        W = system.directions(range(len(system.constraints)))[:, massive]
        force = flint.arb_mat(n, 1)
        if system.force is not None:
            force = column(list(map(real, system.force[massive])))
        loads = []
        for term in self.load:
            # cos(omega t + phase) = cos phase cos omega t - sin phase sin omega t.
            where = flint.arb_mat(n, 1)
            if term.amplitude:
                where[places[term.dof], 0] = real(term.amplitude)
            sine, cosine = real(term.phase).sin_cos()
            if term.frequency > 0.0:
                loads.append(Load(term.frequency, where * cosine, where * sine))
            else:
                force += where * cosine
        C = None if system.C is None else system.C.to_dense()
        put: dict[str, Any] = {
            "condensed": condensed,
            "M": condensed.M,
            "K": condensed.K,
            "C": None if C is None else exact(C[np.ix_(massive, massive)]),
            "rows": [exact(row[np.newaxis]) for row in W],
            "force": force,
            "loads": tuple(loads),
        }
        put["changes"] = [put["M"].solve(row.transpose()) for row in put["rows"]]
        for name, value in put.items():
            object.__setattr__(self, name, value)

    @property
    def n(self) -> int:
        """Number of degrees of freedom with mass."""
        return int(self.condensed.massive.size)

    def restricted(self, x: Floats) -> Floats:
        """Return displacements of the degrees of freedom with mass."""
        return np.asarray(x[self.condensed.massive])

    def whole(self, x: Matrix) -> list[Real]:
        """Return displacements of all degrees of freedom, of a column of those with mass."""
        return self.condensed.whole(x)

    def row(self, contact: Contact) -> Matrix:
        """Return the row of a coordinate, towards its wall."""
        index, side = contact
        return self.rows[index] * side

    def change(self, contact: Contact) -> Matrix:
        """Return the change of velocities by a unit impulse towards a wall."""
        index, side = contact
        return self.changes[index] * side

    def wall(self, contact: Contact) -> Real:
        """Return the distance of a wall."""
        index, side = contact
        constraint = self.system.constraints[index]
        wall = constraint.upper if side > 0 else constraint.lower
        assert wall is not None
        return real(wall)

    def configuration(self, contacts: frozenset[Contact] = frozenset()) -> Configuration:
        """Return the configuration with some constraints in contact."""
        if contacts not in self.configurations:
            self.configurations[contacts] = Configuration(self, tuple(sorted(contacts)))
        return self.configurations[contacts]

    def force_series(self, now: Real, h: float, count: int) -> list[Matrix]:
        """Return Taylor coefficients of the forces at a time, in units of h, each (dof, 1)."""
        series = [self.force]
        if self.loads:
            series = [self.force, *(flint.arb_mat(self.n, 1) for _ in range(count - 1))]
        for load in self.loads:
            sine, cosine = (real(load.omega) * now).sin_cos()
            turn, factor = real(load.omega) * real(h), flint.arb(1)
            a = load.cosine * cosine - load.sine * sine
            b = -load.cosine * sine - load.sine * cosine  # the derivative over omega
            for k in range(count):
                series[k] += (a if k % 2 == 0 else b) * (factor if k % 4 < 2 else -factor)
                factor *= turn / (k + 1)
        return series


@dataclass(frozen=True, eq=False, slots=True)
class Watch:
    """A quantity that must stay below a wall: ``by_q q + by_v q' + drive f(t) <= wall``.

    Parameters
    ----------
    contact : tuple
        The constraint and its side.
    force : bool
        Whether it is the tensile force of a contact, and not a coordinate.
    by_q, by_v : matrix of one row
        by_v is None for coordinates.
    drive : matrix of one row, shape (1, dof)
        None for coordinates.
    wall : arb
    """

    contact: Contact
    force: bool
    by_q: Matrix
    by_v: Matrix | None
    drive: Matrix | None
    wall: Real


class Configuration:
    """The equations of motion with given contacts.

    Parameters
    ----------
    body : Body
    contacts : tuple
        The constraints in contact and their sides.

    Attributes
    ----------
    E, base : matrix
        ``x = base + E q``.
    onto : matrix
        ``q = onto M (x - base)`` with ``onto = (E^T M E)^-1 E^T``; also of forces.
    weights : array, shape (mode,)
        Size of a state: the root of the sum of ``(weights q)^2 + q'^2``.
    rate : float
        Bound of the norm of the equations of motion in that size, and of loads' frequencies.
    step : float
        Length of a step: a power of 2, `REACH` over the rate at most.
    """

    def __init__(self, body: Body, contacts: tuple[Contact, ...]) -> None:
        self.body, self.contacts = body, contacts
        self._transforms: dict[Configuration, Matrix] = {}
        rows = [body.row(contact) for contact in (*contacts, *_independent(body, contacts))]
        every = matrix([row.entries() for row in rows]) if rows else flint.arb_mat(0, body.n)
        solved = body.M.solve(every.transpose()) if rows else flint.arb_mat(body.n, 0)
        # Columns: displacements per coordinate, the other coordinates fixed.
        unit = solved * (every * solved).inv() if rows else solved
        columns = [column(part) for part in unit.transpose().tolist()]
        self.base = flint.arb_mat(body.n, 1)
        if contacts:
            fixed = matrix([row.entries() for row in rows[: len(contacts)]]).transpose()
            pressing = body.M.solve(fixed)
            self.reaction = (fixed.transpose() * pressing).inv() * pressing.transpose()
            self.held = pressing * (fixed.transpose() * pressing).inv()
            self.base = self.held * column([body.wall(c) for c in contacts])
        roots = self._span(columns[len(contacts) :], [row.entries() for row in rows])
        Et = self.E.transpose()
        inertia = Et * body.M * self.E
        self.onto = inertia.inv() * Et if self.moves else Et
        self.T = self.onto * body.M
        self.K = self.onto * body.K * self.E if self.moves else flint.arb_mat([[1]])
        self.C = None if body.C is None else self.onto * body.C * self.E
        self.push = -(self.onto * body.K * self.base)
        self._measure(roots)
        self.watches = self._coordinates() + self._tensile_forces()

    def _span(self, coordinates: list[Matrix], rows: list[list[Real]]) -> Floats:
        """Set E: the free coordinates, and modes with all of them fixed; return frequencies."""
        n = self.body.n
        M, K = doubles(self.body.M), doubles(self.body.K)
        columns, roots = [], []
        for part in coordinates:
            y = doubles(part)[:, 0]
            mass = float(y @ M @ y)
            columns.append((part * real(1.0 / math.sqrt(mass))).entries())
            roots.append(math.sqrt(abs(float(y @ K @ y)) / mass))
        null = _null_space(rows, n)
        if null is not None:
            Z = doubles(null)
            eigenvalues, V = scipy.linalg.eigh(Z.T @ K @ Z, Z.T @ M @ Z)
            columns += (null * exact(V)).transpose().tolist()
            roots += np.sqrt(np.abs(eigenvalues)).tolist()
        self.moves = bool(columns)
        if not columns:  # one mode without a shape, at rest
            columns, roots = [[flint.arb(0)] * n], [1.0]
        self.E = matrix(columns).transpose()
        return np.array(roots)

    def _measure(self, roots: Floats) -> None:
        """Set the sizes of states, the rate and the step, and the equations in doubles."""
        m, fastest = roots.size, float(roots.max())
        self.weights = np.maximum(roots, max(1e-6 * fastest, 1.0 / self.body.t_end))
        A = np.zeros((2 * m, 2 * m))
        A[:m, m:] = np.diag(self.weights)
        K, C = doubles(self.K), None if self.C is None else doubles(self.C)
        A[m:, :m] = -K / self.weights
        uncertain = largest_radius(self.K) * m / float(self.weights.min())
        damping = 0.0
        if C is not None:
            A[m:, m:] = -C
            damping = norm(C)
            uncertain += largest_radius(self.C) * m
        stiff = max(float(self.weights.max()), norm(A[m:, :m]))
        self.matrix = A
        omegas = [load.omega for load in self.body.loads]
        self.rate = max([(stiff + damping + uncertain) * (1.0 + 1e-9), *omegas])
        self.step = 2.0 ** math.floor(math.log2(REACH / self.rate))
        shares = [self.onto * part for load in self.body.loads for part in (load.cosine, load.sine)]
        self.loads_size = sum(above(v) for share in shares for v in share.entries())
        h = real(self.step)
        self.stiff_step, self.onto_step = -self.K * (h * h), self.onto * (h * h)
        self.push_step = self.push * (h * h)
        self.damp_step = None if self.C is None else -self.C * h

    def _coordinates(self) -> list[Watch]:
        """Return the coordinates that are free, towards each of their walls."""
        body, watches = self.body, []
        fixed = {index for index, _ in self.contacts}
        for index, constraint in enumerate(body.system.constraints):
            for side, wall in ((1, constraint.upper), (-1, constraint.lower)):
                if wall is not None and index not in fixed:
                    row = body.row((index, side))
                    left = real(wall) - (row * self.base)[0, 0]
                    watches.append(Watch((index, side), False, row * self.E, None, None, left))
        return watches

    def _tensile_forces(self) -> list[Watch]:
        """Return the contact forces, negative while they are compressive.

        The force that presses is ``(W M^-1 W^T)^-1 W M^-1 (f - K x - C x')``, W towards the walls.
        """
        body, watches = self.body, []
        for k, contact in enumerate(self.contacts):
            row = matrix([[-value for value in self.reaction.tolist()[k]]])
            by_x = -(row * body.K)
            by_v = None if body.C is None else -(row * body.C * self.E)
            level = (by_x * self.base)[0, 0]
            watches.append(Watch(contact, True, by_x * self.E, by_v, row, -level))
        return watches

    def transform(self, before: Configuration) -> Matrix:
        """Return q and q' of another configuration as those of this one."""
        if before not in self._transforms:
            self._transforms[before] = self.T * before.E
        return self._transforms[before]

    def carried(self, before: Configuration, q: Matrix, v: Matrix) -> tuple[Matrix, Matrix]:
        """Return q and q' of those of another configuration."""
        if before is self:
            return q, v
        turn = self.transform(before)
        return turn * q + self.T * (before.base - self.base), turn * v

    def states(self, x: Matrix, v: Matrix) -> tuple[Matrix, Matrix]:
        """Return q and q' of displacements and velocities."""
        return self.T * (x - self.base), self.T * v

    def displacements(self, q: Matrix, v: Matrix) -> tuple[Matrix, Matrix]:
        """Return displacements and velocities."""
        return self.base + self.E * q, self.E * v

    def accelerations(self, q: Matrix, v: Matrix, force: Matrix) -> Matrix:
        """Return q'' under some forces, shape (dof, 1)."""
        a = self.push + self.onto * force - self.K * q
        return a if self.C is None else a - self.C * v


def _independent(body: Body, contacts: tuple[Contact, ...]) -> list[Contact]:
    """Return free coordinates that are independent of each other and of those in contact."""
    G = np.array([[float((a * b)[0, 0].mid()) for b in body.changes] for a in body.rows])
    taken, free = [index for index, _ in contacts], list[Contact]()
    for index in range(len(G)):
        if index in taken:
            continue
        left = G[index, index]
        if taken:
            left -= G[index, taken] @ np.linalg.solve(G[np.ix_(taken, taken)], G[taken, index])
        if left > _INDEPENDENT * G[index, index]:
            taken.append(index)
            free.append((index, 1))
    return free


def _null_space(rows: Sequence[Sequence[Any]], n: int) -> Matrix | None:
    """Return columns that span the common null space of the rows; None: it is empty."""
    reduced, pivots = [list(row) for row in rows], list[int]()
    for k, row in enumerate(reduced):
        pivot = max(range(n), key=lambda j: float(abs(row[j].mid())))
        pivots.append(pivot)
        reduced[k] = row = [value / row[pivot] for value in row]
        for other in range(len(reduced)):
            if other != k:
                factor = reduced[other][pivot]
                reduced[other] = [a - factor * b for a, b in zip(reduced[other], row, strict=True)]
    free = [j for j in range(n) if j not in pivots]
    if not free:
        return None
    columns = flint.arb_mat(n, len(free))
    for k, j in enumerate(free):
        columns[j, k] = flint.arb(1)
        for row, pivot in zip(reduced, pivots, strict=True):
            columns[pivot, k] = -row[j]
    return columns
