"""Walls that move, as forms of the loads' pairs: what stops see is ``y - u(t)``.

The time courses of walls are loads without a force (`time_history.problem.Problem.acting`), so that
each has a pair in the state of every basis. With a stop loaded, ``k u + c u'`` is a load.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from vibroimpact_solvers import walls
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.time_history.basis import Basis
from vibroimpact_solvers.time_history.loads import Ramps
from vibroimpact_solvers.time_history.structure import Structure


@dataclass(frozen=True, eq=False, slots=True)
class Course:
    """Displacements of walls, ``cosine cos(omega t) - sine sin(omega t) + ramps V``.

    Parameters
    ----------
    cosine, sine : array, shape (constraint, load)
        By the harmonic loads of the structure.
    ramps : array, shape (constraint, ramp)
        By its sampled loads.
    frequencies : array, shape (load,)
    sizes : array, shape (constraint,)
        Their largest magnitudes.
    """

    cosine: Floats
    sine: Floats
    ramps: Floats
    frequencies: Floats
    sizes: Floats

    @classmethod
    def of(cls, structure: Structure) -> Self:
        """Return the courses of the walls of a structure, among whose loads they are."""
        given = [c.wall for c in structure.system.constraints]
        frequencies, ramps = structure.harmonic_loads.frequencies, structure.ramps
        cosine, sine = np.zeros((2, len(given), frequencies.size))
        sampled = [a for a, wall in enumerate(given) if isinstance(wall, walls.Samples)]
        course, sizes = np.zeros((len(given), ramps.count)), np.zeros(len(given))
        for a, wall in enumerate(given):
            for frequency, first, second in walls.parts(wall):
                k = int(np.searchsorted(frequencies, frequency))
                cosine[a, k] += first
                sine[a, k] += second
        for place, a in enumerate(sampled, start=ramps.count - len(sampled)):
            course[a, place] = 1.0
            sizes[a] = np.abs(ramps.values[:, place]).max()
        sizes += np.hypot(cosine, sine).sum(axis=1)
        return cls(cosine, sine, course, frequencies, sizes)

    @property
    def moves(self) -> bool:
        """Whether any wall does."""
        return bool(self.sizes.any())

    def form(self, basis: Basis) -> Floats:
        """Return the displacements as forms of the states of a basis, (constraint, 2, pair)."""
        return basis.load(self.cosine, self.sine, self.ramps)

    def pull(
        self, loaded: tuple[int, ...], springs: Floats, damping: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return ``k u + c u'`` of loaded stops: cosines, sines and ramps, (loaded, load) each."""
        some = [*loaded]
        cosine, sine = self.cosine[some], self.sine[some]
        rates, c = walls.velocity_of(cosine, sine, self.frequencies), damping[:, np.newaxis]
        ramps: Floats = springs @ self.ramps[some]
        return springs @ cosine + c * rates[0], springs @ sine + c * rates[1], ramps

    def displaced(self, shares: Floats | None, loaded: tuple[int, ...]) -> Course:
        """Return the courses as loaded stops in series with a residual flexibility show them."""
        if shares is None or not self.moves:
            return self
        some, parts = [*loaded], list[Floats]()
        for part in (self.cosine, self.sine, self.ramps):
            moved = shares @ part[some]
            kept = part + moved
            kept[some] = moved[some]
            parts.append(kept)
        sizes = self.sizes + np.abs(shares) @ self.sizes[some]
        return Course(parts[0], parts[1], parts[2], self.frequencies, sizes)

    def at_start(self, ramps: Ramps) -> tuple[Floats, Floats]:
        """Return displacements and velocities at t = 0, shape (constraint,) each."""
        values = ramps.state(ramps.segment(0.0) if ramps.count else -1, 0.0)
        velocity, _ = walls.velocity_of(self.cosine, self.sine, self.frequencies)
        away = self.cosine.sum(axis=1) + self.ramps @ values[0]
        return away, velocity.sum(axis=1) + self.ramps @ values[1]
