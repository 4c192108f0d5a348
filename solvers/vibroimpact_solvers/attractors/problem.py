"""The problem: a driven, damped structure, initial states, and how long motions are looked at."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import InitVar, dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np

from vibroimpact_solvers import periodic_motions, time_history
from vibroimpact_solvers.arrays import EPS, Floats, Integers
from vibroimpact_solvers.checks import check_indices, check_outputs
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.laws import require
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.periodic_motions import Force

KIND: Final = "attractors"
OUTPUTS: Final = ("section", "stability")
"""Beside the table of attractors, the sequences of impacts, and what each motion settles on."""
SECTIONS: Final = ("phase", "impacts")
TOLERANCE: Final = 1e-6
"""Where the problem names none."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What the motions of a driven structure settle on, from many initial states.

    Parameters
    ----------
    system : System
        With stops, and with damping or losses at them.
    Omega : array, shape (1,)
        Frequency of the drive, rad per unit of time.
    x, v : array, shape (motion, dof)
        Displacements and velocities at t = 0, the drive's phase 0.
    load : tuple of Force
        At least one; amplitudes may be zero.
    settle, observe : int
        Periods of the drive that are left out, and those looked at after them.
    longest : int
        Largest period, in periods of the drive, that is recognised.
    section : str
        Of `SECTIONS`: states at the drive's phase 0, or impacts.
    points : int
        Most points of the section of an attractor.
    outputs : frozenset of str
        The requested ones of `OUTPUTS`.
    dofs : array of int, optional
        Degrees of freedom of states and sections; None for all.
    tolerance : float, optional
        Distance of equal states relative to the amplitude; None: 1e-6.
    report : callable, optional
        Called while initial states are checked; may raise to end that.
    """

    system: System
    Omega: Floats
    x: Floats
    v: Floats
    load: tuple[Force, ...]
    settle: int = 200
    observe: int = 400
    longest: int = 16
    section: str = "phase"
    points: int = 200
    outputs: frozenset[str] = frozenset(OUTPUTS)
    dofs: Integers | None = None
    tolerance: float | None = None
    report: InitVar[Callable[[], None] | None] = None
    output_dofs: Integers = field(init=False)
    start: time_history.Start = field(init=False)
    """The first motion that is possible."""

    def __post_init__(self, report: Callable[[], None] | None) -> None:
        if np.size(self.Omega) == 1:
            load = tuple(force.at(float(np.ravel(self.Omega)[0])) for force in self.load)
            object.__setattr__(self, "load", load)
        dofs = np.arange(self.system.n) if self.dofs is None else np.asarray(self.dofs)
        object.__setattr__(self, "output_dofs", dofs.astype(np.int64))
        object.__setattr__(self, "outputs", frozenset(self.outputs))
        check_outputs(self.outputs, OUTPUTS)
        require(KIND, self.system.constraints)
        check_indices("dofs", self.output_dofs, self.system.n)
        self._check_structure()
        time_history.check_states(self.system, self.x, self.v)
        self._check_counts()
        limits = () if self.stopped else self.system.constraints
        start = time_history.first_start(limits, self.x, self.v, report)
        if start is None:
            time_history.refuse_all(self.motion)
        object.__setattr__(self, "start", start)
        self.pattern  # noqa: B018 (checks the rest of what all motions share)

    @property
    def stopped(self) -> bool:
        """Whether the stops have a finite stiffness."""
        return any(not constraint.law.rigid for constraint in self.system.constraints)

    @property
    def size(self) -> int:
        """Number of motions."""
        return int(self.x.shape[0])

    @property
    def period(self) -> float:
        """Period of the drive."""
        return 2.0 * math.pi / float(self.Omega[0])

    @property
    def close(self) -> float:
        """Distance of equal states, relative to the amplitude."""
        return TOLERANCE if self.tolerance is None else self.tolerance

    @property
    def rounding(self) -> float:
        """Error of states by the rounding of their times, and phases, relative to the amplitude."""
        return 4.0 * EPS * float(self.Omega[0]) * float(self.sections[-1])

    @property
    def length(self) -> float:
        """Largest gap or initial amplitude; motions much smaller than it are compared with it."""
        walls = [abs(w) for c in self.system.constraints for w in (c.lower, c.upper) if w]
        moved = float(np.abs(self.x).max()), float(np.abs(self.v).max()) / float(self.Omega[0])
        return max(*walls, *moved)

    @cached_property
    def sections(self) -> Floats:
        """Times of the drive's phase 0 from the end of `settle` to the end of `observe`."""
        return np.asarray(
            self.period * np.arange(self.settle, self.settle + self.observe + 1), np.float64
        )

    @cached_property
    def pattern(self) -> time_history.Problem:
        """The motion from the first initial state inside the limits; without, if none is."""
        system = self.system if self.start.inside else self.system.limited(())
        return self._motion(system, self.start.row)

    def motion(self, row: int) -> time_history.Problem:
        """Return the time history from an initial state.

        Raises
        ------
        ModelError
            Where it starts outside of the limits.
        """
        return self._motion(self.system, row)

    def _motion(self, system: System, row: int) -> time_history.Problem:
        try:
            return self._history(system, row)
        except ModelError as error:
            if error.pointer[0] not in {"t", "t_end"}:
                raise
            message = f"of the time of settle + observe periods, {error.message}"
            raise ModelError(("frequency",), message, code=error.code) from None

    def _history(self, system: System, row: int) -> time_history.Problem:
        return time_history.Problem(
            system,
            time_history.State(self.x[row], self.v[row]),
            float(self.sections[-1]),
            self.sections,
            None,
            frozenset({"x", "v", "impacts", "contacts"}),
            load=_harmonic(self.load, float(self.Omega[0])),
            estimate=False,
            contact_impulses=False,
        )

    def driven(
        self,
        periods: int = 1,
        sequence: tuple[periodic_motions.Impact, ...] | str = (),
        phases: Floats | None = None,
        constraint: int = 0,
    ) -> periodic_motions.Problem:
        """Return the problem of the periodic motions with a sequence of impacts.

        Stops of finite stiffness stand there as rigid ones, for the load and the frequency alone.
        """
        if not sequence:
            wall = next(
                (i, side)
                for i, c in enumerate(self.system.constraints)
                for side, at in ((1, c.upper), (-1, c.lower))
                if at is not None
            )
            sequence = (periodic_motions.Impact(*wall),)
        system = self.system
        if self.stopped:
            walls = [Constraint(c.dofs, c.weights, c.lower, c.upper) for c in system.constraints]
            system = replace(system, constraints=tuple(walls))
        return periodic_motions.Problem(
            system, self.Omega, self.load, periods, sequence, constraint, phases,
            outputs=frozenset({"exists", "stability"}),
        )  # fmt: skip

    def _check_structure(self) -> None:
        system = self.system
        if not system.constraints:
            message = "a structure without stops has one motion that all settle on: its response"
            raise ModelError(("system", "constraints"), message, code="no_constraint")
        damped = system.C is not None and bool(system.C.data.any())
        if not damped and not any(c.law.lossy for c in system.constraints):
            message = "without damping or losses at the stops no motion settles: no attractor"
            raise ModelError(("system", "C"), message, code="undamped")
        if not self.load:
            message = "without a harmonic load there is no drive, and motions come to rest"
            raise ModelError(("load",), message, code="no_load")
        if np.shape(self.Omega) != (1,):
            message = "the drive has one frequency: give one value, and sweep it"
            raise ModelError(("frequency",), message, code="shapes_differ")
        self.driven()  # checks the load and the frequency

    def _check_counts(self) -> None:
        for name, least in (("settle", 0), ("longest", 1), ("points", 1)):
            if getattr(self, name) < least:
                message = f"{getattr(self, name)} is below {least}"
                raise ModelError((name,), message, code="out_of_range")
        if self.observe < max(2 * self.longest, 8):
            message = (
                f"{self.observe} periods do not show periods of {self.longest}: look at "
                f"{max(2 * self.longest, 8)} or more"
            )
            raise ModelError(("observe",), message, code="out_of_range")
        if self.section not in SECTIONS:
            message = f"sections are {', '.join(SECTIONS)}"
            raise ModelError(("section",), message, code="unknown_choice")
        if self.tolerance is not None and not 1e-12 <= self.tolerance <= 1e-2:
            message = f"the tolerance is {self.tolerance!r}, not between 1e-12 and 1e-2"
            raise ModelError(("tolerance",), message, code="out_of_range")


def _harmonic(load: tuple[Force, ...], Omega: float) -> tuple[time_history.Harmonic, ...]:
    """Return the load as time histories take it."""
    return tuple(
        time_history.Harmonic(dof, force.amplitude * weight, force.harmonic * Omega, force.phase)
        for force in load
        for dof, weight in zip(force.dofs, force.weights, strict=True)
        if force.amplitude * weight != 0.0
    )
