"""Contact phases: how long a stop pushes, how much, how deep, and what that costs.

A phase lasts from the instant at which a stop begins to push until its force is zero. Impulse,
deepest indentation, largest force and the loss in the dashpot, ``c`` times the integral of the
squared rate, come from the certified expansions of `kernels.switchings`. What the spring still
holds when the force is lost is given back to nobody: the stop comes back without the structure, and
that is part of the loss, until it is left or loaded again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.kernels.switchings import (
    DEEPEST,
    IMPULSE,
    LEFT_OUT,
    SQUARE,
    STRONGEST,
    contact_sums,
)
from vibroimpact_solvers.meter import hold, look
from vibroimpact_solvers.time_history.stops.configurations import Scene, StoppedStructure

SAMPLED: Final = 6.0
"""Errors of forms over what the largest of five samples of each pair makes of them."""
_LARGEST: Final = 1e150  # deviation that counts, beyond the horizon
_LONGEST: Final = 1e300
_BYTES: Final = 400  # of a contact phase
_ROUNDED: Final = 8.0  # roundings of sums over a contact


@dataclass(eq=False, slots=True)
class Contact:
    """A contact phase, in the units of the problem; errors are absolute."""

    constraint: int
    side: int
    start: float
    stop: float = math.nan
    impulse: float = 0.0
    energy_lost: float = 0.0
    error_start: float = 0.0
    error_stop: float = 0.0
    error_impulse: float = 0.0
    error_peak_force: float = 0.0
    error_indentation: float = 0.0
    error_energy_lost: float = 0.0
    speed: float = 0.0  # at its start
    sums: Floats = field(default_factory=lambda: np.zeros(6))

    @property
    def peak_force(self) -> float:
        """The largest force."""
        return float(self.sums[STRONGEST])

    @property
    def indentation(self) -> float:
        """The largest indentation."""
        return float(self.sums[DEEPEST])


class Contacts:
    """The table of contact phases of a motion.

    Parameters
    ----------
    structure : StoppedStructure
    wanted : bool
        Whether phases are summed up.
    """

    def __init__(self, structure: StoppedStructure, *, wanted: bool) -> None:
        self._structure, self.wanted = structure, wanted
        self.rows = list[Contact]()
        self._loaded = dict[int, Contact]()
        self._last = dict[int, Contact]()
        self._released = dict[int, Contact]()

    def start(
        self, a: int, side: int, time: float, error: float, speed: float, speed_error: float
    ) -> None:
        """Begin a phase at a time of the basis, at some speed, both known to an error."""
        if self.wanted:
            scale = self._structure.scale
            self._loaded[a] = contact = Contact(a, side, time / scale, error_start=error / scale)
            contact.speed = abs(speed) * scale
            contact.error_peak_force = float(self._structure.damping[a]) * speed_error * scale
            self.rows.append(contact)
            hold(_BYTES)

    @property
    def lasting(self) -> bool:
        """Whether any phase lasts."""
        return bool(self._loaded)

    def add(
        self,
        scene: Scene,
        work: tuple[Any, ...],
        states: tuple[Floats, Floats],
        span: float,
        spreads: tuple[Floats, Floats],
    ) -> None:
        """Add a free motion of some duration from a state to the phases that last.

        Parameters
        ----------
        scene : Scene
        work : tuple
            Its work arrays.
        states : tuple of array, each shape (2, pair)
            At the beginning and at the end.
        span : float
            In units of the basis.
        spreads : tuple of array, each shape (2, pair)
            Sizes of the deviations at the beginning and at the end, `spread_of`.
        """
        if not self._loaded or span <= 0.0:
            return
        motion = states[0], np.maximum(*map(np.abs, states)).ravel()
        spread = np.maximum(*spreads).ravel()
        for contact in self._loaded.values():
            self._add_to(contact, (scene, work), motion, span, spread)

    def _add_to(
        self,
        contact: Contact,
        at: tuple[Scene, tuple[Any, ...]],
        motion: tuple[Floats, Floats],
        span: float,
        spread: Floats,
    ) -> None:
        structure, scale = self._structure, self._structure.scale
        (scene, work), a = at, contact.constraint
        z, largest = motion
        forms, slopes = scene.sizes
        moves, slides, pushes = forms[a], slopes[a], forms[scene.force_place(a)]
        k, c = float(structure.stiffness[a]), float(structure.damping[a])
        above = float(scene.placed.indentations[a])
        size = float(moves @ largest) + abs(above)
        before = float(contact.sums[SQUARE])
        contact.sums[LEFT_OUT:] = 0.0
        done = 0.0 if size > 0.0 else span
        longest, law = min(scene.basis.longest, _LONGEST), np.array([k, c * scale])
        while done < span:
            done = contact_sums(
                scene.arguments, work, scene.basis.modes.roots.size, z, law,
                (a, contact.side, above, done, span, longest, size), contact.sums,
            )  # fmt: skip
            look()
        contact.impulse = float(contact.sums[IMPULSE]) / scale
        square = float(contact.sums[SQUARE]) - before
        contact.energy_lost += c * scale * square
        missed = SAMPLED * EPS * spread + _ROUNDED * EPS * largest
        off, fast, force = float(moves @ missed), float(slides @ missed), float(pushes @ missed)
        still = float(np.abs(scene.placed.rows[a]) @ scene.placed.terms)
        off, force = off + _ROUNDED * EPS * still, force + _ROUNDED * EPS * k * still
        less, slower = contact.sums[LEFT_OUT:].tolist()
        contact.error_impulse += (force + k * less) * span / scale + 2.0 * c * less
        contact.error_impulse += _ROUNDED * EPS * abs(contact.impulse)
        fast += slower
        contact.error_indentation = max(contact.error_indentation, off + less)
        contact.error_peak_force = max(
            contact.error_peak_force, force + k * less + c * scale * slower
        )
        rates = 2.0 * fast * math.sqrt(max(square * span, 0.0)) + fast * fast * span
        contact.error_energy_lost += c * scale * (rates + _ROUNDED * EPS * square)

    def stop(self, a: int, time: float, error: float) -> None:
        """End a phase at a time of the basis, known to an error."""
        contact = self._loaded.pop(a, None)
        if contact is None:
            return
        self._last[a] = contact
        scale = self._structure.scale
        contact.stop, contact.error_stop = time / scale, error / scale
        if self._structure.damping[a] > 0.0:
            # A dashpot pushes from the first instant on, a little earlier or later.
            contact.error_impulse += contact.error_start * contact.peak_force
            contact.error_energy_lost += contact.error_start * contact.peak_force * contact.speed

    def release(self, a: int, indentation: float, error: float) -> None:
        """Count what the spring of a stop holds that has just lost its force as lost."""
        contact = self._last.get(a)
        if contact is not None:
            self._count(contact, a, indentation, error, 1.0)
            self._released[a] = contact

    def end_release(self, a: int, indentation: float, error: float) -> None:
        """Take back what the spring of a released stop holds when it is left or loaded again."""
        released = self._released.pop(a, None)
        if released is not None:
            self._count(released, a, indentation, error, -1.0)

    def _count(
        self, contact: Contact, a: int, indentation: float, error: float, sign: float
    ) -> None:
        k = float(self._structure.stiffness[a])
        contact.energy_lost += sign * 0.5 * k * indentation * indentation
        contact.error_energy_lost += k * (abs(indentation) + 0.5 * error) * error


def spread_of(deviations: Floats, rotations: int) -> Floats:
    """Return the largest magnitudes of deviations (column, 2, pair), shape (2, pair).

    Of a pair that turns, both numbers are as large as their length.
    """
    spread = np.fmin(np.abs(deviations).max(axis=0, initial=0.0), _LARGEST)
    turning = deviations[..., :rotations]
    if turning.size:
        lengths = np.sqrt(np.einsum("ckj,ckj->cj", turning, turning).max(axis=0))
        spread[:, :rotations] = np.fmin(lengths, _LARGEST)
    return np.asarray(spread)


def error_of(form: Floats, spread: Floats) -> float:
    """Return the error of a linear form whose state has deviations of these sizes."""
    return SAMPLED * EPS * float(np.abs(form).ravel() @ spread.ravel())
