"""Solutions of a block of frequencies: phases and impulses of impacts, states between them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats, Integers
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.pairs import Complexes
from vibroimpact_solvers.periodic_motions.problem import Problem

PI: Final = np.longdouble("3.14159265358979323846264338327950288")
COINCIDENT: Final = 1e-12  # of the period: times within which impacts coincide


@dataclass(frozen=True, eq=False, slots=True)
class Cells:
    """The cells of the motions at some frequencies of the drive, in the basis' units.

    A cell is the period of the motion, or its first half where the second mirrors it.

    Parameters
    ----------
    Omega : array, shape (frequency,)
    length, rest : array, shape (frequency,)
        Length of the cell, and what rounding took from it.
    sign : float
        -1 where the next cell mirrors this one, else 1.
    steady : array, shape (frequency, harmonic, 2, pair), complex
        Amplitudes of the response to the load without impacts.
    steady_error : array, shape (frequency, harmonic, pair)
        Their relative errors.
    amplification : array, shape (frequency, harmonic)
        Factors of the load that depend on the frequency.
    """

    Omega: Floats
    length: Floats
    rest: Floats
    sign: float
    steady: Complexes
    steady_error: Floats
    amplification: Floats

    @classmethod
    def of(cls, driven: Driven, problem: Problem) -> Cells:
        """Return the cells of a problem's frequencies."""
        periods = 0.5 * problem.periods if problem.symmetric else float(problem.periods)
        wide = np.longdouble(driven.scale) * periods * 2 * PI / problem.Omega
        length = wide.astype(np.float64)
        Omega = problem.Omega / driven.scale
        rates = Omega[:, np.newaxis] * driven.harmonics
        steady, error = driven.pairs.steady_response(rates, driven.load)
        amplification = problem.Omega[:, np.newaxis] ** driven.powers
        if driven.powers.any():
            steady *= amplification[:, :, np.newaxis, np.newaxis]
            error += 4.0 * EPS
        return cls(
            Omega, length, (wide - length).astype(np.float64), -1.0 if problem.symmetric else 1.0,
            steady, error, amplification,
        )  # fmt: skip

    def at(self, chosen: Integers) -> Cells:
        """Return some of the cells."""
        return Cells(
            self.Omega[chosen], self.length[chosen], self.rest[chosen], self.sign,
            self.steady[chosen], self.steady_error[chosen], self.amplification[chosen],
        )  # fmt: skip

    def doubled(self) -> Cells:
        """Return the whole periods of which these are the halves."""
        return replace(self, length=2.0 * self.length, rest=2.0 * self.rest, sign=1.0)

    def unbounded(self) -> Booleans:
        """Return where the load drives a mode without damping at its own frequency, (cell,)."""
        return np.asarray(~np.isfinite(self.steady).all(axis=(1, 2, 3)))

    def steady_floor(self, driven: Driven) -> Floats:
        """Return what mixed modes add to the errors of both numbers, (cell, harmonic, pair).

        Most searches do not ask for it, and it takes longer than the response itself.
        """
        rates = self.Omega[:, np.newaxis] * driven.harmonics
        factors = self.amplification[:, :, np.newaxis]
        unit = self.steady / factors[..., np.newaxis]
        return driven.mixing.of_steady(rates, driven.load, unit) * factors

    def seen_error(self, driven: Driven, forms: Floats, doubts: Floats, more: float) -> Floats:
        """Return errors of forms of the steady responses, shape (cell, harmonic, form).

        forms have shape (form, 2, pair), `doubts`, their absolute errors by mixed modes,
        (form, pair); `more` is their relative error, and that of sums.
        """
        moduli, relative = np.abs(self.steady), self.steady_error + more
        error = np.einsum("isj,fhsj,fhj->fhi", np.abs(forms), moduli, relative)
        if driven.mixing:
            lengths = np.linalg.norm(moduli, axis=2)
            error += np.where(np.isfinite(lengths), lengths, 0.0) @ doubts.T
            error += self.steady_floor(driven) @ np.linalg.norm(forms, axis=1).T
        return np.asarray(error)

    def load_state(self, driven: Driven, phases: Floats) -> Floats:
        """Return the response to the load at phases of the drive, shape (cell, …, 2, pair).

        phases has shape (cell, …).
        """
        turned = np.exp(1j * phases[..., np.newaxis] * driven.harmonics)
        return np.asarray(np.einsum("f...h,fhsj->f...sj", turned, self.steady).real)


@dataclass(frozen=True, eq=False, slots=True)
class Solutions:
    """Solutions with m impacts per cell, m free motions after them; one free motion where m is 0.

    Parameters
    ----------
    index : array of int, shape (solution,)
        The frequency.
    phase : array, shape (solution, impact)
        Omega t of the impacts; the first is in [0, 2 pi).
    impulse : array, shape (solution, impact)
        Along the constraint's coordinate, in the basis' units.
    velocity : array, shape (solution, impact)
        Of the coordinate before the impact.
    state : array, shape (solution, free motion, 2, pair)
        Response to all impulses, just after each impact.
    length : array, shape (solution, free motion)
        Of the free motions.
    phase_error, impulse_error, velocity_error : array, shape (solution, impact)
    state_error : array, shape (solution, pair)
        Errors of the pairs of the state, relative to them.
    common_error : array, shape (solution,)
        Relative error that all pairs of the state have in common with the impulse, where there
        is one.
    state_floor : array, shape (solution, pair)
        Absolute errors of both numbers of pairs besides; empty where modes are not mixed.
    """

    index: Integers
    phase: Floats
    impulse: Floats
    velocity: Floats
    state: Floats
    length: Floats
    phase_error: Floats
    impulse_error: Floats
    velocity_error: Floats
    state_error: Floats
    common_error: Floats
    state_floor: Floats

    @property
    def whole_error(self) -> Floats:
        """Return both errors of the pairs of the state, shape (solution, pair)."""
        return self.state_error + self.common_error[:, np.newaxis]

    def seen_error(self, forms: Floats, doubts: Floats) -> Floats:
        """Return errors of forms of states by mixed modes, shape (solution, free motion, form)."""
        if not self.state_floor.size:
            return np.zeros((*self.length.shape, len(forms)))
        error = np.linalg.norm(self.state, axis=2) @ doubts.T
        error += (self.state_floor @ np.linalg.norm(forms, axis=1).T)[:, np.newaxis]
        return np.asarray(error)

    def at(self, chosen: Integers) -> Solutions:
        """Return some of the solutions."""
        return Solutions(*(getattr(self, field.name)[chosen] for field in fields(self)))


def time_between(later: Floats, earlier: Floats, order: Booleans, period: Floats) -> Floats:
    """Return the times from impacts to others within a period.

    Of two that coincide up to rounding, that which is listed first strikes first (`order`: the
    later one is the second): it is 0 from the first to the second, and a period back.
    """
    apart = np.mod(later - earlier, period)
    close = np.minimum(apart, period - apart) <= COINCIDENT * period
    return np.where(close, np.where(order, 0.0, period), apart)


def without_impacts(cells: Cells) -> Solutions:
    """Return the linear responses."""
    count, pairs = cells.Omega.size, cells.steady.shape[-1]
    none = np.zeros((count, 0))
    return Solutions(
        np.arange(count), none, none, none, np.zeros((count, 1, 2, pairs)),
        cells.length[:, np.newaxis], none, none, none, np.full((count, pairs), 2.0 * EPS),
        np.zeros(count), np.zeros((count, 0)),
    )  # fmt: skip
