"""The linear structure between impacts: propagation, periodic impulse response, steady response.

The state is that of `kernels.flow`: pairs (z1, z2), one for each mode or pair of complex modes,
and linear forms on them. All functions take many times or frequencies at once; the last two axes
of states and forms are (2, pair).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.kernels.flow import Flow
from vibroimpact_solvers.kernels.propagators import propagators
from vibroimpact_solvers.time_history.basis import Basis

Complexes = NDArray[np.complex128]

_ROUNDINGS = 4.0 * EPS  # a product and a quotient of complex numbers, or a propagator


@dataclass(frozen=True, eq=False, slots=True)
class ImpulseResponse:
    """The response to one unit impulse per cell, periodic or antiperiodic.

    Parameters
    ----------
    after, before : array, shape (…, 2, pair)
        State just after the impulse, and that just before the next one, which an antiperiodic
        response has mirrored; both in the orientation of the impulse.
    error : array, shape (…, pair)
        Relative errors of the pairs.
    """

    after: Floats
    before: Floats
    error: Floats


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

    def impulse_response(
        self, cells: Floats, rests: Floats, sign: float, kick: Floats
    ) -> ImpulseResponse:
        """Return the response to one kick per cell: after = sign flow(cell) after + kick.

        Parameters
        ----------
        cells, rests : array, shape (cell,)
            Lengths, and what rounding took from them.
        sign : float
            1 for periodic, -1 for antiperiodic responses.
        kick : array, shape (2, pair)

        Returns
        -------
        ImpulseResponse
            Infinite where a pair repeats itself after the cell: a resonance, or a rigid body.
        """
        flow = self.propagators(cells, rests)
        after = np.zeros_like(flow)
        size = np.zeros((cells.size, self.alpha.size))
        even, odd = flow[:, 0], flow[:, 1]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            at = self.rotations
            one = 1.0 - sign * (even[:, at] + 1j * odd[:, at])
            w = (kick[0, at] - 1j * kick[1, at]) / one
            after[:, 0, at], after[:, 1, at] = w.real, -w.imag
            size[:, at] = 1.0 / np.abs(one)
            at = self.hyperbolas
            total, apart = kick[0, at] + kick[1, at], kick[0, at] - kick[1, at]
            total = total * _repeated(self.alpha[at] + self.nu[at], cells, sign)
            apart = apart * _repeated(self.alpha[at] - self.nu[at], cells, sign)
            after[:, 0, at], after[:, 1, at] = 0.5 * (total + apart), 0.5 * (total - apart)
            size[:, at] = np.maximum(
                np.abs(_repeated(self.alpha[at] + self.nu[at], cells, sign)),
                np.abs(_repeated(self.alpha[at] - self.nu[at], cells, sign)),
            )
            at = self.parabolas
            one = 1.0 - sign * even[:, at]
            after[:, 1, at] = kick[1, at] / one
            after[:, 0, at] = (kick[0, at] + sign * odd[:, at] * after[:, 1, at]) / one
            size[:, at] = 1.0 / np.abs(one)
            still = (kick == 0.0).all(axis=0)
            after[..., still] = 0.0
            before = sign * self.move(flow, after)
            decay = np.minimum(1.0, np.exp(self.growth * cells[:, np.newaxis]))
            rates = 2.0 * self.drift + EPS * np.abs(self.alpha)
            moved = _ROUNDINGS + rates * cells[:, np.newaxis]
            error = _ROUNDINGS + size * decay * moved
        return ImpulseResponse(after, before, np.where(still, 0.0, error))

    def steady_response(self, rates: Floats, load: Complexes) -> tuple[Complexes, Floats]:
        """Return the amplitudes of the steady response to ``load e^(i rate t)``, and errors.

        Parameters
        ----------
        rates : array, shape (rate,)
        load : array, shape (2, pair)
            Change of state per unit of time.

        Returns
        -------
        response : array, shape (rate, 2, pair)
        error : array, shape (rate, pair)
            Relative to the response.
        """
        s = rates[:, np.newaxis]
        d = 1j * s - self.alpha
        nu = self.nu
        first, second = d.copy(), d.copy()  # factors of the determinant, no differences lost
        at = self.rotations
        first[:, at] = -self.alpha[at] + 1j * (s + nu[at])
        second[:, at] = -self.alpha[at] + 1j * ((s - nu[at]) - self.rest[at])
        at = self.hyperbolas
        first[:, at] += nu[at]
        second[:, at] -= nu[at]
        there, back = nu.copy(), nu.copy()
        back[self.rotations] *= -1.0
        there[self.parabolas], back[self.parabolas] = 1.0, 0.0
        a, b = load[0], load[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            both = 1.0 / (first * second)
            response = np.stack([(d * a + there * b) * both, (d * b + back * a) * both], axis=-2)
            rounded = 2.0 * self.drift + 0.5 * EPS * np.abs(s)
            error = rounded * (1.0 / np.abs(first) + 1.0 / np.abs(second))
        still = (load == 0.0).all(axis=0)
        response[..., still] = 0.0
        return response, np.where(still, 0.0, error + 2.0 * _ROUNDINGS)


def _repeated(rates: Floats, cells: Floats, sign: float) -> Floats:
    """Return ``1 / (1 - sign e^(rate cell))``, shape (cell, rate)."""
    exponent = rates * cells[:, np.newaxis]
    return -1.0 / np.expm1(exponent) if sign > 0.0 else 1.0 / (1.0 + np.exp(exponent))
