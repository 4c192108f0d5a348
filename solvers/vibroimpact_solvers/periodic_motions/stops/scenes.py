"""A driven structure with any number of stops of finite stiffness, with some of them loaded.

With given stops loaded the structure is linear (`phases.Side`). Its states are deviations from its
steady response to the load at the drive's frequency.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from vibroimpact_solvers import spectrum
from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.model import System
from vibroimpact_solvers.periodic_motions.frame import Frame
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.problem import Impact
from vibroimpact_solvers.periodic_motions.stops.phases import (
    Load,
    Side,
    Stop,
    acting,
    check_borne,
    passage_of,
    side_of,
)
from vibroimpact_solvers.time_history.stops.modes import StoppedModes
from vibroimpact_solvers.time_history.structure import Structure

Loaded = tuple[tuple[int, int], ...]
"""Constraints whose stops are loaded, ascending, and their sides."""


class Scenes:
    """A structure with stops of finite stiffness, with any of them loaded.

    Parameters
    ----------
    system : System
    load : Load
    longest : float
        The longest period of the drive.
    method : spectrum.Method
    frame : Frame, optional
        Where displacements are relative to walls that move.
    """

    def __init__(
        self, system: System, load: Load, longest: float, method: spectrum.Method,
        frame: Frame | None = None,
    ) -> None:  # fmt: skip
        self.stopped = StoppedModes(Structure.of(system, method, longest))
        self.harmonics, self.powers, self.forces, self.frame = acting(load, frame)
        self._sides: dict[Loaded, Side] = {}
        self._watching: dict[tuple[Loaded, int, int], Side] = {}
        self._passages: dict[tuple[Loaded, Loaded], tuple[Floats, Floats]] = {}

    @property
    def scale(self) -> float:
        """Units of the basis' time in one of time."""
        return self.stopped.scale

    @property
    def unit(self) -> float:
        """What a force in a unit of the basis' time is as an impulse."""
        return math.ldexp(1.0, -2 * self.stopped.exponent)

    @property
    def open(self) -> Side:
        """The structure without contacts."""
        return self.side(())

    def stop(self, constraint: int, side: int) -> Stop:
        """Return a stop at one of its walls."""
        return Stop(
            Impact(constraint, side), float(self.stopped.stiffness[constraint]),
            float(self.stopped.damping[constraint]) * self.scale,
            self.stopped.wall(constraint, side),
        )  # fmt: skip

    def side(self, loaded: Loaded) -> Side:
        """Return the structure with some stops loaded."""
        known = self._sides.get(loaded)
        if known is None:
            constraint, side = loaded[0] if loaded else (0, 1)
            known = self._sides[loaded] = side_of(
                self.stopped, self.stopped.placed(loaded), Impact(constraint, side), self.forces,
                loaded=bool(loaded),
            )  # fmt: skip
        return known

    def watching(self, loaded: Loaded, constraint: int, side: int) -> Side:
        """Return the structure with some stops loaded, with the form of the force of a stop."""
        key = loaded, constraint, side
        known = self._watching.get(key)
        if known is None:
            one, stop = self.side(loaded), self.stop(constraint, side)
            k, c, placed = stop.stiffness, stop.damping, self.stopped.placed(loaded)
            held = (constraint, side) in loaded
            beyond = side * float(placed.levels[constraint]) - stop.wall
            level = k * float(placed.indentations[constraint] if held else beyond)
            known = self._watching[key] = replace(
                one, force=side * (k * one.position[constraint] + c * one.velocity[constraint]),
                force_level=level, force_size=abs(level) + k * (0.0 if held else abs(stop.wall)),
            )  # fmt: skip
        return known

    def passage(self, before: Loaded, after: Loaded) -> tuple[Floats, Floats]:
        """Return how deviations carry over: ``matrix z + offset``."""
        key = before, after
        known = self._passages.get(key)
        if known is None:
            placed = self.stopped.placed(before), self.stopped.placed(after)
            given = placed[0], self.side(before), placed[1], self.side(after)
            known = self._passages[key] = passage_of(*given)
        return known

    def jump(
        self, before: Loaded, after: Loaded, stop: tuple[int, int], *, at_wall: bool
    ) -> Floats:
        """Return what the switching of a stop makes of deviations.

        Where a dashpot begins to push at its wall the force jumps to ``c d'``: a deviation that
        comes earlier has been pushed by c times the way till then.
        """
        matrix, _ = self.passage(before, after)
        damping = self.stop(*stop).damping
        if not at_wall or damping == 0.0:
            return matrix
        side, a = self.side(before), stop[0]
        push = damping * self.unit * (matrix @ side.kick[a])
        return np.asarray(matrix - np.outer(push, side.position[a]))


class Cell:
    """Scenes at one frequency of the drive, over a period of motions.

    Parameters
    ----------
    scenes : Scenes
    Omega : float
        Of the drive, in its own units.
    periods : int
        Of the drive, in one of the motions.

    Attributes
    ----------
    Omega, length : float
        Frequency and period by the basis' time.
    rates, factor : array, shape (harmonic,)
        Rates of the load, and factors of its amplitudes.

    Raises
    ------
    ModelError
        Where a constant load moves a free body.
    """

    def __init__(self, scenes: Scenes, Omega: float, periods: int) -> None:
        check_borne(scenes.stopped)
        self.scenes, self.Omega = scenes, Omega / scenes.scale
        self.length = periods * 2.0 * math.pi / self.Omega
        self.rates: Floats = self.Omega * scenes.harmonics
        self.factor: Floats = Omega ** scenes.powers.astype(np.float64)
        self._steady: dict[Loaded, Complexes] = {}

    def steady(self, loaded: Loaded) -> Complexes:
        """Return amplitudes of the steady response, (harmonic, 2 pair)."""
        known = self._steady.get(loaded)
        if known is None:
            side = self.scenes.side(loaded)
            response, _ = side.pairs.steady_response(self.rates[np.newaxis], side.load)
            flat = response[0].reshape(self.rates.size, -1) * self.factor[:, np.newaxis]
            known = self._steady[loaded] = np.asarray(flat)
        return known

    def turned(self, time: float) -> Complexes:
        """Return by what the load has turned at a time, (harmonic,)."""
        return np.asarray(np.exp(1j * self.rates * time))

    def at(self, loaded: Loaded, time: float) -> tuple[Floats, Floats]:
        """Return the steady response at a time, and its rate, (2 pair,) each."""
        amplitude = self.steady(loaded) * self.turned(time)[:, np.newaxis]
        rate = 1j * self.rates[:, np.newaxis] * amplitude
        return amplitude.real.sum(axis=0), rate.real.sum(axis=0)

    def shift(self, before: Loaded, after: Loaded, time: float) -> Floats:
        """Return what is added to deviations that carry over at a time, (2 pair after,)."""
        matrix, offset = self.scenes.passage(before, after)
        return np.asarray(offset + matrix @ self.at(before, time)[0] - self.at(after, time)[0])
