"""Rates of the two-oscillator system: exact eq. 10.44, their averages and the truncated 10.46.

A rate ``F(tau) + G(tau) e`` has over a period of the phase the mean of F over -1 <= tau <= 1, as
e is as often 1 as -1 at every tau; only the part of F symmetric in tau contributes. With
D = pi^2 - 4 gamma^2:

    gamma' = zeta Omega0 (1 + sin(2 gamma)/(2 gamma)) tan(gamma)
             - (beta B/(Omega0 Delta)) 2 pi sin^2(gamma)/D
    phi'   = Omega0/gamma
             + (beta/(gamma Omega0)) (1/2 - sin^2(gamma)/(4 gamma^2) - tan(gamma)/(4 gamma))
             - (beta A/(Omega0 Delta)) (sin(gamma)/gamma)
               [(4/D)(gamma/cos(gamma) - sin(gamma)) - 32 gamma^2 sin(gamma)/D^2]
    A'     = -(Omega0 + beta/(2 Omega0) - (pi/2) phi') B
    B'     =  (Omega0 + beta/(2 Omega0) - (pi/2) phi') A - 4 beta Delta gamma cot(gamma)/(Omega0 D)

Times cos(gamma) they are regular at gamma = pi/2, where cos(gamma)/D is 1/(4 pi) and the bracket is
written in delta = pi/2 - gamma.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibroimpact_solvers.arrays import Floats

Rates = tuple[float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Coupled:
    """Parameters of eq. 10.42: Omega0, zeta, coupling beta and the distance of the walls."""

    Omega0: float
    zeta: float
    beta: float
    Delta: float

    @property
    def stiffness(self) -> Floats:
        """K of unit masses, shape (2, 2)."""
        own = self.Omega0**2 + self.beta
        return np.array([[own, -self.beta], [-self.beta, own]])

    def exact(self, tau: float, e: float, y: Floats) -> Rates:
        """Return the rates of (gamma, phi, A, B, t) in s, dt = cos(gamma) ds; eq. 10.44."""
        Omega0, gamma, A, B = self.Omega0, float(y[0]), float(y[2]), float(y[3])
        sine, cosine = math.sin(gamma), math.cos(gamma)
        s, c = math.sin(gamma * tau), math.cos(gamma * tau)
        s2, c2 = math.sin(0.5 * math.pi * tau), math.cos(0.5 * math.pi * tau)
        # f1 sin(gamma), so that gamma = 0 needs no care.
        x1 = self.Delta * s
        x2 = A * s2 + B * c2 * e
        coupling = self.beta * (x1 - x2 * sine)
        f1 = 2.0 * self.zeta * Omega0**2 * self.Delta * c * e + Omega0**2 * x1 + coupling
        f2 = Omega0**2 * x2 - self.beta * (x1 / sine - x2)
        scale = 1.0 / (Omega0 * self.Delta)
        gamma_rate = e * scale * c * (f1 - Omega0**2 * x1) * sine
        turn = s * cosine - tau * c * sine
        phase = c * (c * cosine + tau * s * sine)
        phi_rate = (f1 * turn + Omega0**2 * self.Delta * phase) * scale / gamma
        double, whole = math.sin(math.pi * tau), math.cos(math.pi * tau)
        A_rate = -0.5 * (Omega0 * (1.0 - whole) * cosine - math.pi * phi_rate) * B
        A_rate += (0.5 * Omega0 * A * double - f2 * c2 / Omega0) * e * cosine
        B_rate = 0.5 * (Omega0 * (1.0 + whole) * cosine - math.pi * phi_rate) * A
        B_rate += (f2 * s2 / Omega0 - 0.5 * e * Omega0 * B * double) * cosine
        return gamma_rate, phi_rate, A_rate, B_rate, cosine

    def averaged(self, tau: float, e: float, y: Floats) -> Rates:
        """Return the averages of the same rates over the phase."""
        Omega0, beta, Delta = self.Omega0, self.beta, self.Delta
        gamma, A, B = float(y[0]), float(y[2]), float(y[3])
        sine, cosine = math.sin(gamma), math.cos(gamma)
        delta = 0.5 * math.pi - gamma
        over = _sinc(delta) / (4.0 * (math.pi - delta))  # cos(gamma) / D
        gamma_rate = self.zeta * Omega0 * (1.0 + sine * cosine / gamma) * sine
        gamma_rate -= beta * B / (Omega0 * Delta) * 2.0 * math.pi * sine**2 * over
        flat = 0.5 * cosine - (sine * cosine / gamma + 1.0) * sine / (4.0 * gamma)
        phi_rate = (Omega0 * cosine + beta / Omega0 * flat) / gamma
        lag = _deficit(2.0 * delta) / delta if delta != 0.0 else 0.0
        bracket = lag * (0.5 * math.pi**2 + delta**2 - math.pi * delta) - 0.5 * math.pi
        bracket /= (math.pi - delta) ** 2
        phi_rate -= beta * A / (Omega0 * Delta) * sine / gamma * bracket
        slow = (Omega0 + 0.5 * beta / Omega0) * cosine - 0.5 * math.pi * phi_rate
        forced = 4.0 * beta * Delta / Omega0 * gamma * cosine / sine * over
        return gamma_rate, phi_rate, -slow * B, slow * A - forced, cosine

    def truncated(self, tau: float, e: float, y: Floats) -> Rates:
        """Return the rates of eq. 10.46 in t itself."""
        Omega0, beta, Delta = self.Omega0, self.beta, self.Delta
        gamma, A, B = float(y[0]), float(y[2]), float(y[3])
        part = (12.0 - math.pi**2) / math.pi**4
        gamma_rate = 2.0 * self.zeta * Omega0 * gamma
        gamma_rate -= 2.0 * beta / (math.pi * Omega0) * B / Delta * gamma**2
        phi_rate = Omega0 / gamma
        phi_rate -= 2.0 * beta / (45.0 * Omega0) * (1.0 - 60.0 * part * A / Delta) * gamma**3
        slow = Omega0 + 0.5 * beta / Omega0 - 0.5 * math.pi * phi_rate
        forced = 4.0 * beta * Delta / Omega0 * (part * gamma**2 / 3.0 + 1.0 / math.pi**2)
        return gamma_rate, phi_rate, -slow * B, slow * A - forced, 1.0


def _sinc(x: float) -> float:
    return 1.0 - x * x / 6.0 if abs(x) < 1e-4 else math.sin(x) / x


def _deficit(x: float) -> float:
    """Return 1 - sin(x)/x."""
    if abs(x) > 0.5:
        return 1.0 - math.sin(x) / x
    q = x * x
    return q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0 * (1.0 - q / 110.0))))
