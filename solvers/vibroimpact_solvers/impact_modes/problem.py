"""The problem: a family of impact modes, the frequencies, and the outputs."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.checks import check_indices, check_outputs, check_tolerance
from vibroimpact_solvers.derivatives import Parameter, check_parameters
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.laws import require
from vibroimpact_solvers.model import RANGE, Constraint, System, within_range

KIND: Final = "impact-modes"
OUTPUTS: Final = (
    "impulse",
    "exists",
    "reason",
    "shape",
    "waveform",
    "energy",
    "stability",
    "harmonics",
)

DISPLACEMENTS: Final = frozenset({"shape", "waveform", "harmonics"})
"""Outputs that are displacements of `Problem.output_dofs`."""

_SAMPLE: Final = 2**16
"""Frequencies by which plans estimate costs."""
_MOST_PRODUCTS: Final = 10**8
"""Products of numbers up to which active constraints are compared with one another."""


@dataclass(frozen=True, eq=False, slots=True)
class Frequencies:
    """Triangle-wave frequencies to more than double precision."""

    omega: Floats  # (frequency,)
    rounding: Floats  # relative rounding errors of omega, ``(exact - omega)/omega``, (frequency,)

    def __getitem__(self, chosen: Booleans) -> Frequencies:
        """Return some of the frequencies."""
        return Frequencies(self.omega[chosen], self.rounding[chosen])

    @property
    def size(self) -> int:
        """Number of frequencies."""
        return self.omega.size


@dataclass(frozen=True, eq=False)
class Problem:
    """Impact modes of one family at some frequencies.

    Parameters
    ----------
    system : System
        The structure; damping and coefficients of restitution are ignored, as impact modes are
        motions without energy loss.
    omega : array, shape (frequency,)
        Triangle-wave frequencies, rad per unit of time, positive; Omega = (pi/2) omega.
    active : tuple of int
        The constraints with impacts, at every wall they have; empty for all.
    outputs : frozenset of str
        The requested ones of `OUTPUTS`.
    dofs : array of int, optional
        Degrees of freedom of shape, waveform and harmonics; None for all.
    tau : array, optional
        Triangle-wave times of the waveform, in [-1, 1].
    tolerance : float, optional
        Largest relative error of the impulses: decides how many natural modes a partial spectrum
        keeps; the result tells which solutions meet it. None for full double precision.
    Omega : array, shape (frequency,), optional
        The fundamental frequencies where they are given instead of omega, kept to the last bit.
    highest_harmonic : int
        Largest multiple of Omega among the harmonics.
    rounding : array, shape (frequency,), optional
        Relative rounding errors of omega; absent: computed from Omega.
    parameters : tuple of Parameter
        By which the outputs are differentiated.
    """

    system: System
    omega: Floats
    active: tuple[int, ...] = ()
    outputs: frozenset[str] = frozenset({"impulse", "exists", "reason"})
    dofs: Integers | None = None
    tau: Floats | None = None
    tolerance: float | None = None
    Omega: Floats | None = None
    highest_harmonic: int = 9
    rounding: Floats | None = None
    parameters: tuple[Parameter, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.system.constraints)
        dofs = np.arange(self.system.n) if self.dofs is None else self.dofs
        omega = np.ascontiguousarray(self.omega, dtype=np.float64)
        Omega = 0.5 * np.pi * omega if self.Omega is None else self.Omega
        rounding = self.rounding
        if rounding is None and self.Omega is None:
            rounding = np.zeros(omega.size)
        tau = np.zeros(0) if self.tau is None else self.tau
        completed = {
            "active": tuple(self.active) or tuple(range(count)),
            "outputs": frozenset(self.outputs),
            "dofs": np.asarray(dofs, dtype=np.int64),
            "omega": omega,
            "Omega": np.ascontiguousarray(Omega, dtype=np.float64),
            "rounding": rounding,  # where it is missing, it is computed when it is needed
            "tau": np.ascontiguousarray(tau, dtype=np.float64),
        }
        for name, value in completed.items():
            object.__setattr__(self, name, value)
        self._check_frequencies()
        check_indices("active", np.array(self.active, dtype=np.int64), count)
        self._check_independence()
        check_indices("dofs", self.output_dofs, self.system.n)
        self._check_outputs()

    def _check_frequencies(self) -> None:
        if self.omega.ndim != 1 or self.omega.size == 0:
            raise ModelError(("frequency",), "no frequency is given", code="empty_grid")
        least, largest = float(self.omega.min()), float(self.omega.max())
        if not (least > 0 and largest < np.inf):  # nan is neither
            message = "a frequency is not positive and finite"
            raise ModelError(("frequency",), message, code="frequency_not_positive")
        # The ends tell: a plan of millions of frequencies takes no room for what it compares.
        if not within_range(np.array([least, largest])):
            message = f"a frequency is not between {RANGE[0]} and {RANGE[1]}"
            raise ModelError(("frequency",), message, code="out_of_range")
        if not self.system.constraints:
            message = "impact modes need a constraint"
            raise ModelError(("system", "constraints"), message, code="no_constraint")

    def _check_independence(self) -> None:
        """Refuse active constraints whose coordinates depend on each other to rounding."""
        if len(self.active) < 2:
            return
        dofs = sorted({dof for c in self.struck for dof, _ in c.coordinate})
        if len(dofs) == sum(len(c.coordinate) for c in self.struck):
            return  # none moves with another
        if len(dofs) * len(self.active) ** 2 > _MOST_PRODUCTS:
            message = (
                f"{len(self.active)} constraints that share degrees of freedom are too many to "
                "tell whether their coordinates depend on each other: make fewer active"
            )
            raise ModelError(("active",), message, code="too_many_constraints")
        rows = self.system.directions(self.active)[:, dofs]
        rows = rows / np.linalg.norm(rows, axis=1)[:, np.newaxis]
        if np.linalg.matrix_rank(rows) == len(self.active):
            return
        last = next(k for k in range(1, len(rows)) if np.linalg.matrix_rank(rows[: k + 1]) <= k)
        shares = np.abs(np.linalg.lstsq(rows[:last].T, rows[last], rcond=None)[0])
        others = [str(i) for i, share in zip(self.active, shares, strict=False) if share > 1e-9]
        message = (
            f"the coordinate of constraint {self.active[last]} is a combination of those of "
            f"constraints {', '.join(others)}: their impulses are not unique"
        )
        raise ModelError(("active",), message, code="dependent_constraints")

    def _check_outputs(self) -> None:
        check_outputs(self.outputs, OUTPUTS)
        require(KIND, self.system.constraints)
        if "waveform" in self.outputs and self.times.size == 0:
            message = "the waveform needs the triangle-wave times tau"
            raise ModelError(("tau",), message, code="missing_tau")
        if not (np.abs(self.times) <= 1.0).all():
            raise ModelError(("tau",), "tau is in [-1, 1]", code="tau_out_of_range")
        check_tolerance(self.tolerance)
        if self.parameters:
            check_parameters(self.parameters, self.system)
        if self.highest_harmonic < 0:
            message = "the highest harmonic is negative"
            raise ModelError(("highest_harmonic",), message, code="out_of_range")

    @property
    def neglected(self) -> list[str]:
        """A sentence about each part of the structure that has no effect."""
        return self.system.losses(self.active)

    @property
    def output_dofs(self) -> Integers:
        """Degrees of freedom of shape, waveform and harmonics, shape (dof,)."""
        assert self.dofs is not None
        return self.dofs

    @property
    def fundamental(self) -> Floats:
        """Fundamental frequencies Omega, shape (frequency,)."""
        assert self.Omega is not None
        return self.Omega

    @cached_property
    def sample(self) -> Floats:
        """Fundamental frequencies by which plans estimate costs, the extremes among them."""
        Omega = self.fundamental
        if Omega.size <= _SAMPLE:
            return Omega
        return np.append(Omega[:: -(-Omega.size // _SAMPLE)], [Omega.min(), Omega.max()])

    def total(self, values: Floats) -> float:
        """Return the sum over all frequencies of what is known at those of `sample`."""
        return float(values.sum()) * (self.omega.size / values.size)

    @property
    def times(self) -> Floats:
        """Triangle-wave times of the waveform, shape (tau,)."""
        assert self.tau is not None
        return self.tau

    @cached_property
    def struck(self) -> tuple[Constraint, ...]:
        """The active constraints."""
        return tuple(self.system.constraints[index] for index in self.active)

    def slice(self, start: int, stop: int) -> Problem:
        """Return the same problem at some of its frequencies."""
        some, piece = slice(start, stop), copy.copy(self)
        for name in ("omega", "Omega", "rounding"):
            values = getattr(self, name)
            object.__setattr__(piece, name, None if values is None else values[some])
        object.__setattr__(piece, "parameters", tuple(each.at(some) for each in self.parameters))
        piece.__dict__.pop("sample", None)
        return piece

    @property
    def frequencies(self) -> Frequencies:
        """The frequencies with their rounding errors."""
        if self.rounding is None:
            rounding = conversion_rests(self.fundamental, self.omega)
            object.__setattr__(self, "rounding", rounding)
        assert self.rounding is not None
        return Frequencies(self.omega, self.rounding)


_TURNS = 0.6366197723675814  # 2/pi, and what rounding took from it
_TURNS_LOW = -3.935735335036497e-17
_SPLIT = 2.0**27 + 1.0


def conversion_rests(Omega: Floats, omega: Floats) -> Floats:
    """Return the relative rounding error of omega, ``(2/pi Omega - omega)/omega``.

    Where both differ by more than rounding, omega is taken as exact and the error is 0. The
    product is the sum of two doubles (Veltkamp, Dekker): a plan must not wait for a compiler.
    """
    with np.errstate(all="ignore"):  # of frequencies that are refused afterwards
        unit, exponent = np.frexp(omega)
        scaled = np.ldexp(Omega, -exponent)
        product = scaled * _TURNS
        high, turns_high = _upper_half(scaled), _upper_half(_TURNS)
        low, turns_low = scaled - high, _TURNS - turns_high
        missing = ((high * turns_high - product) + high * turns_low + low * turns_high) + (
            low * turns_low
        )
        rest = (((product - unit) + missing) + scaled * _TURNS_LOW) / unit
        return np.where(np.abs(rest) < 1e-15, rest, 0.0)


def _upper_half(x: Any) -> Any:
    """Return the first 26 bits of a double's significand."""
    return x * _SPLIT - (x * _SPLIT - x)
