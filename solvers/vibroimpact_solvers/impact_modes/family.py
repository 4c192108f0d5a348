"""The impulses of a family of impact modes and their equations.

With impulses p+ at tau = 1 and p- at tau = -1 the motion is

    x = x_s + sum_j e_j [a_j . (p+ + p-) s(mu_j, tau) + a_j . (p+ - p-) h(mu_j, tau)]/(2 omega^2)

where ``a_j = W e_j``. The terms with s are antisymmetric in tau, those with h symmetric. Every wall
with impacts gives one equation. Three kinds:

- *antisymmetric*: equal gaps on both sides and no static load. p+ = p- = p, and the symmetric
  component is zero (eq. 10.49-10.59, 10.87-10.89).
- *separate*: every active constraint has both walls. The sum and the difference of the
  impulses solve one system each; z = (p+ + p-)/2 and z = (p+ - p-)/2.
- *joint*: some active constraint has one wall only. One system for the impulses at the walls
  that exist (10.11-10.12 is its simplest case).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.impact_modes.problem import Problem


class Kind(StrEnum):
    """Kinds of families, see the module."""

    ANTISYMMETRIC = "antisymmetric"
    SEPARATE = "separate"
    JOINT = "joint"


@dataclass(frozen=True, eq=False, slots=True)
class Equations:
    """One linear system for impulses, as `kernels.families` takes it."""

    # Combinations of the constraints' rows that drive the antisymmetric and the symmetric
    # component of the motion; no rows where a component is zero, (unknown, constraint)
    antisymmetric: Floats
    symmetric: Floats
    walls: Floats  # right-hand side: distances of the walls, (unknown,)
    share: float  # share of each wall in an impulse: 1, or 1/2 in a joint family


@dataclass(frozen=True, slots=True)
class Family:
    """The kind of a family and the walls with impacts."""

    kind: Kind
    # Positions, among the active constraints, of those that hit the upper and the lower wall
    upper: tuple[int, ...]
    lower: tuple[int, ...]
    count: int  # number of active constraints

    @property
    def impacts(self) -> int:
        """Number of impacts in half a period, or in a period whose halves do not mirror."""
        lower = 0 if self.kind is Kind.ANTISYMMETRIC else len(self.lower)
        return len(self.upper) + lower

    def orders(self, problem: Problem) -> Integers:
        """Return the multiples of Omega that its motions have, shape (harmonic,)."""
        first, step = (1, 2) if self.kind is Kind.ANTISYMMETRIC else (0, 1)
        return np.arange(first, problem.highest_harmonic + 1, step)

    @classmethod
    def of(cls, problem: Problem) -> Family:
        """Return the family of a problem."""
        struck = problem.struck
        upper = tuple(i for i, c in enumerate(struck) if c.upper is not None)
        lower = tuple(i for i, c in enumerate(struck) if c.lower is not None)
        if len(upper) + len(lower) < 2 * len(struck):
            kind = Kind.JOINT
        elif all(c.symmetric for c in struck) and not problem.system.loaded:
            kind = Kind.ANTISYMMETRIC
        else:
            kind = Kind.SEPARATE
        return cls(kind, upper, lower, len(struck))

    def equations(self, problem: Problem) -> tuple[Equations, ...]:
        """Return the systems to be solved at each frequency."""
        upper = np.array([problem.struck[i].upper for i in self.upper], dtype=np.float64)
        lower = np.array([problem.struck[i].lower for i in self.lower], dtype=np.float64)
        one, none = np.eye(self.count), np.zeros((0, self.count))
        if self.kind is Kind.ANTISYMMETRIC:
            return (Equations(one, none, upper, 1.0),)
        if self.kind is Kind.SEPARATE:
            return (
                Equations(one, none, 0.5 * (upper + lower), 1.0),
                Equations(none, one, 0.5 * (upper - lower), 1.0),
            )
        antisymmetric = np.concatenate([one[list(self.upper)], one[list(self.lower)]])
        symmetric = np.concatenate([one[list(self.upper)], -one[list(self.lower)]])
        return (Equations(antisymmetric, symmetric, np.concatenate([upper, lower]), 0.5),)

    def sides(self, unknowns: tuple[Floats, ...]) -> tuple[Floats, Floats]:
        """Return p+ and p-, each (frequency, constraint), of the solutions (frequency, unknown).

        A wall without impacts has impulse 0.
        """
        if self.kind is Kind.ANTISYMMETRIC:
            return unknowns[0], unknowns[0]
        if self.kind is Kind.SEPARATE:
            total, difference = unknowns
            return total + difference, total - difference
        (z,) = unknowns
        plus, minus = np.zeros((2, z.shape[0], self.count))
        plus[:, list(self.upper)] = z[:, : len(self.upper)]
        minus[:, list(self.lower)] = z[:, len(self.upper) :]
        return plus, minus

    def errors(
        self, unknowns: tuple[Floats, ...], errors: tuple[Floats, ...]
    ) -> tuple[Floats, Floats]:
        """Return the absolute errors of p+ and p- from the solutions and their errors."""
        if self.kind is Kind.SEPARATE:
            rounding = EPS * (np.abs(unknowns[0]) + np.abs(unknowns[1]))
            return errors[0] + errors[1] + rounding, errors[0] + errors[1] + rounding
        return self.sides(errors)


@dataclass(frozen=True, eq=False, slots=True)
class Impulses:
    """Impulses of a family at some frequencies."""

    # p+ and p-; 0 where singular, (frequency, constraint)
    plus: Floats
    minus: Floats
    error: Floats  # relative error of the largest of them, infinite where singular, (frequency,)

    @property
    def singular(self) -> Booleans:
        """Where no impulse brings the structure to its walls, or none that differs from zero.

        There the impulses grow without bound, or balance to zero (momentum of free structures),
        until they are errors.
        """
        return np.asarray(~(self.error < 1.0))
