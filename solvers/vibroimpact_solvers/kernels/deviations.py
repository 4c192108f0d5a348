"""Deviations that stand for roundings, carried along by the linearised motion.

A motion computed in double precision is the exact motion of slightly other data: after a free
motion every pair is known to two units in the last place of its length, every frequency to its own
error, and an impact adds the rounding of its impulse and of the place of its wall. Samples of such
errors, of random sign, obey the linearised flow and the saltation of impacts

    dz+ = dz- + kick dP - kick_rate (1 + k) m dy ,    dP = (1 + k) m (y'' dy / y' - dy') ,

m being the mass that is struck. Where y' is so slow that dy decides whether there is an impact, the
first term is bounded by the root of ``2 y'' dy``. Three times the largest of five samples is the
error estimate.

Displacements are what is free of a state and what loads carry along: a deflection, and responses.
These may be larger than their sum; roundings are relative to each, errors to the sum. Deviations of
the loads stand for roundings of the responses.
"""

from __future__ import annotations

import math
from typing import Final

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.flow import (
    Z1,
    Z2,
    Flow,
    propagate,
    propagate_state,
    set_propagator,
)
from vibroimpact_solvers.kernels.jit import inline, inner, never_inlined, once
from vibroimpact_solvers.kernels.rigid_state import Errors, Motion, Rows, Scratch, Structure

SAFETY: Final = 3.0
"""Factor on the largest of the sampled deviations: errors do not exceed the product."""
EPS: Final = 2.0**-52
_SHARP = 2.0**-8  # how well the end of a tolerance is told, relative to the free motion
_STEADY = 0.05  # part by which what decays does not matter
_FROM_REST = 0.25  # length over those of its parts, free and carried, below which a state rests
_LOOKED_AT = 16  # times of a motion from rest
_GOLDEN = 0.6180339887498949  # of whose multiples the fractions are spread evenly
_STILL = 0  # the row of what constant loads carry
_PROPAGATED = 2.0  # rounding of a pair by the free motion from one impact to the next


@inline
def random_row(count: int, rows: int) -> int:
    """Return a row of the signs that seems drawn at random (multiplicative hashing)."""
    return (count * 2654435761 % 4294967296 >> 8) % rows


@inline
def length(z: Floats, weights: Floats) -> float:
    """Return the root of the weighted sum of squares of a state; both of shape (2, pair)."""
    s1, s2 = 0.0, 0.0
    for j in range(z.shape[1]):
        s1 += weights[Z1, j] * z[Z1, j] * z[Z1, j]
        s2 += weights[Z2, j] * z[Z2, j] * z[Z2, j]
    return math.sqrt(s1 + s2)


@inline
def _carried(errors: Errors, z: Floats, of: int, j: int, level: float) -> float:
    """Return what the loads of a state make of a number of a pair."""
    carried, loads = errors.carried, errors.loads
    total = level * carried[_STILL, of, j]
    for k in range(loads.size):
        value, slope = z[Z1, loads[k]], z[Z2, loads[k]]
        total += value * carried[1 + 2 * k, of, j] + slope * carried[2 + 2 * k, of, j]
    return float(total)


@inline
def lengths(z: Floats, errors: Errors, level: float) -> tuple[float, float]:
    """Return the length of a whole state, and the sum of those of what is free and carried.

    level is 1 for a state and 0 for a deviation, which constant loads do not act on.
    """
    weights = errors.own if level > 0.0 else errors.measure
    free = length(z, weights)
    if errors.carried.shape[0] == 0:
        return free, free
    return _with_carried(z, errors, weights, level, free)


@inner
def _with_carried(
    z: Floats, errors: Errors, weights: Floats, level: float, free: float
) -> tuple[float, float]:
    """Return `lengths` where loads carry something along."""
    never_inlined()
    whole, carried = 0.0, 0.0
    for j in range(z.shape[1]):
        first, second = weights[Z1, j], weights[Z2, j]
        if second > 0.0:
            a, b = _carried(errors, z, Z1, j, level), _carried(errors, z, Z2, j, level)
            carried += first * a * a + second * b * b
            a, b = a + z[Z1, j], b + z[Z2, j]
            whole += first * a * a + second * b * b
    return math.sqrt(whole), free + math.sqrt(carried)


@inline
def _grain(errors: Errors, j: int) -> float:
    """Return what z1 of a pair is of a unit displacement, which its measure makes of it."""
    return math.sqrt(errors.measure[Z2, j] / errors.measure[Z1, j])


@inner
def start_deviations(flow: Flow, motion: Motion, errors: Errors) -> None:
    """Set the deviations that a motion starts with, and the length of its state.

    A displacement is known to a rounding, and what is a small part of it to as small a one.
    """
    never_inlined()
    z, deviations, signs, own = motion.z, motion.deviations, errors.signs, errors.own
    motion.progress[0].largest, parts = lengths(z, errors, 1.0)
    for j in range(flow.rotations, flow.hyperbolas_end):
        parts += abs(z[Z1, j]) / _grain(errors, j)
    rounding = _PROPAGATED * parts / math.sqrt(2.0 * own.size)
    for c in range(deviations.shape[0]):
        dz = deviations[c]
        for j in range(z.shape[1]):
            size = rounding * own[Z1, j] + errors.doubts[j] * math.hypot(z[Z1, j], z[Z2, j])
            creeps = flow.rotations <= j < flow.hyperbolas_end
            grain = _grain(errors, j) if creeps else 1.0
            dz[Z1, j] = grain * size * signs[c + 1, Z1, j]
            dz[Z2, j] = size * signs[c + 1, Z2, j]
        # The state is given: what loads carry too far is missing in what is free.
        level = -errors.still if c & 1 else errors.still
        for j in range(z.shape[1] if errors.carried.shape[0] > 0 else 0):
            dz[Z1, j] -= _carried(errors, dz, Z1, j, level)
            dz[Z2, j] -= _carried(errors, dz, Z2, j, level)


@inline
def set_sizes(flow: Flow, s: float, z: Floats, sizes: Floats) -> None:
    """Fill in what a free motion of duration s to a state is rounded relative to, (2, pair)."""
    for j in range(z.shape[1]):
        a, b = abs(z[Z1, j]), abs(z[Z2, j])
        # Under faint drag, z1 is nu q, and a velocity gives but nu s of itself to it.
        creeps = flow.rotations <= j < flow.hyperbolas_end
        sizes[Z1, j] = a + min(1.0, 2.0 * flow.nu[j] * s) * b if creeps else a + b
        sizes[Z2, j] = a + b


@once
def add_rounding(
    flow: Flow, motion: Motion, errors: Errors, row: int, s: float, sizes: Floats
) -> None:
    """Add the rounding of a free motion of duration s to the deviations.

    It is relative to sizes, shape (2, pair): those of `set_sizes`, or, of a hop from a wall back to
    it, whose duration does not depend on where the wall is, of `flow.set_changes`.

    That of a pair has any sign, that of a frequency the same one from impact to impact: it turns
    rotations, ``dz = s dnu (z2, -z1)``, and stretches hyperbolas, ``dz = s dnu (z2, z1)``. That of
    an eigenvalue pushes a free body by its displacement, ``dz2' = -2 dnu z1``.
    """
    z, deviations, progress = motion.z, motion.deviations, motion.progress[0]
    whole, _ = lengths(z, errors, 1.0)
    progress.largest = max(progress.largest, whole)
    for c in range(deviations.shape[0]):
        _add_rounding_to(flow, errors, z, deviations[c], c, row, s, sizes)


@inline
def _add_rounding_to(
    flow: Flow, errors: Errors, z: Floats, dz: Floats, c: int, row: int, s: float, sizes: Floats
) -> None:
    """Add the rounding of a free motion to one column of the deviations."""
    signs = errors.signs
    at = (row + 7 * (c + 1)) % signs.shape[0]
    for j in range(z.shape[1]):
        dz[Z1, j] += _PROPAGATED * sizes[Z1, j] * signs[at, Z1, j]
        dz[Z2, j] += _PROPAGATED * sizes[Z2, j] * signs[at, Z2, j]
    _add_drift(flow, errors, z, dz, c, s)


@inline
def _add_drift(flow: Flow, errors: Errors, z: Floats, dz: Floats, c: int, s: float) -> None:
    """Add what the errors of the frequencies make in a free motion."""
    drifts = errors.drifts
    for j in range(flow.rotations):
        turned = s * drifts[c, j]
        dz[Z1, j] += turned * z[Z2, j]
        dz[Z2, j] -= turned * z[Z1, j]
    for j in range(flow.rotations, flow.hyperbolas_end):
        turned = s * drifts[c, j]
        dz[Z1, j] += turned * z[Z2, j]
        dz[Z2, j] += turned * z[Z1, j]
    for j in range(flow.hyperbolas_end, z.shape[1]):
        a, b, p = z[Z1, j], z[Z2, j], flow.push[j]
        # Integrals of the displacement, backwards from the end.
        pushed = 2.0 * s * drifts[c, j]
        dz[Z1, j] -= pushed * s * (0.5 * a - s * (b / 3.0 - 0.125 * s * p))
        dz[Z2, j] -= pushed * (a - s * (0.5 * b - s * p / 6.0))


@inline
def estimated_length(deviations: Floats, errors: Errors, progress: Rows) -> float:
    """Return the length of the error estimated from the deviations, in units of 2^-52."""
    largest, now = 0.0, progress[0]
    for c in range(deviations.shape[0]):
        longest, _ = lengths(deviations[c], errors, 0.0)
        if longest > largest or math.isnan(longest):  # after which nothing is larger
            largest = longest
    unresolved = now.unresolved * now.largest if now.unresolved > 0.0 else 0.0
    return float(max(SAFETY * largest, unresolved))


@inline
def estimated_error(deviations: Floats, errors: Errors, progress: Rows) -> float:
    """Return the error estimated from the deviations, relative to the length of the motion."""
    size = progress[0].largest
    return estimated_length(deviations, errors, progress) / size if size > 0.0 else 0.0


@inline
def lose(progress: Rows, error: float, time: float) -> None:
    """Note the time at which an error exceeds the tolerance for the first time."""
    now = progress[0]
    if not error * EPS <= now.tolerance and now.known_until == math.inf:
        now.known_until = time / now.scale


@inline
def set_spread(flow: Flow, deviations: Floats, spread: Floats) -> None:
    """Fill in the lengths of pairs of the deviations, shape (pair,), the largest of all columns."""
    for j in range(spread.size):
        spread[j] = 0.0
    for c in range(deviations.shape[0]):
        dz = deviations[c]
        for j in range(flow.rotations):
            spread[j] = max(spread[j], dz[Z1, j] * dz[Z1, j] + dz[Z2, j] * dz[Z2, j])
        for j in range(flow.rotations, spread.size):
            spread[j] = max(spread[j], abs(dz[Z1, j]) + abs(dz[Z2, j]))
    for j in range(flow.rotations):
        spread[j] = math.sqrt(spread[j])


@inner
def _lengths_after(
    structure: Structure, motion: Motion, scratch: Scratch, s: float
) -> tuple[float, float]:
    """Return lengths a time s later: that of the error, and the largest one of the motion.

    Nothing is changed.
    """
    never_inlined()
    flow, errors, z, moved = structure.flow, structure.errors, scratch.z, scratch.rate
    now, largest = motion.progress[0], 0.0
    set_propagator(flow, s, 0.0, scratch.propagator)
    propagate_state(flow, scratch.propagator, s, motion.z, z)
    set_sizes(flow, s, z, scratch.sizes)
    for c in range(motion.deviations.shape[0]):
        propagate(flow, scratch.propagator, s, motion.deviations[c], moved)
        _add_rounding_to(flow, errors, z, moved, c, 0, s, scratch.sizes)
        longest, _ = lengths(moved, errors, 0.0)
        largest = max(largest, longest)
    size, _ = lengths(z, errors, 1.0)
    return SAFETY * largest, max(now.largest, size)


@inner
def note_size_from_rest(structure: Structure, motion: Motion, scratch: Scratch, s: float) -> None:
    """Note the largest of the lengths on the way of a free motion of duration s from rest.

    Errors are relative to the largest state. Loads drive a motion away from rest, and it may be
    back there at its end; times that no period divides show how far it has been.
    """
    never_inlined()
    flow, errors, z, now = structure.flow, structure.errors, scratch.z, motion.progress[0]
    if now.impacts > 0 or errors.carried.shape[0] == 0 or motion.deviations.shape[0] == 0:
        return
    whole, parts = lengths(motion.z, errors, 1.0)
    if max(whole, now.largest) > _FROM_REST * parts:
        return
    part = _GOLDEN
    for _ in range(_LOOKED_AT):
        set_propagator(flow, part * s, 0.0, scratch.propagator)
        propagate_state(flow, scratch.propagator, part * s, motion.z, z)
        whole, _ = lengths(z, errors, 1.0)
        now.largest = max(now.largest, whole)
        part = (part + _GOLDEN) % 1.0


@inline
def _error_after(structure: Structure, motion: Motion, scratch: Scratch, s: float) -> float:
    """Return the estimated error of a free motion after a time s, relative to the motion."""
    error, size = _lengths_after(structure, motion, scratch, s)
    return error / size if size > 0.0 else 0.0


@inner
def note_what_decays(structure: Structure, motion: Motion, scratch: Scratch, s: float) -> float:
    """Note errors of a free motion of duration s that are smaller at its end than on the way.

    That of a frequency is like ``t exp(alpha t)``, with its largest value at ``t = -1 / alpha``:
    where anything decays to 1/e or less, they are estimated at half the duration, a quarter of it,
    and so on, until nothing decays. Returns the length of the largest of them.
    """
    now, alpha, fastest, t = motion.progress[0], structure.flow.alpha, 0.0, 0.5 * s
    largest = 0.0
    for j in range(alpha.size):
        fastest = max(fastest, -alpha[j])
    while fastest * s > 1.0 and fastest * t > _STEADY:
        error, size = _lengths_after(structure, motion, scratch, t)
        scratch.piece[0].work += scratch.piece[0].motion
        largest = max(largest, error)
        if size > 0.0:
            now.growth = max(now.growth, error / size)
        t *= 0.5
    return largest


@inner
def lose_on_the_way(structure: Structure, motion: Motion, scratch: Scratch, s: float) -> None:
    """Note when in a free motion of duration s the tolerance is exceeded.

    Errors that grow steadily: those of the frequencies, and of modes that grow.
    """
    now, good, bad = motion.progress[0], 0.0, s
    if _error_after(structure, motion, scratch, s) * EPS <= now.tolerance:
        return
    while bad - good > _SHARP * bad:
        middle = 0.5 * (good + bad)
        if middle <= good or middle >= bad:
            break
        if _error_after(structure, motion, scratch, middle) * EPS <= now.tolerance:
            good = middle
        else:
            bad = middle
    now.known_until = (now.time + good) / now.scale
