"""Walls that move: both walls of a coordinate y are displaced by u(t), and stops see y - u.

The displacement is a sum of harmonics, or a straight line between samples. Harmonics have a
frequency of their own in time histories, and are multiples of the drive's in periodic motions.
Kinds that compute such motions are `OFFERED`; all others refuse walls that move.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.errors import ModelError

OFFERED: Final = ("time-history", "periodic-motions")
"""Kinds that compute motions with moving walls."""
LARGEST: Final = 1e100
"""Largest displacement and frequency of a wall."""


@dataclass(frozen=True, slots=True)
class Swing:
    """A displacement ``amplitude cos(frequency t + phase)`` of a wall.

    Parameters
    ----------
    amplitude, frequency, phase : float
        The frequency is positive, rad per unit of time.
    """

    amplitude: float
    frequency: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        for name in ("amplitude", "frequency", "phase"):
            value = getattr(self, name)
            if not abs(value) <= LARGEST or (name == "frequency" and not value > 1e-100):
                message = f"the {name} of the wall is {value!r}"
                raise ModelError((name,), message, code="out_of_range")


@dataclass(frozen=True, slots=True)
class Turn:
    """A displacement ``amplitude cos(harmonic Omega t + phase)`` of a wall, Omega of the drive.

    Parameters
    ----------
    amplitude : float
    harmonic : int
        Multiple of the drive's frequency, at least 1.
    phase : float
    """

    amplitude: float
    harmonic: int = 1
    phase: float = 0.0

    def __post_init__(self) -> None:
        for name in ("amplitude", "phase"):
            if not abs(getattr(self, name)) <= LARGEST:
                message = f"the {name} of the wall is {getattr(self, name)!r}"
                raise ModelError((name,), message, code="out_of_range")
        if self.harmonic < 1:
            message = "the harmonic is below 1; a constant displacement belongs to the gap"
            raise ModelError(("harmonic",), message, code="out_of_range")


@dataclass(frozen=True, slots=True)
class Samples:
    """Displacements of a wall at times, with straight lines between.

    Parameters
    ----------
    t, y : tuple of float
        Ascending times, and displacements.
    """

    t: tuple[float, ...]
    y: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.t) != len(self.y) or len(self.t) < 2:
            message = f"{len(self.y)} displacements of the wall at {len(self.t)} times"
            raise ModelError(("y",), message, code="wrong_length")
        for name in ("t", "y"):
            if not all(abs(value) <= LARGEST for value in getattr(self, name)):
                message = "a number is nan, infinite or too large"
                raise ModelError((name,), message, code="out_of_range")
        if not (np.diff(np.array(self.t)) > 0.0).all():
            raise ModelError(("t",), "the times do not ascend", code="not_ascending")


Wall = tuple[Swing | Turn, ...] | Samples
"""How both walls of a coordinate move; an empty tuple stands for walls at rest."""


def require(kind: str, constraints: Sequence[Any]) -> None:
    """Refuse walls that move where a kind does not compute them, or not in this way.

    Raises
    ------
    ModelError
        Naming the first of them.
    """
    driven = kind == OFFERED[1]
    for index, wall in ((i, c.wall) for i, c in enumerate(constraints) if c.wall):
        where = ("system", "constraints", index, "wall")
        if kind not in OFFERED:
            offered = " and ".join(OFFERED)
            message = f"{kind} is computed with walls at rest; moving ones are offered by {offered}"
            raise ModelError(where, message, code="not_possible")
        if driven and isinstance(wall, Samples):
            message = "samples of a wall are offered by time-history; periodic motions take terms"
            raise ModelError(where, message, code="not_possible")
        for place, term in enumerate(() if isinstance(wall, Samples) else wall):
            if isinstance(term, Turn) != driven:
                message = (
                    "the wall of a periodic motion has a harmonic of the drive, not a frequency"
                    if driven
                    else f"the wall of a {kind} has a frequency: there is no drive's harmonic"
                )
                name = "frequency" if driven else "harmonic"
                raise ModelError((*where, place, name), message, code="not_possible")


def check(constraints: Sequence[Any], t_end: float) -> None:
    """Refuse moving walls whose motions until an end are not computed.

    Raises
    ------
    ModelError
        Naming the wall, or what of it.
    """
    for index, constraint in enumerate(constraints):
        where, wall = ("system", "constraints", index, "wall"), constraint.wall
        if not wall:
            continue
        if constraint.law.name != "linear":
            message = (
                f"walls move with linear stops only; constraint {index} has a "
                f"{constraint.law.name} one"
            )
            raise ModelError(where, message, code="not_possible")
        if isinstance(wall, Samples):
            if not wall.t[0] <= 0.0 or not wall.t[-1] >= t_end:
                message = f"samples do not last from 0 to t_end = {t_end!r}"
                raise ModelError((*where, "t"), message, code="out_of_range")
            if constraint.law.lossy:
                message = (
                    "the velocity of a sampled wall jumps at its samples, and the force of a "
                    "dashpot with it: sampled walls are offered with linear stops without damping"
                )
                raise ModelError(where, message, code="not_possible")
            continue
        for place, swing in enumerate(swings(wall)):
            if swing.frequency * t_end > 2.0**52:
                message = "the wall swings too often until t_end for its phase to be known"
                pointer = (*where, place, "frequency")
                raise ModelError(pointer, message, code="out_of_range")


def velocity_of(cosine: Any, sine: Any, frequencies: Any) -> tuple[Any, Any]:
    """Return ``u'`` of ``u = cosine cos(omega t) - sine sin(omega t)`` in the same form."""
    return -frequencies * sine, frequencies * cosine


def parts(wall: Wall) -> list[tuple[float, float, float]]:
    """Return the frequency, cosine and sine of each swing of a wall."""
    return [
        (s.frequency, s.amplitude * math.cos(s.phase), s.amplitude * math.sin(s.phase))
        for s in swings(wall)
    ]


def swings(wall: Wall) -> list[Swing]:
    """Return the terms of a wall that have a frequency."""
    return [] if isinstance(wall, Samples) else [s for s in wall if isinstance(s, Swing)]


def turns(wall: Wall) -> list[Turn]:
    """Return the terms of a wall that are harmonics of the drive, if they have an amplitude."""
    given = () if isinstance(wall, Samples) else wall
    return [term for term in given if isinstance(term, Turn) and term.amplitude != 0.0]
