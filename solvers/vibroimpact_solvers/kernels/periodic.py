"""Periodic responses of the pairs of a structure (`kernels.flow`): to impulses and to loads."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.kernels.flow import EVEN, ODD, Z1, Z2, Flow, set_propagator
from vibroimpact_solvers.kernels.jit import bare, inline, inner, sums

Complexes = NDArray[np.complex128]

ROUNDINGS: Final = 4.0 * EPS
"""Relative error of a product and a quotient of complex numbers, or of a propagator."""


class Response(NamedTuple):
    """The response to one unit impulse per cell."""

    after: Floats  # (…, 2, pair): just after the impulse
    before: Floats  # (…, 2, pair): before the next one, mirrored where the response is
    error: Floats  # (…, pair): relative errors of the pairs


@inline
def _repeated(exponent: float, sign: float) -> float:
    """Return ``1 / (1 - sign e^exponent)``."""
    return -1.0 / math.expm1(exponent) if sign > 0.0 else 1.0 / (1.0 + math.exp(exponent))


@inner
def _set_response(
    flow: Flow,
    drift: Floats,
    cell: float,
    sign: float,
    kick: Floats,
    propagator: Floats,
    r: Response,
) -> None:
    """Fill in the response to one kick per cell."""
    alpha, nu = flow.alpha, flow.nu
    even, odd, after, before, error = propagator[EVEN], propagator[ODD], r.after, r.before, r.error
    for j in range(flow.rotations):
        x, y = 1.0 - sign * even[j], -sign * odd[j]
        length = x * x + y * y
        after[Z1, j] = (kick[Z1, j] * x - kick[Z2, j] * y) / length
        after[Z2, j] = (kick[Z1, j] * y + kick[Z2, j] * x) / length
        decay = math.sqrt(even[j] * even[j] + odd[j] * odd[j])
        error[j] = min(1.0, decay) / math.sqrt(length)
    for j in range(flow.rotations, flow.hyperbolas_end):
        plus = _repeated((alpha[j] + nu[j]) * cell, sign)
        minus = _repeated((alpha[j] - nu[j]) * cell, sign)
        total, apart = (kick[Z1, j] + kick[Z2, j]) * plus, (kick[Z1, j] - kick[Z2, j]) * minus
        after[Z1, j], after[Z2, j] = 0.5 * (total + apart), 0.5 * (total - apart)
        error[j] = min(1.0, even[j] + odd[j]) * max(abs(plus), abs(minus))
    for j in range(flow.hyperbolas_end, alpha.size):
        one = 1.0 - sign * even[j]
        after[Z2, j] = kick[Z2, j] / one
        after[Z1, j] = (kick[Z1, j] + sign * odd[j] * after[Z2, j]) / one
        error[j] = min(1.0, even[j]) / abs(one)
    for j in range(alpha.size):
        a, b = after[Z1, j], after[Z2, j]
        back = odd[j] if j < flow.hyperbolas_end else 0.0
        back = -back if j < flow.rotations else back
        there, back = even[j] * a + odd[j] * b, even[j] * b + back * a
        moved = ROUNDINGS + (2.0 * drift[j] + EPS * abs(alpha[j])) * cell
        still = kick[Z1, j] == 0.0 and kick[Z2, j] == 0.0
        before[Z1, j] = 0.0 if still else sign * there
        before[Z2, j] = 0.0 if still else sign * back
        after[Z1, j] = 0.0 if still else a
        after[Z2, j] = 0.0 if still else b
        error[j] = 0.0 if still else ROUNDINGS + error[j] * moved


@bare
def impulse_responses(
    flow: Flow,
    drift: Floats,
    cells: Floats,
    rests: Floats,
    sign: float,
    kicks: Floats,
    propagator: Floats,
    r: Response,
) -> None:
    """Fill in the responses to kicks, one per cell: after = sign flow(cell) after + kick.

    Parameters
    ----------
    flow : Flow
    drift : array, shape (pair,)
        Errors of the rates.
    cells, rests : array, shape (cell,)
        Lengths, and what rounding took from them.
    sign : float
        1 for periodic, -1 for antiperiodic responses.
    kicks : array, shape (kick, 2, pair)
    propagator : array, shape (2, pair)
        Room.
    r : Response
        Shape (cell, kick, …) each; infinite where a pair repeats itself after the cell.
    """
    for k in range(cells.size):
        set_propagator(flow, cells[k], rests[k], propagator)
        for i in range(kicks.shape[0]):
            response = Response(r.after[k, i], r.before[k, i], r.error[k, i])
            _set_response(flow, drift, cells[k], sign, kicks[i], propagator, response)


@sums
def _seen(flow: Flow, form: Floats, z: Floats, error: Floats, more: float) -> tuple[float, float]:
    """Return a form of a state and its error, those of the pairs being relative to their sizes."""
    value, doubt = 0.0, 0.0
    for j in range(flow.alpha.size):
        a, b, f, g = z[Z1, j], z[Z2, j], form[Z1, j], form[Z2, j]
        value += f * a + g * b
        a, b = abs(a), abs(b)
        largest = max(a, b)
        # A pair that turns has the error of its length, both of a growing one that of the larger.
        size = max(math.sqrt(a * a + b * b), largest) if j < flow.rotations else largest
        apart = j >= flow.hyperbolas_end
        first, second = a if apart else size, b if apart else size
        doubt += (abs(f) * first + abs(g) * second) * (error[j] + more)
    return value, doubt


@bare
def seen_responses(
    flow: Flow, position: Floats, velocity: Floats, r: Response, more: float, seen: Floats
) -> None:
    """Fill in the coordinate after an impulse and its velocity before the next, with errors.

    Parameters
    ----------
    flow : Flow
    position, velocity : array, shape (2, pair)
        Forms.
    r : Response
        Shape (cell, …) each.
    more : float
        Relative error of forms and sums.
    seen : array, shape (4, cell)
        Coordinate, its error, velocity, its error.
    """
    y, y_error, v, v_error = seen
    for k in range(r.error.shape[0]):
        y[k], y_error[k] = _seen(flow, position, r.after[k], r.error[k], more)
        v[k], v_error[k] = _seen(flow, velocity, r.before[k], r.error[k], more)


@bare
def steady_responses(
    flow: Flow, drift: Floats, rates: Floats, load: Complexes, response: Complexes, error: Floats
) -> None:
    """Fill in the amplitudes of the steady responses to each ``load e^(i rate t)``.

    Parameters
    ----------
    flow : Flow
    drift : array, shape (pair,)
        Errors of the rates of the pairs.
    rates : array, shape (cell, load)
    load : array, shape (load, 2, pair)
        Changes of state per unit of time.
    response : array, shape (cell, load, 2, pair)
    error : array, shape (cell, load, pair)
        Relative to the response.
    """
    alpha, nu = flow.alpha, flow.nu
    for place in range(rates.size):
        k, h = divmod(place, load.shape[0])
        s = rates[k, h]
        for j in range(alpha.size):
            # Factors of the determinant, no differences lost: each is a number less i times one.
            real, apart, first, second = -alpha[j], 0.0, s, s
            there, back = 1.0, 0.0
            if j < flow.rotations:
                first, second = s + nu[j], (s - nu[j]) - flow.rest[j]
                there, back = nu[j], -nu[j]
            elif j < flow.hyperbolas_end:
                apart = nu[j]
                there, back = nu[j], nu[j]
            one, other = real + apart, real - apart
            size, other_size = one * one + first * first, other * other + second * second
            both = complex(one / size, -first / size) * complex(
                other / other_size, -second / other_size
            )
            a, b, d = load[h, Z1, j], load[h, Z2, j], complex(real, s)
            response[k, h, Z1, j] = (d * a + there * b) * both
            response[k, h, Z2, j] = (d * b + back * a) * both
            rounded = 2.0 * drift[j] + 0.5 * EPS * abs(s)
            error[k, h, j] = rounded * (1.0 / math.sqrt(size) + 1.0 / math.sqrt(other_size))
            error[k, h, j] += 2.0 * ROUNDINGS
            if a == 0.0 and b == 0.0:
                response[k, h, Z1, j] = response[k, h, Z2, j] = error[k, h, j] = 0.0
