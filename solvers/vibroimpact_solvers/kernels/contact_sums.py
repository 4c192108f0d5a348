"""What a contact phase sums up over a free motion: impulse, largest force, indentation, loss.

The indentation is followed by its Taylor polynomials, whose remainder is bounded: they give the
deepest indentation, the largest force, the impulse, and the integral of the squared rate, which
times c is the loss in the dashpot.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.contact_phases import LASTING, NONE, Phases, error_of
from vibroimpact_solvers.kernels.deviations import EPS
from vibroimpact_solvers.kernels.flow import (
    Z1,
    Z2,
    bound,
    derivatives,
    magnitude,
    propagate_state,
    set_lengths,
    set_propagator,
)
from vibroimpact_solvers.kernels.jit import inline, inner, never_inlined, once
from vibroimpact_solvers.kernels.passages import ORDER, horizon, remainder
from vibroimpact_solvers.kernels.rigid_state import Scratch, Structure
from vibroimpact_solvers.kernels.stopped_scenes import Scenes

_ROUNDED = 8.0  # roundings of sums over a contact
_FINE = 2.0**-54  # remainder of a polynomial of the indentation, relative to its largest value
_LONGEST = 1e300
_NODES = 8  # parts of a step at whose ends a maximum is looked for
_NEWTON = 8  # steps towards it
_STEP = 1000  # nanoseconds of a step, and
_STEP_OF_PAIR = 40


@inner
def _largest(c: Floats, order: int, r: float) -> float:
    """Return the largest value in [-r, r] of the polynomial ``sum c_n t^n`` of some degree."""
    never_inlined()
    first, last, bends, power = 0.0, 0.0, 0.0, 1.0
    for n in range(order, -1, -1):
        first, last = c[n] - first * r, c[n] + last * r
    for n in range(2, order + 1):
        power *= r
        bends += n * abs(c[n]) * power
    best = max(first, last)
    if bends < abs(c[1]):
        return best  # it rises or falls all the way
    at = -r if first > last else r
    for part in range(1, _NODES):
        t, value = r * (2 * part - _NODES) / _NODES, 0.0
        for n in range(order, -1, -1):
            value = value * t + c[n]
        if value > best:
            best, at = value, t
    t = at
    for _ in range(_NEWTON):
        value, slope, bend = 0.0, 0.0, 0.0
        for n in range(order, -1, -1):
            bend = bend * t + 2.0 * slope
            slope = slope * t + value
            value = value * t + c[n]
        best = max(best, value)
        if bend >= 0.0:
            break
        t = min(max(t - slope / bend, -r), r)
    return best


@inline
def _square(c: Floats, r: float) -> float:
    """Return the integral over [-r, r] of the square of the rate of ``sum c_n t^n``."""
    total = 0.0
    for m in range(ORDER - 1, 0, -1):
        inside = 0.0
        for n in range(ORDER - 1, 0, -1):
            odd = (m + n) % 2 == 1  # powers that cancel
            inside = inside * r + (0.0 if odd else n * c[n] / (m + n - 1.0))
        total = total * r + m * c[m] * inside
    return 2.0 * r * total


@inline
def _add_step(contact: Any, c: Floats, law: tuple[float, float], r: float, scale: float) -> None:
    """Add a polynomial of the indentation over [-r, r] to a phase; damping by the basis' time."""
    stiffness, damping = law
    contact.indentation = max(contact.indentation, _largest(c, ORDER - 1, r))
    if damping == 0.0:
        contact.peak_force = max(contact.peak_force, stiffness * contact.indentation)
    total, square = 0.0, r * r
    for n in range(ORDER - 2, -1, -2):
        total = total * square + stiffness * c[n] / (n + 1.0)
    if damping > 0.0:
        rise = 0.0
        for n in range(ORDER - 1, 0, -2):
            rise = rise * square + c[n]
        total += damping * rise  # the change of the indentation, over 2 r
        contact.square += _square(c, r)
    contact.impulse += 2.0 * r * total / scale


class Passed(NamedTuple):
    """A free motion that phases are summed up over; arrays have shape (2, pair)."""

    begin: Floats  # the state at its beginning
    largest: Floats  # magnitudes at its beginning or its end, the larger ones
    spread: Floats  # the same of its deviations
    after: Floats  # those at its end


@once
def _follow_indentation(
    prepared: Scenes, structure: Structure, place: int, contact: Any, scratch: Scratch,
    passed: Passed, given: tuple[float, float, float, int],
) -> float:  # fmt: skip
    """Follow an indentation from a time of the free motion on; return the time that is reached.

    Parameters
    ----------
    given : tuple
        That time, the duration of the motion, the magnitude of the indentation, and the work after
        which another call goes on.
    """
    t, span, size, budget = given
    flow, watched, a, side = structure.flow, structure.watched, contact.constraint, contact.side
    scale, piece = prepared.scale, scratch.piece[0]
    stiffness, damping = prepared.laws[a].stiffness, prepared.laws[a].damping * scale
    level = prepared.stops[place, a].indentation
    longest = min(prepared.scenes[place].longest, _LONGEST)
    d, c, f = scratch.derivatives, scratch.roots[Z1], scratch.roots[Z2]
    begun = t
    while t < span and (t == begun or piece.work < budget):
        piece.work += _STEP + _STEP_OF_PAIR * scratch.z.shape[1]
        set_propagator(flow, t, 0.0, scratch.propagator)
        propagate_state(flow, scratch.propagator, t, passed.begin, scratch.z)
        set_lengths(flow, scratch.z, scratch.lengths)
        ahead = min(span - t, longest)
        B = bound(flow, watched, a, scratch.z, scratch.lengths, True, ahead)
        h = min(2.0 * horizon(B, _FINE * size), ahead)
        h = h if t + h > t else span - t
        # Expanded in the middle, a polynomial lasts twice as long.
        r = 0.5 * h
        set_propagator(flow, t + r, 0.0, scratch.propagator)
        propagate_state(flow, scratch.propagator, t + r, passed.begin, scratch.z)
        derivatives(flow, watched.coordinate[a], scratch.z, d)
        power = 1.0
        for n in range(ORDER):
            c[n] = side * d[n] * power
            power /= n + 1.0
        c[0] += level
        _add_step(contact, c, (stiffness, damping), r, scale)
        if damping > 0.0:
            for n in range(ORDER - 1):
                f[n] = stiffness * c[n] + damping * (n + 1.0) * c[n + 1]
            contact.peak_force = max(contact.peak_force, _largest(f, ORDER - 2, r))
        less = remainder(B, r)
        contact.left_out = max(contact.left_out, less)
        contact.rate_left_out = max(contact.rate_left_out, ORDER * less / r)
        t += h
    return float(t)


@inline
def _add_errors(
    prepared: Scenes, structure: Structure, place: int, contact: Any, passed: Passed, span: float
) -> None:
    """Add what a phase loses in a free motion that is summed up, and the errors of its sums."""
    a, scale = contact.constraint, prepared.scale
    k, c, stop = prepared.laws[a].stiffness, prepared.laws[a].damping, prepared.stops[place, a]
    forms, slopes = structure.watched.coordinate, structure.watched.velocity
    contact.energy_lost += c * scale * contact.square
    off = error_of(forms[a], passed.spread) + _ROUNDED * EPS * magnitude(forms[a], passed.largest)
    fast = error_of(slopes[a], passed.spread)
    fast += _ROUNDED * EPS * magnitude(slopes[a], passed.largest)
    force = error_of(forms[stop.force], passed.spread)
    force += _ROUNDED * EPS * magnitude(forms[stop.force], passed.largest)
    off, force = off + _ROUNDED * EPS * stop.still, force + _ROUNDED * EPS * k * stop.still
    less, slower = contact.left_out, contact.rate_left_out
    contact.error_impulse += (force + k * less) * span / scale + 2.0 * c * less
    contact.error_impulse += _ROUNDED * EPS * abs(contact.impulse)
    fast += slower
    contact.error_indentation = max(contact.error_indentation, off + less)
    contact.error_peak_force = max(contact.error_peak_force, force + k * less + c * scale * slower)
    rates = 2.0 * fast * math.sqrt(max(contact.square * span, 0.0)) + fast * fast * span
    contact.error_energy_lost += c * scale * (rates + _ROUNDED * EPS * contact.square)


@inner
def sum_up(
    prepared: Scenes, structure: Structure, place: int, phases: Phases, scratch: Scratch,
    passed: Passed, given: tuple[int, float, float, int],
) -> tuple[int, float]:  # fmt: skip
    """Add a free motion to the phases that last.

    Parameters
    ----------
    given : tuple
        The stop and the time to begin at, the duration, and the work after which it pauses.

    Returns
    -------
    tuple
        The stop and the time to go on from; the number of stops where nothing is left.
    """
    first, done, span, budget = given
    for a in range(first, phases.marks.shape[1] if span > 0.0 else 0):
        row = phases.marks[LASTING, a]
        if row == NONE:
            continue
        contact = phases.rows[row]
        if done == 0.0:
            contact.square = contact.left_out = contact.rate_left_out = 0.0
        size = magnitude(structure.watched.coordinate[a], passed.largest)
        size += abs(prepared.stops[place, a].indentation)
        while size > 0.0 and done < span:
            if done > 0.0 and scratch.piece[0].work >= budget:
                return a, done
            done = _follow_indentation(
                prepared, structure, place, contact, scratch, passed, (done, span, size, budget)
            )
        _add_errors(prepared, structure, place, contact, passed, span)
        done = 0.0
    return phases.marks.shape[1], 0.0
