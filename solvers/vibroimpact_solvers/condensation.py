"""Static condensation of degrees of freedom without mass.

With s for those without mass and m for the others, the rows s of the equations of motion are a
static relation, in which no load, no limiter and no damping takes part:

    x_s = S x_m ,    S = -K_ss^(-1) K_sm ,
    M_mm x_m'' + C_mm x_m' + (K_mm + K_ms S) x_m = f_m .

The condensed structure has all natural modes of the whole one. Displacements ``T x_m`` with
``T = [1; S]`` satisfy ``T^T K T = K_mm + K_ms S``, so that products with the whole K stay right
for all vectors that satisfy the relation; ``T M_mm^(-1) T^T`` stands for the inverse of M.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers import condensation
>>> from vibroimpact_solvers.model import SymmetricMatrix, System
>>> K = SymmetricMatrix.dense([[1.0, -1.0, 0.0], [-1.0, 3.0, -2.0], [0.0, -2.0, 2.0]])
>>> system = System(SymmetricMatrix.diagonal([1.0, 0.0, 1.0]), K, ())
>>> condensed = condensation.of(system)
>>> condensed.static.toarray().round(12)
array([[0.33333333, 0.66666667]])
>>> condensed.K.to_dense().round(12)
array([[ 0.66666667, -0.66666667],
       [-0.66666667,  0.66666667]])
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import flint
import numpy as np
import scipy.sparse

from vibroimpact_solvers import precision
from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.body import once_per_body
from vibroimpact_solvers.errors import ConvergenceError
from vibroimpact_solvers.factors import Solve
from vibroimpact_solvers.matrices import SymmetricMatrix
from vibroimpact_solvers.model import System

Balls = Any
"""A matrix of balls, `flint.arb_mat`."""

_BITS: Final = (256, 512, 1024)
_COLUMNS: Final = 256  # right-hand sides solved at a time
_PRECISE: Final = 2.0**-100  # error of an entry over the largest of its terms


@dataclass(frozen=True, eq=False)
class Condensation:
    """The condensed structure of a system, in double precision.

    It does not hold the body, beside which it is kept for as long as that is used.
    """

    massless: Integers  # degrees of freedom without mass, ascending
    massive: Integers  # the others, ascending
    static: scipy.sparse.csr_array  # S, (massless, massive)
    M: SymmetricMatrix
    K: SymmetricMatrix
    sizes: SymmetricMatrix  # of the terms of K, which its roundings are relative to
    solve_static: Solve  # with K_ss

    @cached_property
    def solve_M(self) -> Solve:
        """The function that solves with `M`."""
        return self.M.factorize(definite=True)

    def whole(self, x: Floats) -> Floats:
        """Return displacements of all degrees of freedom, (dof, …), of those with mass."""
        all_x = np.zeros((self.massive.size + self.massless.size, *x.shape[1:]))
        all_x[self.massive] = x
        all_x[self.massless] = self.static @ x
        return all_x

    def solve_mass(self, b: Floats) -> Floats:
        """Return ``T M_mm^(-1) T^T b``."""
        carried = b[self.massive] + self.static.T @ b[self.massless]
        return self.whole(self.solve_M(np.ascontiguousarray(carried)))


def solve_mass(system: System) -> Solve:
    """Return the function that solves with M, where what has no mass follows the others."""
    return of(system).solve_mass if system.massless.size else system.solve_M


def massive(system: System) -> Integers:
    """Return the degrees of freedom with mass, ascending."""
    return np.delete(np.arange(system.n), system.massless)


def sentence(system: System) -> str:
    """Return the reason that plans state."""
    count = system.massless.size
    if count == 1:
        return "1 degree of freedom has no mass: it follows the others statically"
    return f"{count} degrees of freedom have no mass: they follow the others statically"


def flops(system: System) -> float:
    """Return the estimated operations of the condensation."""
    s, m = float(system.massless.size), float(system.n - system.massless.size)
    if system.K.pattern is not None:
        return 20.0 * math.pow(s, 1.5) + 200.0 * s * m
    return float(s**3 + 2.0 * s * s * m + 2.0 * s * m * m)


@once_per_body
def of(system: System) -> Condensation:
    """Return the condensed structure of a system, which has degrees of freedom without mass."""
    massless, others = system.massless, massive(system)
    K, coupling = system.K, system.K.block(system.massless, others)
    solve = K.part(massless).factorize(definite=True)
    # Unconnected columns follow nothing.
    coupled = np.unique(coupling.indices)
    columns = []
    for start in range(0, coupled.size, _COLUMNS):
        right = coupling[:, coupled[start : start + _COLUMNS]].toarray()
        x = -solve(right)
        x -= solve(right + K.part(massless) @ x)  # one step of refinement
        columns.append(scipy.sparse.csc_array(x))
    static = scipy.sparse.csr_array((massless.size, others.size))
    if columns:
        place = scipy.sparse.csr_array(
            (np.ones(coupled.size), (np.arange(coupled.size), coupled)),
            shape=(coupled.size, others.size),
        )
        static = scipy.sparse.csr_array(scipy.sparse.hstack(columns).tocsr() @ place)
    own = K.block(others, others)
    stiffness = scipy.sparse.csr_array(own + coupling.T @ static)
    terms = abs(coupling).T @ abs(static)
    return Condensation(
        massless, others, static, system.M.part(others),
        SymmetricMatrix.leanest(scipy.sparse.csr_array(0.5 * (stiffness + stiffness.T))),
        SymmetricMatrix.leanest(scipy.sparse.csr_array(abs(own) + terms + terms.T)), solve,
    )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class InBalls:
    """The condensed structure in ball arithmetic: balls that contain the exact entries."""

    massive: Integers
    M: Balls
    K: Balls
    static: Balls  # S

    def whole(self, x: Balls) -> list[Any]:
        """Return displacements of all degrees of freedom, of a column of those with mass."""
        size = self.massive.size + self.static.nrows()
        all_x = [flint.arb(0)] * size
        for place, dof in enumerate(self.massive.tolist()):
            all_x[dof] = x[place, 0]
        follow = iter((self.static * x).entries()) if self.static.nrows() else iter(())
        with_mass = set(self.massive.tolist())
        for dof in range(size):
            if dof not in with_mass:
                all_x[dof] = next(follow)
        return all_x


def in_balls(system: System) -> InBalls:
    """Return the condensed structure, or the whole one, to the present precision of FLINT.

    Raises
    ------
    ZeroDivisionError
        Where this precision does not suffice.
    """
    massless, others = system.massless, massive(system)
    M, K = system.M.to_dense(), system.K.to_dense()
    stiffness = _exact(K[np.ix_(others, others)])
    static = flint.arb_mat(massless.size, others.size)
    if massless.size:
        coupling = _exact(K[np.ix_(massless, others)])
        static = -(_exact(K[np.ix_(massless, massless)]).solve(coupling))
        stiffness = stiffness + coupling.transpose() * static
        # Exactly symmetric midpoints: half the sum of balls contains what both contain.
        stiffness = (stiffness + stiffness.transpose()) * flint.arb(0.5)
    return InBalls(others, _exact(M[np.ix_(others, others)]), stiffness, static)


@dataclass(frozen=True, eq=False, slots=True)
class Doubled:
    """The condensed stiffness and S as sums of two doubles, and bounds of what they leave out."""

    K: Floats  # (massive, massive)
    K_low: Floats
    K_error: Floats
    static: Floats  # (massless, massive)
    static_low: Floats
    static_error: Floats


def doubled(system: System) -> Doubled:
    """Return the condensed structure to twice the working precision, with proved errors.

    Raises
    ------
    ConvergenceError
        Where the part without mass is too close to one that is not held by springs.
    """
    for bits in _BITS:
        with precision.working(bits):
            try:
                balls = in_balls(system)
            except ZeroDivisionError:
                continue
            K, static = _two_doubles(balls.K), _two_doubles(balls.static)
        largest = float(np.abs(system.K.data).max(initial=0.0))
        if all(
            float(error.max(initial=0.0)) <= _PRECISE * max(float(np.abs(value).max()), size)
            for (value, _, error), size in ((K, largest), (static, 1.0))
        ):
            # What follows nothing to some 75 digits follows nothing: no error is relative to it.
            still = np.abs(static[0]).max(axis=1) <= static[2].max(axis=1)
            for part in static:
                part[still] = 0.0
            return Doubled(*K, *static)
    message = "the degrees of freedom without mass are hardly held by springs"
    raise ConvergenceError(message)


def _two_doubles(balls: Balls) -> tuple[Floats, Floats, Floats]:
    """Return the entries of a matrix as sums of two doubles, and bounds of their errors."""
    high, low, error = np.zeros((3, balls.nrows(), balls.ncols()))
    for i, row in enumerate(balls.tolist()):
        for j, value in enumerate(row):
            high[i, j] = first = float(value.mid())
            rest = value - first
            low[i, j] = second = float(rest.mid())
            error[i, j] = float(abs(rest - second).upper()) * (1.0 + EPS)
    return high, low, error


def _exact(rows: Floats) -> Balls:
    if not rows.size:
        return flint.arb_mat(*rows.shape)
    return flint.arb_mat(np.asarray(rows, dtype=np.float64).tolist())
