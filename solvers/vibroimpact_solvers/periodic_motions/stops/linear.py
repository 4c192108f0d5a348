"""Motions in which no stop switches: the stop open throughout, or loaded throughout."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.kernels.limit_check import BEYOND, KEPT, LOWER, PASSED, UPPER
from vibroimpact_solvers.periodic_motions.existence import Verdicts
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.stops.existence import Leg, check, walls_of
from vibroimpact_solvers.periodic_motions.stops.parts import Part
from vibroimpact_solvers.periodic_motions.stops.phases import Phases, Side
from vibroimpact_solvers.periodic_motions.stops.prescribed import Cells
from vibroimpact_solvers.results.impact_modes import Reason


@dataclass(frozen=True, eq=False, slots=True)
class Linear:
    """The responses at all frequencies, with the stop open or loaded throughout.

    Parameters
    ----------
    phases : Phases
    cells : Cells
        Whole periods.
    held : bool
        Whether the stop is loaded.
    """

    phases: Phases
    cells: Cells
    held: bool

    @property
    def side(self) -> Side:
        """The structure that moves."""
        return self.phases.loaded if self.held else self.phases.open

    @property
    def steady(self) -> Complexes:
        """Amplitudes, (frequency, harmonic, 2 pair)."""
        return self.cells.loaded if self.held else self.cells.opened

    @property
    def unbounded(self) -> Booleans:
        """Where the load drives a mode without damping at its own frequency, (frequency,)."""
        return np.asarray(~np.isfinite(self.steady).all(axis=(1, 2)))

    def _state(self) -> tuple[Floats, Floats]:
        return np.zeros(2 * self.side.size), np.zeros(self.side.size)

    def part(self, f: int) -> Part:
        """Return the motion at one frequency as a part, from the drive's phase 0."""
        state, error = self._state()
        rates = self.cells.Omega[f] * self.phases.harmonics
        return Part(
            self.side, state, self.steady[f], rates, self.cells.factor[f].astype(np.complex128),
            float(self.cells.length[f]), error, self.phases.frame,
        )  # fmt: skip

    def verdicts(self) -> Verdicts:
        """Decide at which frequencies it is a motion."""
        phases, count = self.phases, self.cells.Omega.size
        a, force = phases.impact.constraint, phases.open.level.size
        walls, none = walls_of(phases, mirrored=False), np.full(count, -1)
        if self.held:
            own = UPPER if phases.impact.side > 0 else LOWER
            walls[own, a] = math.inf if own == UPPER else -math.inf
            walls[LOWER, force] = 0.0
        state, error = self._state()
        good = ~self.unbounded
        steady = np.where(good[:, np.newaxis, np.newaxis], self.steady, 0.0)
        leg = Leg(
            self.side, steady, np.tile(state, (count, 1)), np.tile(error, (count, 1)),
            np.zeros(count), np.zeros(count), self.cells.length, walls, none, none, LOWER,
            np.zeros(count, dtype=np.int64),
        )  # fmt: skip
        decided = check(phases.harmonics, self.cells.Omega, leg)
        kind, which = decided["kind"], decided["constraint"]
        fails = (kind >= BEYOND) & good
        reason: Integers = np.full(count, int(Reason.OK))
        reason[fails] = Reason.PENETRATION
        reason[fails & (which == force)] = Reason.NEGATIVE_IMPULSE
        reason[~good] = Reason.SINGULAR
        part = decided["time"] / self.cells.length
        return Verdicts(
            reason, np.where(fails, part, np.nan),
            np.where(fails, np.where(which == force, a, which), -1),
            ((kind == KEPT) | (kind == PASSED)) & good,
        )  # fmt: skip

    def multipliers(self) -> tuple[Complexes, Floats]:
        """Return all multipliers over a period by descending modulus, and their errors."""
        pairs, T = self.side.pairs, self.cells.length[:, np.newaxis]
        own = pairs.moving
        alpha, nu = pairs.alpha[own].astype(np.complex128), pairs.nu[own].astype(np.complex128)
        nu[own < pairs.rotations.stop] *= 1j
        nu[own >= pairs.hyperbolas.stop] = 0.0
        rates = np.concatenate([alpha + nu, alpha - nu])
        values = np.exp(rates * T)
        drift = np.concatenate([pairs.drift[own], pairs.drift[own]])
        errors = np.abs(values) * (
            drift * T + 4.0 * np.finfo(float).eps * (1.0 + np.abs(rates) * T)
        )
        order = np.lexsort((-values.imag, -np.round(np.abs(values), 14)), axis=1)
        row = np.arange(len(values))[:, np.newaxis]
        return values[row, order], errors[row, order]
