"""An oscillator between lossy walls: its slow flow in closed form, at many times at once.

With the frequency ratio ``lambda = omega0/omega`` the averaged equation has the solution

    tan(lambda) = tan(lambda0) exp(kappa phi/2),    Ti2(tan(lambda)) = Ti2(tan(lambda0)) + kappa t/2

with kappa = -ln(restitution), t in units of 1/Omega and the inverse tangent integral Ti2
(`arctangent`, relative error about 1e-15). With the term of second order the left side of the
latter is ``Ti2 - kappa^2/48 sin(2 lambda)``. Displacement and velocity are those of the elastic
motion with lambda as it changes, eq. 10.113-10.116, and their first-order correction in kappa.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.arctangent import log_tangent
from vibroimpact_solvers.kernels.jit import inner, kernel
from vibroimpact_solvers.kernels.phases import sine_cosine
from vibroimpact_solvers.kernels.waves import fold

_LITTLE = 1e-4  # losses and changes of the clock, relative to it, up to which series are used


class Clock(NamedTuple):
    """The law of the frequency ratio, ``Ti2(tan(lambda)) = Ti2(tan(lambda0)) + kappa t/2``."""

    rows: Floats  # of `arctangent.table`
    y0: float  # Ti2(tan(lambda0))
    w0: float  # ln(tan(lambda0))
    kappa: float  # -ln of the coefficient of restitution
    second: bool  # whether the time has its term of second order


class SlowFlow(NamedTuple):
    """The motion at some times, each (time,)."""

    gamma: Floats  # the frequency ratio lambda
    phi: Floats
    # x/Delta and v/(Omega Delta), to the first order in kappa; empty if they are not wanted
    x: Floats
    v: Floats


@kernel
def slow_flow(time: Floats, clock: Clock, into: SlowFlow) -> None:
    """Evaluate ``tan(lambda) = tan(lambda0) exp(kappa phi/2)``.

    Parameters
    ----------
    time : array, shape (time,)
        ``Omega t``; phi = 0 and lambda = lambda0 at 0.
    clock : Clock
    into : SlowFlow
        Receives the motion.
    """
    y0, w0, kappa, part = clock.y0, clock.w0, clock.kappa, 0.0
    sine0 = 2.0 / (math.exp(w0) + math.exp(-w0))
    if clock.second:
        part = kappa * kappa / 48.0
    for i in range(time.size):
        change = 0.5 * kappa * time[i]
        if kappa < _LITTLE and abs(change) < _LITTLE * y0:
            gain = _small_gain(change, w0, part)
        else:
            y = y0 + change
            gain = log_tangent(y, clock.rows)
            if clock.second:
                gain = _corrected(y, gain, part, sine0, clock.rows)
            gain -= w0
        z = math.exp(w0 + gain)
        into.gamma[i], into.phi[i] = math.atan(z), 2.0 * gain / kappa
        if into.x.size > 0:
            into.x[i] = z
    if into.x.size > 0:
        _first_order(into, kappa)


@inner
def _small_gain(change: float, w0: float, part: float) -> float:
    """Return ln(tan lambda) - w0 after a small change of Ti2, its Taylor series.

    The difference of two logarithms loses as many digits as the losses are small.
    """
    lam = math.atan(math.exp(w0))
    s, c = 0.5 * math.sin(2.0 * lam), math.cos(2.0 * lam)
    # d w/d y = 1/lambda, d lambda/d y = s/lambda.
    change *= 1.0 + 2.0 * part * c * s / lam
    second = -s / lam**3
    third = (3.0 * s / lam - c) * s / lam**4
    return change * (1.0 / lam + change * (0.5 * second + change * third / 6.0))


@inner
def _corrected(y: float, w: float, part: float, sine0: float, rows: Floats) -> float:
    """Solve ``Y - part sin(2 lambda(Y)) = y - part sine0`` by Newton's method; return w(Y).

    ``sin(2 lambda) = 1/cosh(w)`` with w = ln(tan(lambda)) and dw/dY = 1/lambda.
    """
    moved = y
    for _ in range(20):
        lam, cosh = math.atan(math.exp(w)), math.cosh(w)
        rest = moved - y - part * (1.0 / cosh - sine0)
        step = rest / (1.0 + part * math.tanh(w) / (cosh * lam))
        if abs(step) < 1e-8:
            return w - step / lam
        moved -= step
        w = log_tangent(moved, rows)
    return w


@inner
def _first_order(motion: SlowFlow, kappa: float) -> None:
    """Replace z = tan(lambda) by x/Delta and v/(Omega Delta): X0 + kappa Y1 e and its rate."""
    for i in range(motion.x.size):
        lam, z = motion.gamma[i], motion.x[i]
        tau, e = fold(motion.phi[i])
        s, c = sine_cosine(lam * tau, 0.0)
        cosine = 1.0 / math.sqrt(1.0 + z * z)
        over_z, over_lam, over_sine = 1.0 / z, 1.0 / lam, 1.0 / (z * cosine)
        bow = 0.5 * (1.0 + tau * tau)
        half = 0.5 * kappa * cosine
        y1 = half * (tau * s * over_z - bow * c)
        y1_slope = half * ((s * over_lam + tau * c) * over_z - tau * c * over_lam + bow * s)
        # lambda' dX0/dlambda, with lambda' = kappa Omega sin(2 lambda) / (4 lambda)
        drift = half * over_lam * (tau * c - s * over_z)
        motion.x[i] = s * over_sine + y1 * e
        motion.v[i] = c * over_sine * e + y1_slope + drift


@kernel
def printed_shapes(lam: Floats, phi: Floats, eps: float, x: Floats, v: Floats) -> None:
    """Evaluate x/Delta and v/(Omega Delta) as printed, eq. 10.113, 10.114 and 10.116."""
    for i in range(lam.size):
        g = lam[i]
        tau, e = fold(phi[i])
        s, c, sine, cosine = math.sin(g * tau), math.cos(g * tau), math.sin(g), math.cos(g)
        # dlambda/deta / (2 Omega cos(lambda)); the cosine itself vanishes at grazing.
        pull = 0.5 * eps * cosine / (1.0 + sine * cosine / g)
        x[i] = s / sine - pull * (c - tau * s * cosine / sine) * e
        v[i] = c / sine * e + pull * (tau * c * cosine / sine + s * cosine / (g * sine) + s)
