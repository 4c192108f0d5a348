"""A structure with given constraints in contact, as a sum of exponentials in extended precision.

Every modal coordinate of ``q'' + 2 delta q' + lambda q = f + Re(F e^(i omega t))`` is

    q(s) = Re(a_1 e^(sigma_1 s) + a_2 e^(sigma_2 s)) + c_0 + c_1 s + c_2 s^2 + steady response,

``sigma = -delta +- (delta^2 - lambda)^(1/2)``; so is every linear form on coordinates and their
rates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import flint
import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.errors import PlanError
from vibroimpact_solvers.model import System
from vibroimpact_solvers.time_history.extended.precision import (
    Complex,
    Real,
    Row,
    Rows,
    dot,
    doubles,
    exact,
    matrix,
    middle,
    modes,
    real,
    rows_of,
    times,
)
from vibroimpact_solvers.time_history.loads import Harmonic

Contact = tuple[int, int]
COUPLED: Final = "damping couples the modes, which is followed in double precision only"
CRITICAL: Final = "a mode is damped critically, which is followed in double precision only"
RESONANT: Final = "a harmonic load is in resonance with a mode that has no damping"


@dataclass(frozen=True, eq=False)
class Body:
    """A structure to all digits.

    Parameters
    ----------
    system : System
    load : tuple of Harmonic
    digits : int
    """

    system: System
    load: tuple[Harmonic, ...]
    digits: int
    configurations: dict[frozenset[Contact], Configuration] = field(default_factory=dict)
    M: Any = field(init=False)
    K: Any = field(init=False)
    C: Any = field(init=False)
    W: Rows = field(init=False)
    force: Row = field(init=False)
    loads: dict[float, list[Complex]] = field(init=False)

    def __post_init__(self) -> None:
        system, n = self.system, self.system.n
        put = object.__setattr__
        put(self, "M", exact(system.M.to_dense()))
        put(self, "K", exact(system.K.to_dense()))
        put(self, "C", None if system.C is None else exact(system.C.to_dense()))
        W = system.directions(range(len(system.constraints)))
        put(self, "W", [[real(value) for value in row] for row in W.tolist()])
        force: Row = [flint.arb(0)] * n if system.force is None else list(map(real, system.force))
        rates = sorted({term.frequency for term in self.load if term.frequency > 0.0})
        loads = {rate: [flint.acb(0)] * n for rate in rates}
        for term in self.load:
            # cos(omega t + phase) is the real part of e^(i phase) e^(i omega t).
            turn = flint.acb(0, real(term.phase)).exp() * real(term.amplitude)
            if term.frequency > 0.0:
                loads[term.frequency][term.dof] += turn
            else:
                force[term.dof] += turn.real
        put(self, "force", force)
        put(self, "loads", loads)

    def wall(self, contact: Contact) -> Real:
        """Return where the coordinate of a contact is."""
        index, side = contact
        constraint = self.system.constraints[index]
        wall = constraint.upper if side > 0 else constraint.lower
        assert wall is not None
        return side * real(wall)

    def configuration(self, contacts: frozenset[Contact] = frozenset()) -> Configuration:
        """Return the configuration with some constraints in contact."""
        if contacts not in self.configurations:
            self.configurations[contacts] = Configuration(self, tuple(sorted(contacts)))
        return self.configurations[contacts]


@dataclass(frozen=True, eq=False, slots=True)
class Form:
    """A linear form: level + row_q . q + row_v . q' + Re(sum of driven e^(i omega t)).

    Parameters
    ----------
    level : arb
    by_q, by_v : list of arb, shape (mode,)
    driven : list of acb, shape (load,)
    """

    level: Real
    by_q: Row
    by_v: Row
    driven: list[Complex]


class Configuration:
    """Modes of a structure with the constrained DOFs held fixed at their walls.

    Parameters
    ----------
    body : Body
    contacts : tuple
        The constraints in contact and their sides.

    Raises
    ------
    PlanError
        Where the motion cannot be computed in extended precision.
    """

    def __init__(self, body: Body, contacts: tuple[Contact, ...]) -> None:
        self.body, self.contacts = body, contacts
        n = body.system.n
        rows_fixed = [body.W[index] for index, _ in contacts]
        # A basis of the motions that leave the fixed coordinates at rest, and a displacement at
        # which all of them are at their walls.
        Z = matrix(_null_space(rows_fixed, n))
        self.base: Row = [flint.arb(0)] * n
        M, K, C = body.M, body.K, body.C
        if contacts:
            solved = M.solve(matrix(rows_fixed).transpose())
            walls = matrix([[body.wall(contact)] for contact in contacts])
            base = solved * (matrix(rows_fixed) * solved).solve(walls)
            self.base = [row[0] for row in rows_of(base)]
        Zt = Z.transpose()
        self.eigenvalues, small = modes(Zt * M * Z, Zt * K * Z, body.digits)
        E = Z * matrix(small) if small else Z
        self.E: Rows = rows_of(E)  # (dof, mode)
        self.Et: Rows = rows_of(E.transpose())
        self.EtM: Rows = rows_of(E.transpose() * M) if small else []
        largest = max((abs(value) for value in self.eigenvalues), default=flint.arb(0))
        tiny = largest * n * flint.arb(10) ** (-body.digits)
        self.eigenvalues = [
            flint.arb(0) if abs(value) <= tiny else value for value in self.eigenvalues
        ]
        count = len(self.eigenvalues)
        self.delta: Row = [flint.arb(0)] * count
        if C is not None and small:
            self.delta = _modal_damping(rows_of(E.transpose() * C * E), body.digits)
        push = [f - k for f, k in zip(body.force, times(rows_of(K), self.base), strict=True)]
        self.push: Row = [_unless_rounding(dot(row, push), row, push, body) for row in self.Et]
        self.still: Row = [
            flint.arb(0) if value == 0 else middle(f / value)
            for f, value in zip(self.push, self.eigenvalues, strict=True)
        ]
        self._rates()
        self._respond()
        self.shapes = doubles(self.E)

    def _rates(self) -> None:
        """Compute the exponents of every mode."""
        self.sigma: list[tuple[Complex, Complex]] = []
        for value, delta in zip(self.eigenvalues, self.delta, strict=True):
            square = delta * delta - value
            if value == 0 and delta == 0:
                self.sigma.append((flint.acb(0), flint.acb(0)))
                continue
            if abs(square) <= (delta * delta + abs(value)) * flint.arb(10) ** (-self._half):
                raise PlanError(CRITICAL)
            root = flint.acb(square).sqrt()
            self.sigma.append((-delta + root, -delta - root))
        self.rates = np.array([[complex(s) for s in pair] for pair in self.sigma]).reshape(-1, 2)

    @property
    def _half(self) -> int:
        return self.body.digits // 2

    def _respond(self) -> None:
        """Compute the steady responses to the harmonic loads, shape (load, mode)."""
        self.response: list[list[Complex]] = []
        for rate, force in self.body.loads.items():
            omega = real(rate)
            responses = []
            for row, value, delta in zip(self.Et, self.eigenvalues, self.delta, strict=True):
                f = sum((e * a for e, a in zip(row, force, strict=True)), flint.acb(0))
                stiff = flint.acb(value - omega * omega, 2 * delta * omega)
                weak = abs(stiff) <= omega * omega * flint.arb(10) ** (-self._half)
                if weak and abs(f) > flint.arb(10) ** (-self._half):
                    raise PlanError(RESONANT)
                responses.append(flint.acb(0) if weak else f / stiff)
            self.response.append(responses)

    # -- states --

    def state_of(self, x: Row, v: Row) -> tuple[Row, Row]:
        """Return modal coordinates and rates of displacements and velocities."""
        away = [a - b for a, b in zip(x, self.base, strict=True)]
        return [middle(dot(row, away)) for row in self.EtM], [
            middle(dot(row, v)) for row in self.EtM
        ]

    def displacements(self, q: Row, rate: Row, dofs: Sequence[int]) -> tuple[Row, Row]:
        """Return displacements and velocities of some degrees of freedom."""
        x = [self.base[dof] + dot(self.E[dof], q) for dof in dofs]
        return x, [dot(self.E[dof], rate) for dof in dofs]

    def accelerations(self, q: Row, rate: Row, loads: list[Complex]) -> Row:
        """Return q''; loads are e^(i omega t)."""
        accelerations = []
        for j, (value, delta) in enumerate(zip(self.eigenvalues, self.delta, strict=True)):
            a = self.push[j] - value * q[j] - 2 * delta * rate[j]
            for (omega, force), turn in zip(self.body.loads.items(), loads, strict=True):
                if omega:
                    f = sum((e * c for e, c in zip(self.Et[j], force, strict=True)), flint.acb(0))
                    a += (f * turn).real
            accelerations.append(a)
        return accelerations

    # -- forms --

    def coordinate(self, index: int) -> Form:
        """Return the form of a constrained coordinate."""
        row = self.body.W[index]
        none = [flint.arb(0)] * len(self.eigenvalues)
        loads = [flint.acb(0)] * len(self.body.loads)
        return Form(dot(row, self.base), times(self.Et, row), none, loads)

    def tensile_forces(self) -> list[Form]:
        """Return the forms of the contact forces, with negative sign while they are compressive.

        The force that presses is ``side (W M^-1 W^T)^-1 W M^-1 (f - K x - C x')``.
        """
        body = self.body
        if not self.contacts:
            return []
        rows_fixed = matrix([body.W[index] for index, _ in self.contacts])
        solved = body.M.solve(rows_fixed.transpose())
        onto = (rows_fixed * solved).solve(solved.transpose())
        forms = []
        by_x, by_v = onto * body.K, None if body.C is None else onto * body.C
        for k, (_, side) in enumerate(self.contacts):
            row = [-side * value for value in rows_of(onto)[k]]
            stiff = [-side * value for value in rows_of(by_x)[k]]
            level = dot(row, body.force) - dot(stiff, self.base)
            q = [-value for value in times(self.Et, stiff)]
            v = [flint.arb(0)] * len(q)
            if by_v is not None:
                damped = [-side * value for value in rows_of(by_v)[k]]
                v = [-value for value in times(self.Et, damped)]
            driven = [
                sum((r * a for r, a in zip(row, force, strict=True)), flint.acb(0))
                for force in body.loads.values()
            ]
            forms.append(Form(level, q, v, driven))
        return forms


def _null_space(rows: Rows, n: int) -> Rows:
    """Return columns that span the common null space of the rows, as a matrix (dof, column)."""
    reduced, pivots = [list(row) for row in rows], list[int]()
    for k, row in enumerate(reduced):
        pivot = max(range(n), key=lambda j: abs(float(middle(row[j]))))
        pivots.append(pivot)
        reduced[k] = row = [value / row[pivot] for value in row]
        for other in range(len(reduced)):
            if other != k:
                factor = reduced[other][pivot]
                reduced[other] = [a - factor * b for a, b in zip(reduced[other], row, strict=True)]
    free = [j for j in range(n) if j not in pivots]
    columns: Rows = [[flint.arb(0)] * len(free) for _ in range(n)]
    for column, j in enumerate(free):
        columns[j][column] = flint.arb(1)
        for row, pivot in zip(reduced, pivots, strict=True):
            columns[pivot][column] = -row[j]
    return columns


def _modal_damping(damping: Rows, digits: int) -> Row:
    """Return half of the diagonal of the modal damping; nothing else may be in it."""
    largest = max(abs(value) for row in damping for value in row)
    # Proportional damping has entries that were rounded to doubles.
    limit = max(largest * flint.arb(10) ** (-digits // 2), largest * real(1e-14))
    for i, row in enumerate(damping):
        for j, value in enumerate(row):
            if i != j and abs(value) > limit:
                raise PlanError(COUPLED)
    return [row[i] / 2 for i, row in enumerate(damping)]


def _unless_rounding(value: Real, row: Row, push: Row, body: Body) -> Real:
    """Return a modal load, or nothing where it is only rounding, which must not drive a mode."""
    size = sum((abs(a * b) for a, b in zip(row, push, strict=True)), flint.arb(0))
    return flint.arb(0) if abs(value) <= size * flint.arb(10) ** (-body.digits) else middle(value)


def as_doubles(values: Row) -> Floats:
    """Return the doubles nearest to numbers."""
    return np.array([float(middle(value)) for value in values], dtype=np.float64)
