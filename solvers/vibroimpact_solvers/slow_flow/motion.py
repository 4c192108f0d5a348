"""The interface of all models of slow flows: initial values, motion, impacts, and `Model`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol, Self

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.model import System


@dataclass(frozen=True, slots=True)
class Initial:
    """Initial values at t = 0; each model names the fields that it takes.

    Parameters
    ----------
    gamma : float
        Frequency ratio gamma = Omega0 / omega (eq. 10.5); lambda of eq. 10.110.
    phi : float
        Phase of the triangle wave.
    A, B : float
        Amplitudes of the second mass (eq. 10.43), length.
    omega : float
        Triangle-wave frequency, 1/time.
    energy : float
        Total energy, mass length^2 / time^2.
    root : int
        Number of the root of eq. 10.10: k = root // 2, the sign + for even numbers, - for odd ones.
    x, v : float
        Displacement and velocity of the constrained mass.
    """

    gamma: float | None = None
    phi: float | None = None
    A: float | None = None
    B: float | None = None
    omega: float | None = None
    energy: float | None = None
    root: int | None = None
    x: float | None = None
    v: float | None = None


@dataclass(frozen=True, slots=True)
class Variant:
    """One description of a motion.

    Parameters
    ----------
    method, about : str
        Its method in two words, and what it is in a sentence.
    impact_flops : float
        Operations for one impact, of descriptions that follow the motion through them.
    """

    method: str
    about: str
    impact_flops: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class Motion:
    """A motion at given times; None where the model has no such quantity, or it is no output."""

    stage: Integers  # codes of `results.slow_flow.Stage`, (time,)
    phi: Floats | None = None  # phase of the triangle wave; nan after the last impact, (time,)
    # Frequency ratio and triangle-wave frequency, 1/time, (time,)
    gamma: Floats | None = None
    omega: Floats | None = None
    # Amplitudes of the second mass, length, (time,)
    A: Floats | None = None
    B: Floats | None = None
    # Displacement and velocity, (time, dof)
    x: Floats | None = None
    v: Floats | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Impacts:
    """The impacts of the exact motion, shapes (impact,)."""

    time: Floats
    velocity: Floats  # speed before the impact
    phi: Floats  # phase, an odd number
    gamma: Floats | None  # frequency ratio at the impact, from the energies before and after it


class Model(Protocol):
    """A system of the chapter with its parameters and initial values."""

    # The descriptions of its motion; "exact" is one of them
    VARIANTS: ClassVar[Mapping[str, Variant]]
    INITIAL: ClassVar[tuple[str, ...]]  # fields of `Initial` that it takes

    @classmethod
    def of(cls, system: System, initial: Initial, variant: str, until: float) -> Self:
        """Take the parameters from a system and initial values, for a variant at times to `until`.

        Raise `ModelError` where the system or the initial values are not those of this model.
        """

    def motion(self, variant: str, t: Floats, *, shapes: bool = True) -> Motion:
        """Return the motion at given times; without displacements unless `shapes`."""

    def impulse(self, motion: Motion) -> Floats | None:
        """Return the impulse parameter p along a motion; None where the model has none."""

    def impacts(self, until: float) -> Impacts:
        """Return the impacts of the exact motion at times 0 to `until`."""

    def duration(self, variant: str) -> float:
        """Return when the impacts end; never, unless a model says otherwise."""
        return math.inf

    def expected_impacts(self, until: float) -> float:
        """Return about how many impacts the exact motion has."""

    def exists(self) -> bool | None:
        """Whether the solution of a family is admissible; None where the model has no family."""
        return None
