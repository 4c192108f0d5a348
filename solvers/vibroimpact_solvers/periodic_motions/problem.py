"""The problem: a driven structure, the frequencies of the drive, and the sequence of impacts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.checks import check_indices, check_outputs, check_tolerance
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.laws import Linear, require
from vibroimpact_solvers.model import System, within_range
from vibroimpact_solvers.periodic_motions.frame import Frame
from vibroimpact_solvers.walls import turns

KIND: Final = "periodic-motions"
OUTPUTS: Final = ("exists", "extremes", "energy", "stability", "multipliers", "waveform")
"""Beside frequencies, impacts and their number, which are always there."""

SYMMETRIC: Final = "symmetric"


@dataclass(frozen=True, slots=True)
class Force:
    """A load ``amplitude Omega^power cos(harmonic Omega t + phase)`` along a direction.

    Parameters
    ----------
    dofs : tuple of int
    weights : tuple of float
    amplitude : float
    harmonic : int
        Multiple of the drive's frequency, at least 1.
    phase : float
    power : int
        Power of the drive's frequency with which the amplitude grows: 2 of an unbalance. All
        loads of one harmonic have the same.
    """

    dofs: tuple[int, ...]
    weights: tuple[float, ...]
    amplitude: float
    harmonic: int = 1
    phase: float = 0.0
    power: int = 0

    def at(self, Omega: float) -> Force:
        """Return the load at one frequency of the drive, with its amplitude there."""
        if not self.power:
            return self
        return replace(self, amplitude=self.amplitude * Omega**self.power, power=0)


def harmonic_forces(
    load: tuple[Force, ...], n: int, others: Iterable[float] = ()
) -> tuple[Floats, Integers, NDArray[np.complex128]]:
    """Return harmonics, their powers of the frequency and their forces, see `Problem.forces`.

    Others are harmonics that are there without a force.
    """
    harmonics = np.unique([*(force.harmonic for force in load), *others]).astype(np.float64)
    forces = np.zeros((harmonics.size, n), dtype=np.complex128)
    powers = np.zeros(harmonics.size, dtype=np.int64)
    for force in load:
        k = int(np.searchsorted(harmonics, force.harmonic))
        powers[k] = force.power
        amplitude = force.amplitude * complex(math.cos(force.phase), math.sin(force.phase))
        for dof, weight in zip(force.dofs, force.weights, strict=True):
            forces[k, dof] += amplitude * weight
    return harmonics, powers, forces


@dataclass(frozen=True, slots=True)
class Impact:
    """An impact: the constraint, and 1 for its upper wall or -1 for its lower one."""

    constraint: int
    side: int = 1


@dataclass(frozen=True, eq=False)
class Problem:
    """Periodic motions with a given sequence of impacts.

    Parameters
    ----------
    system : System
        With damping, coefficients of restitution and a constant load.
    Omega : array, shape (frequency,)
        Frequencies of the drive, rad per unit of time.
    load : tuple of Force
    periods : int
        Number of the drive's periods in one period of the motion.
    sequence : tuple of Impact, or "symmetric"
        The impacts of one period in their order; or one at each wall of a constraint with equal
        gaps, half a period apart, the motion being ``x(t + T/2) = -x(t)``.
    constraint : int
        The one of a symmetric sequence.
    phases : array, shape (guess, impact), optional
        Where the search for sequences of several impacts begins: phases Omega t of the impacts,
        rad, ascending.
    outputs : frozenset of str
        The requested ones of `OUTPUTS`.
    dofs : array of int, optional
        Degrees of freedom of extremes and waveform; None for all.
    tau : array, optional
        Times of the waveform over the period, 0 to 1.
    tolerance : float, optional
        Largest relative error of the impulses; the result tells which solutions meet it.
    frame : Frame, optional
        Where displacements are relative to walls that move, see `stops.moving_walls`.
    """

    system: System
    Omega: Floats
    load: tuple[Force, ...] = ()
    periods: int = 1
    sequence: tuple[Impact, ...] | str = (Impact(0),)
    constraint: int = 0
    phases: Floats | None = None
    outputs: frozenset[str] = frozenset({"exists", "extremes", "energy", "multipliers"})
    dofs: Integers | None = None
    tau: Floats | None = None
    tolerance: float | None = None
    frame: Frame | None = None
    output_dofs: Integers = field(init=False)

    def __post_init__(self) -> None:
        dofs = np.arange(self.system.n) if self.dofs is None else np.asarray(self.dofs)
        object.__setattr__(self, "output_dofs", dofs.astype(np.int64))
        object.__setattr__(self, "outputs", frozenset(self.outputs))
        object.__setattr__(self, "Omega", np.ascontiguousarray(self.Omega, dtype=np.float64))
        check_outputs(self.outputs, OUTPUTS)
        require(KIND, self.system.constraints)
        self._check_walls()
        check_tolerance(self.tolerance)
        check_indices("dofs", self.output_dofs, self.system.n)
        self._check_frequencies()
        self._check_load()
        self._check_sequence()
        if self.stopped:
            self._check_stops()
        if "waveform" in self.outputs and (self.tau is None or np.size(self.tau) == 0):
            message = "the waveform needs tau, times over the period from 0 to 1"
            raise ModelError(("tau",), message, code="tau_missing")

    @property
    def stopped(self) -> bool:
        """Whether stops have a finite stiffness."""
        return any(not constraint.law.rigid for constraint in self.system.constraints)

    @property
    def searched(self) -> bool:
        """Whether solutions are looked for from many starts, of which none is proved to miss."""
        if self.stopped:
            return len(self.impacts) > 1 or len(self.harmonics) > 1
        return len(self.impacts) > 1

    @property
    def moving(self) -> bool:
        """Whether walls move."""
        return any(constraint.wall for constraint in self.system.constraints)

    @property
    def harmonics(self) -> set[int]:
        """Harmonics of the load, and of walls."""
        walls = (constraint.wall for constraint in self.system.constraints)
        moved = {term.harmonic for wall in walls for term in turns(wall)}
        return moved | {force.harmonic for force in self.load if force.amplitude != 0.0}

    @property
    def symmetric(self) -> bool:
        """Whether the second half of the period mirrors the first."""
        return self.sequence == SYMMETRIC

    @property
    def impacts(self) -> tuple[Impact, ...]:
        """The impacts of one cell: of the period, or of half of it where that mirrors the rest."""
        if isinstance(self.sequence, str):
            return (Impact(self.constraint, 1),)
        return self.sequence

    @property
    def turn(self) -> float:
        """Phase of the drive after which the load repeats itself, rad: motions may begin later."""
        return 2.0 * math.pi / max(1, math.gcd(*self.harmonics))

    def forces(self) -> tuple[Floats, Integers, NDArray[np.complex128]]:
        """Return the harmonics of the load, its powers of the frequency, and amplitudes of forces.

        The latter have the shape (harmonic, dof); forces of one harmonic have one power.
        """
        others = () if self.frame is None else self.frame.harmonics
        return harmonic_forces(self.load, self.system.n, others)

    def slice(self, start: int, stop: int) -> Problem:
        """Return the problem of some of the frequencies."""
        return self.at(self.Omega[start:stop])

    def at(self, Omega: Floats) -> Problem:
        """Return the problem at other frequencies; the rest of it is checked already."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)  # a third of the time of copy.copy
        object.__setattr__(other, "Omega", np.ascontiguousarray(Omega, dtype=np.float64))
        other._check_frequencies()
        return other

    def _check_frequencies(self) -> None:
        Omega = self.Omega
        if Omega.ndim != 1 or Omega.size == 0:
            raise ModelError(("frequency",), "no frequency is given", code="empty_grid")
        least, largest = float(Omega.min()), float(Omega.max())
        if not (least > 0.0 and largest < math.inf):  # nan is neither
            message = "a frequency is not positive and finite"
            raise ModelError(("frequency",), message, code="frequency_not_positive")
        if not within_range(np.array([least, largest])):
            raise ModelError(("frequency",), "a frequency is out of range", code="out_of_range")
        if self.periods < 1:
            raise ModelError(("periods",), "there is at least one period", code="out_of_range")

    def _check_load(self) -> None:
        powers = dict[int, int]()
        for index, force in enumerate(self.load):
            if powers.setdefault(force.harmonic, force.power) != force.power:
                message = (
                    "another term of this harmonic depends on the drive's frequency in another way"
                )
                raise ModelError(("load", index), message, code="mixed_scales")
            for dof in force.dofs:
                if not 0 <= dof < self.system.n:
                    message = f"dof {dof} is none of 0 to {self.system.n - 1}: they count from 0"
                    raise ModelError(("load", index, "dof"), message, code="index_out_of_range")
            self._check_massless(index, force)
            if force.harmonic < 1:
                message = "the harmonic is below 1; a constant load belongs to the system"
                raise ModelError(("load", index, "harmonic"), message, code="out_of_range")
            numbers = (force.amplitude, force.phase, *force.weights)
            if not all(map(math.isfinite, numbers)) or len(force.weights) != len(force.dofs):
                message = "a load needs finite numbers, and one weight for each dof"
                raise ModelError(("load", index), message, code="not_finite")

    def _check_massless(self, index: int, force: Force) -> None:
        """Refuse a load that acts where there is no mass."""
        forces = np.zeros(self.system.n)
        for dof, weight in zip(force.dofs, force.weights, strict=False):
            forces[dof] = weight
        self.system.check_load(forces, ("load", index, "dof"))

    def _check_walls(self) -> None:
        """Refuse walls that move where stops are rigid, or beside what has no mass."""
        for index, constraint in enumerate(self.system.constraints):
            where = ("system", "constraints", index, "wall")
            if constraint.wall and constraint.law.rigid:
                message = f"walls move with linear stops only; constraint {index} is rigid"
                raise ModelError(where, message, code="not_possible")
            if constraint.wall and self.system.massless.size:
                message = "walls that move are computed where all degrees of freedom have mass"
                raise ModelError(where, message, code="not_possible")

    def _check_stops(self) -> None:
        """Refuse what is not computed with stops of finite stiffness."""
        constraints = self.system.constraints
        rigid = next((i for i, c in enumerate(constraints) if c.law.rigid), None)
        if rigid is not None:
            message = "rigid stops beside stops of finite stiffness are not computed yet"
            raise ModelError(("system", "constraints", rigid), message, code="not_possible")
        if not self.harmonics:
            message = "motions with linear stops are computed for driven structures: no load acts"
            raise ModelError(("load",), message, code="not_possible")
        if self.symmetric and len(self.harmonics) > 1:
            message = (
                "symmetric motions with linear stops are computed for loads of one harmonic: this "
                f"one has {len(self.harmonics)}"
            )
            raise ModelError(("load",), message, code="not_possible")
        for impact in self.impacts:
            law = constraints[impact.constraint].law
            if isinstance(law, Linear) and law.stiffness == 0.0 and not law.damping:
                message = "the stop has neither stiffness nor damping: there is no contact"
                pointer = ("system", "constraints", impact.constraint, "law", "stiffness")
                raise ModelError(pointer, message, code="no_force")

    def _check_sequence(self) -> None:
        constraints = self.system.constraints
        if isinstance(self.sequence, str):
            self._check_symmetric()
            return
        if not self.sequence:
            raise ModelError(("sequence",), "a sequence needs an impact", code="empty_sequence")
        for index, impact in enumerate(self.sequence):
            if not 0 <= impact.constraint < len(constraints):
                message = f"{impact.constraint} is not below the number of constraints"
                pointer = ("sequence", index, "constraint")
                raise ModelError(pointer, message, code="index_out_of_range")
            constraint = constraints[impact.constraint]
            if (constraint.upper if impact.side > 0 else constraint.lower) is None:
                message = f"constraint {impact.constraint} has no wall on that side"
                raise ModelError(("sequence", index, "side"), message, code="no_wall")
        if self.phases is not None:
            shape = np.shape(self.phases)
            if (
                len(shape) != 2
                or shape[1] != len(self.sequence)
                or not np.isfinite(self.phases).all()
            ):
                message = f"each start needs {len(self.sequence)} finite phases"
                raise ModelError(("start",), message, code="wrong_length")

    def _check_symmetric(self) -> None:
        system = self.system
        if self.sequence != SYMMETRIC:
            message = f"a sequence is a list of impacts, or {SYMMETRIC!r}"
            raise ModelError(("sequence",), message, code="unknown_choice")
        if not 0 <= self.constraint < len(system.constraints):
            message = f"{self.constraint} is not below the number of constraints"
            raise ModelError(("constraint",), message, code="index_out_of_range")
        if not system.constraints[self.constraint].symmetric:
            message = "symmetric motions need equal gaps at both walls"
            raise ModelError(("sequence",), message, code="not_symmetric")
        if system.loaded:
            message = "symmetric motions need a structure without a constant load"
            raise ModelError(("sequence",), message, code="not_symmetric")
        if any(harmonic * self.periods % 2 == 0 for harmonic in self.harmonics):
            message = (
                "symmetric motions need a load and walls that change sign after half a period: odd "
                "harmonics and an odd number of periods"
            )
            raise ModelError(("sequence",), message, code="not_symmetric")
