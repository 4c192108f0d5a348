"""The linear structure between impacts: propagation, periodic impulse response, steady response.

The state is that of `kernels.flow`: pairs (z1, z2), one for each mode or pair of complex modes,
and linear forms on them. All functions take many times or frequencies at once; the last two axes
of states and forms are (2, pair).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import EPS, Booleans, Floats
from vibroimpact_solvers.kernels.flow import Flow
from vibroimpact_solvers.kernels.periodic import (
    Response,
    impulse_responses,
    seen_responses,
    steady_responses,
)
from vibroimpact_solvers.kernels.propagators import propagators
from vibroimpact_solvers.time_history.basis import Basis

Complexes = NDArray[np.complex128]


class Pairs:
    """The pairs of a structure without contacts.

    Parameters
    ----------
    basis : Basis
        Of a structure without harmonic loads, in which no mode drives another.
    """

    def __init__(self, basis: Basis) -> None:
        self.flow: Flow = basis.flow
        assert not self.flow.drives.size
        self.alpha, self.nu, self.rest = self.flow.alpha, self.flow.nu, self.flow.rest
        self.rotations = slice(0, self.flow.rotations)
        self.hyperbolas = slice(self.flow.rotations, self.flow.hyperbolas_end)
        self.parabolas = slice(self.flow.hyperbolas_end, None)
        self.drift = EPS * np.abs(basis.drifts).max(axis=0)
        """Absolute errors of the rates, shape (pair,)."""
        self.moving = basis.structural
        """Indices of the pairs that belong to modes; the others pad."""
        turning = np.arange(self.nu.size) < self.flow.hyperbolas_end
        self.speed = np.hypot(self.alpha, np.where(turning, self.nu, 0.0))
        """Moduli of the rates, shape (pair,)."""
        self.growth = self.alpha.copy()
        self.growth[self.hyperbolas] += self.nu[self.hyperbolas]

    def rates(self, some: Booleans) -> tuple[Floats, Floats]:
        """Return decays and moduli of all rates of some pairs of modes, (rate,) each."""
        own = self.moving[some[self.moving]]
        rotating = own[own < self.flow.rotations]
        real = own[own >= self.flow.rotations]
        apart = np.where(real < self.flow.hyperbolas_end, self.nu[real], 0.0)
        both = np.concatenate([self.alpha[real] + apart, self.alpha[real] - apart])
        return (
            np.concatenate([-self.alpha[rotating], -both]),
            np.concatenate([self.speed[rotating], np.abs(both)]),
        )

    def propagators(self, times: Floats, rests: Floats | None = None) -> Floats:
        """Return the even and odd numbers of the pairs at times, shape (time, 2, pair)."""
        out = np.empty((times.size, 2, self.alpha.size))
        propagators(self.flow, times, np.zeros(times.size) if rests is None else rests, out)
        return out

    def move(self, propagator: Floats, z: Floats | Complexes) -> Floats:
        """Return states after the times of the propagators; both broadcast."""
        even, odd = propagator[..., 0, :], propagator[..., 1, :]
        a, b = z[..., 0, :], z[..., 1, :]
        back = odd.copy()
        back[..., self.rotations] *= -1.0
        back[..., self.parabolas] = 0.0
        return np.stack([even * a + odd * b, even * b + back * a], axis=-2)

    def size(self, z: Floats) -> Floats:
        """Return what relative errors of pairs are relative to, of both numbers of each.

        A pair turns: its errors are those of its length, even where one of its numbers is small.
        """
        sizes = np.abs(z)
        at = self.rotations
        sizes[..., at] = np.hypot(z[..., 0, at], z[..., 1, at])[..., np.newaxis, :]
        at = self.hyperbolas
        sizes[..., at] = sizes[..., at].max(axis=-2, keepdims=True)
        return sizes

    def rate(self, z: Floats | Complexes) -> Floats:
        """Return the rates of states without loads."""
        a, b = z[..., 0, :], z[..., 1, :]
        there = self.nu.copy()
        there[self.parabolas] = 1.0
        back = self.nu.copy()
        back[self.rotations] *= -1.0
        back[self.parabolas] = 0.0
        return np.stack([self.alpha * a + there * b, self.alpha * b + back * a], axis=-2)

    def third_derivatives(self, forms: Floats) -> Floats:
        """Return bounds of third derivatives of forms by |z1| and |z2|, shape (form, 2, pair)."""
        f1, f2 = np.abs(forms[:, 0]), np.abs(forms[:, 1])
        size = np.zeros(forms.shape)
        at = self.rotations
        size[:, :, at] = (np.hypot(f1, f2) * self.speed**3)[:, np.newaxis, at]
        at = self.hyperbolas
        total = np.abs(forms.sum(axis=1))[:, at]
        apart = np.abs(forms[:, 0] - forms[:, 1])[:, at]
        size[:, :, at] = (
            0.5
            * (
                total * np.abs(self.alpha + self.nu)[at] ** 3
                + apart * np.abs(self.alpha - self.nu)[at] ** 3
            )[:, np.newaxis]
        )
        at = self.parabolas
        rate = np.abs(self.alpha)[at]
        size[:, 0, at] = f1[:, at] * rate**3
        size[:, 1, at] = 4.0 * f1[:, at] * rate**2 + f2[:, at] * rate**3
        return size

    def impulse_response(
        self, cells: Floats, rests: Floats, sign: float, kicks: Floats
    ) -> Response:
        """Return the responses to kicks, one per cell: after = sign flow(cell) after + kick.

        Parameters
        ----------
        cells, rests : array, shape (cell,)
            Lengths, and what rounding took from them.
        sign : float
            1 for periodic, -1 for antiperiodic responses.
        kicks : array, shape (kick, 2, pair)

        Returns
        -------
        Response
            Shape (cell, kick, …) each. Infinite where a pair repeats itself after the cell: a
            resonance, or a rigid body.
        """
        shape = cells.size, *kicks.shape
        values = Response(np.empty(shape), np.empty(shape), np.empty((*shape[:2], shape[3])))
        room = np.empty(kicks.shape[1:])
        impulse_responses(self.flow, self.drift, cells, rests, sign, kicks, room, values)
        return values

    def seen(self, position: Floats, velocity: Floats, r: Response, more: float) -> Floats:
        """Return a coordinate after impulses, its velocity before the next, and their errors.

        Rows are coordinate, error, velocity, error, shape (4, cell); `more` is the relative error
        of forms, (2, pair) each, and sums, beside that of the response, whose shape is (cell, …).
        """
        rows = np.empty((4, r.error.shape[0]))
        seen_responses(self.flow, position, velocity, r, more, rows)
        return rows

    def steady_response(self, rates: Floats, load: Complexes) -> tuple[Complexes, Floats]:
        """Return the amplitudes of the steady responses to each ``load e^(i rate t)``, and errors.

        Parameters
        ----------
        rates : array, shape (cell, load)
        load : array, shape (load, 2, pair)
            Changes of state per unit of time.

        Returns
        -------
        response : array, shape (cell, load, 2, pair)
        error : array, shape (cell, load, pair)
            Relative to the response.
        """
        response = np.empty((rates.shape[0], *load.shape), dtype=np.complex128)
        error = np.empty((*rates.shape, load.shape[-1]))
        steady_responses(self.flow, self.drift, rates, load, response, error)
        return response, error
