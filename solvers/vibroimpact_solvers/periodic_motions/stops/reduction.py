"""A structure by its slow modes, in which durations of contacts are searched.

What fast modes yield to a constant force is a spring in series with the stop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.laws import Linear
from vibroimpact_solvers.model import Constraint, SymmetricMatrix, System
from vibroimpact_solvers.periodic_motions.problem import SYMMETRIC, Force, Impact, Problem
from vibroimpact_solvers.periodic_motions.stops.phases import Phases
from vibroimpact_solvers.periodic_motions.stops.prescribed import Cells


@dataclass(frozen=True, eq=False, slots=True)
class Reduced:
    """A structure by some of its modes, with the stop of the contact alone.

    Parameters
    ----------
    problem : Problem
        In coordinates of the modes.
    phases : Phases
    """

    problem: Problem
    phases: Phases

    @classmethod
    def of(cls, problem: Problem, phases: Phases, count: int) -> Reduced | None:
        """Take the slowest modes that move the stop; None where there are not more than these.

        Parameters
        ----------
        problem : Problem
        phases : Phases
            Of the whole structure.
        count : int
            The number of modes.
        """
        modes, (impact,) = phases.stopped.placed(()).basis.modes, problem.impacts
        row = phases.stopped.rows[impact.constraint]
        moved = np.flatnonzero(row)
        if moved.size <= count:
            return None
        order = moved[np.argsort(modes.roots[moved], kind="stable")]
        kept, fast = np.sort(order[:count]), order[count:]
        squares = modes.roots * np.abs(modes.roots)
        yields = float((row[fast] ** 2 / squares[fast]).sum())
        if (flexibility := problem.system.flexibility) is not None:
            yields += float(flexibility[impact.constraint, impact.constraint])
        rest = float((row[fast] * modes.load[fast] / squares[fast]).sum())
        system = _system(problem, phases, row, kept, (yields, rest))
        forces = (phases.forces @ modes.shapes)[0, kept].tolist()
        load = tuple(
            Force((place,), (1.0,), abs(f), int(phases.harmonics[0]),
                  math.atan2(f.imag, f.real), int(phases.powers[0]))
            for place, f in enumerate(forces)
            if f != 0.0
        )  # fmt: skip
        if not load:
            return None
        symmetric = problem.symmetric
        own = Problem(
            system, problem.Omega, load, problem.periods,
            SYMMETRIC if symmetric else (Impact(0, impact.side),), outputs=frozenset({"exists"}),
        )  # fmt: skip
        return cls(own, Phases.of(own, spectrum.choose(system)))

    def cells(self, Omega: Floats) -> Cells:
        """Return the cells of some frequencies."""
        return Cells.of(self.phases, self.problem.at(Omega))


def _system(
    problem: Problem, phases: Phases, row: Floats, kept: np.ndarray, fast: tuple[float, float]
) -> System:
    """Return the structure in coordinates of the modes that are kept."""
    modes, (impact,) = phases.stopped.placed(()).basis.modes, problem.impacts
    yields, rest = fast
    k, c = phases.stiffness, phases.damping / phases.scale
    softer = 1.0 / (1.0 + k * yields)
    wall = phases.wall - impact.side * rest
    lower, upper = (None, wall) if impact.side > 0 else (wall, None)
    if problem.symmetric:
        lower = upper = wall
    stop = Constraint(
        tuple(range(kept.size)), tuple(row[kept].tolist()), lower, upper,
        law=Linear(k * softer, c * softer**2),
    )  # fmt: skip
    squares = (modes.roots * np.abs(modes.roots))[kept]
    damped = modes.damping is not None and modes.damping.size > 0
    C = None
    if damped:
        C = SymmetricMatrix.dense(np.asarray(modes.damping)[np.ix_(kept, kept)])
    return System(
        SymmetricMatrix.diagonal(np.ones(kept.size)), SymmetricMatrix.diagonal(squares), (stop,),
        C=C, force=modes.load[kept] if modes.load[kept].any() else None,
    )  # fmt: skip
