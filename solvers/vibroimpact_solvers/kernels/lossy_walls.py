"""An oscillator between lossy walls: its slow flow in closed form, at many times at once.

Rows of ``out`` are gamma, phi, x/Delta and v/(Omega Delta); the last two only where `shapes`.
"""

from __future__ import annotations

import math

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.arctangent import log_tangent
from vibroimpact_solvers.kernels.jit import kernel
from vibroimpact_solvers.kernels.phases import sine_cosine
from vibroimpact_solvers.kernels.waves import fold

_LITTLE = 1e-4  # losses and changes of the clock, relative to it, up to which series are used


@kernel
def slow_flow(
    clock: Floats,
    start: int,
    stop: int,
    rows: Floats,
    y0: float,
    w0: float,
    kappa: float,
    second: bool,
    shapes: bool,
    out: Floats,
) -> None:
    """Evaluate ``tan(lambda) = tan(lambda0) exp(kappa phi/2)``, shape (4, time).

    Parameters
    ----------
    clock : array, shape (time,)
        ``Omega t``; phi = 0 and lambda = lambda0 at 0.
    start, stop : int
        The part to do.
    rows : array
        Of `arctangent.table`.
    y0, w0 : float
        Ti2(tan(lambda0)) and ln(tan(lambda0)).
    kappa : float
        -ln of the coefficient of restitution.
    second : bool
        Whether the time has its term of second order.
    shapes : bool
        Whether to fill in displacement and velocity, to the first order in kappa.
    """
    sine0 = 2.0 / (math.exp(w0) + math.exp(-w0))
    for i in range(start, stop):
        change = 0.5 * kappa * clock[i]
        if kappa < _LITTLE and abs(change) < _LITTLE * y0:
            gain = _small_gain(change, w0, kappa * kappa / 48.0 if second else 0.0)
            out[0, i] = math.atan(math.exp(w0 + gain))
            out[1, i] = 2.0 * gain / kappa
            if shapes:
                out[2, i] = math.exp(w0 + gain)
            continue
        y = y0 + change
        w = log_tangent(y, rows)
        if second:
            w = _corrected(y, w, kappa * kappa / 48.0, sine0, rows)
        z = math.exp(w)
        out[0, i] = math.atan(z)
        out[1, i] = 2.0 * (w - w0) / kappa
        if shapes:
            out[2, i] = z
    if shapes:
        _first_order(out, start, stop, kappa)


@kernel
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


@kernel
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


@kernel
def _first_order(out: Floats, start: int, stop: int, kappa: float) -> None:
    """Replace z = tan(lambda) by x/Delta and v/(Omega Delta): X0 + kappa Y1 e and its rate."""
    for i in range(start, stop):
        lam, z = out[0, i], out[2, i]
        tau, e = fold(out[1, i])
        s, c = sine_cosine(lam * tau, 0.0)
        cosine = 1.0 / math.sqrt(1.0 + z * z)
        over_z, over_lam, over_sine = 1.0 / z, 1.0 / lam, 1.0 / (z * cosine)
        bow = 0.5 * (1.0 + tau * tau)
        half = 0.5 * kappa * cosine
        y1 = half * (tau * s * over_z - bow * c)
        y1_slope = half * ((s * over_lam + tau * c) * over_z - tau * c * over_lam + bow * s)
        # lambda' dX0/dlambda, with lambda' = kappa Omega sin(2 lambda) / (4 lambda)
        drift = half * over_lam * (tau * c - s * over_z)
        out[2, i] = s * over_sine + y1 * e
        out[3, i] = c * over_sine * e + y1_slope + drift


@kernel
def printed_shapes(
    lam: Floats, phi: Floats, eps: float, start: int, stop: int, x: Floats, v: Floats
) -> None:
    """Evaluate x/Delta and v/(Omega Delta) as printed, eq. 10.113, 10.114 and 10.116."""
    for i in range(start, stop):
        g = lam[i]
        tau, e = fold(phi[i])
        s, c, sine, cosine = math.sin(g * tau), math.cos(g * tau), math.sin(g), math.cos(g)
        # dlambda/deta / (2 Omega cos(lambda)); the cosine itself vanishes at grazing.
        pull = 0.5 * eps * cosine / (1.0 + sine * cosine / g)
        x[i] = s / sine - pull * (c - tau * s * cosine / sine) * e
        v[i] = c / sine * e + pull * (tau * c * cosine / sine + s * cosine / (g * sine) + s)
