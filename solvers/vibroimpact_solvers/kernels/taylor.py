"""Motion of a structure with soft limiters, step by step by Taylor series.

The state z is that of `kernels.flow`, with ``z' = A z + push + sum over the limiters of kick f``.
Its coefficients follow one another,

    z_{k+1} = (A z_k + sum over the limiters of kick f_k) h / (k + 1) ,

where f_k are those of a limiter's force (`kernels.soft_forces`) and h is the last step:
coefficients are scaled by it, so that they neither overflow nor vanish.

A step s h is as long as the last two coefficients allow (Jorba and Zou 2005, section 3.2): with K
the larger of them and eps the error of a step, relative to the size of the state, ``s^order K =
eps |z|``. It is shortened until the forces at its end agree with the sums of their series, and
ends where a force changes its law.

Where the last two coefficients happen to vanish, motions of any error take the same steps, and
their difference does not tell the error. A motion that heeds what forces miss at the end of such a
step takes their impulse for that of one more term, and errs by several times as much.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.flow import Z1, Z2
from vibroimpact_solvers.kernels.jit import fma, inline, inner, kernel, once, record
from vibroimpact_solvers.kernels.series import FIRST, SECOND, raised
from vibroimpact_solvers.kernels.soft_contacts import note_switchings, sum_up
from vibroimpact_solvers.kernels.soft_forces import (
    BRANCH,
    Limiters,
    Q,
    Step,
    begin,
    clear,
    coefficient,
    compression,
    could_hide,
    defect,
    form,
    rounding_spread,
    sides_kept,
)

FINER: Final = 2.0**-5
"""Error of a step of the finer of two runs over one of the other, which heeds what forces miss."""
_EPS: Final = 2.0**-52
_FORCES: Final = 8.0  # of the error of a step: impulse that forces may miss at its end, all along
_SHORTER: Final = 0.8  # steps whose forces do not agree are taken this much shorter
_SHORTEST: Final = 1e-25  # of the motion: limiters that need less are too stiff
_LEAST: Final = 1e-200  # power of a step by which an impulse is divided
_FEW: Final = 8  # pairs up to which sums go pair by pair


class Stop(IntEnum):
    """Why `follow` stopped."""

    END = 0
    BUDGET = 1
    STIFF = 2
    PHASES = 3
    """The table of contact phases is full."""


PAIR: Final = record(
    [
        ("alpha", np.float64),  # z1' = alpha z1 + turn z2
        ("turn", np.float64),
        ("back", np.float64),  # z2' = alpha z2 + back z1 + push
        ("push", np.float64),
        ("rest", np.float64),  # what rounding took from the frequency of a rotation
        ("weight", np.float64),  # in the size of a state
    ]
)
"""A pair of the state."""


class Linear(NamedTuple):
    """A structure without its limiters."""

    pairs: Any  # (pair,) of PAIR
    drives: Any  # (drive,) of `kernels.flow.DRIVE`


PROGRESS: Final = record(
    [
        ("time", np.float64),
        ("lost", np.float64),  # what rounding took from the time
        ("end", np.float64),
        ("step", np.float64),  # the last one
        ("deepest", np.float64),  # largest compression
        ("cut", np.float64),  # sum of the squares of the last terms of all steps
        ("heed", np.float64),  # times by which impulses that forces miss are missed again
        ("steps", np.int64),
        ("samples", np.int64),
        ("most", np.int64),  # steps of one call
        ("written", np.int64),  # samples in a history of displacements and velocities
        ("rows", np.int64),  # of it in one call
        ("phases", np.int64),  # contact phases so far
    ]
)
"""How far a motion has come."""


class Contacts(NamedTuple):
    """Contact phases of a motion; a table without rows where they are not asked for."""

    phases: Any  # of `soft_contacts.PHASE`
    lasting: Integers  # (wall,): the phase of each limiter that lasts, or -1


class _Work(NamedTuple):
    """What the steps of a motion work with."""

    series: Floats  # (term, 2, pair): coefficients of the state
    end: Floats  # (2, pair): the change of the state within a step
    inverse: Floats  # (term + 1,): 1/k, 0 for k = 0
    branches: Any  # (wall,) of BRANCH
    contacts: Contacts


@inline
def _largest(pairs: Any, z: Floats) -> float:
    """Return the largest number of a state, weighted; nan where one is."""
    largest, checked = 0.0, 0.0
    for j in range(pairs.size):
        a, b = pairs[j].weight * z[Z1, j], pairs[j].weight * z[Z2, j]
        largest = max(largest, abs(a), abs(b))
        checked += 0.0 * a + 0.0 * b
    return largest + checked


@inline
def _moved(C: Floats, order: int, s: float, out: Floats) -> None:
    """Fill in the change of the state within a part s of the last step."""
    n = out.shape[1]
    if n <= _FEW:
        # Horner's rule for even and for odd powers, side by side.
        square, odd = s * s, order % 2 == 1
        for j in range(n):
            a, b = C[order, Z1, j], C[order - 1, Z1, j]
            c, d = C[order, Z2, j], C[order - 1, Z2, j]
            for k in range(order - 2, 1, -2):
                a, b = fma(a, square, C[k, Z1, j]), fma(b, square, C[k - 1, Z1, j])
                c, d = fma(c, square, C[k, Z2, j]), fma(d, square, C[k - 1, Z2, j])
            a, c = fma(a, s, b), fma(c, s, d)
            out[Z1, j] = s * (fma(a, s, C[SECOND, Z1, j]) if odd else a)
            out[Z2, j] = s * (fma(c, s, C[SECOND, Z2, j]) if odd else c)
    else:
        for side in range(2):
            for j in range(n):
                out[side, j] = C[order, side, j]
        for k in range(order - 1, 0, -1):
            for side in range(2):
                for j in range(n):
                    out[side, j] = fma(out[side, j], s, C[k, side, j])
        for side in range(2):
            for j in range(n):
                out[side, j] *= s


@inline
def _linear_part(linear: Linear, C: Floats, k: int, factor: float) -> None:
    """Fill in coefficients k + 1 of the state as far as they do not depend on the limiters."""
    here, there = C[k], C[k + 1]
    for j in range(here.shape[1]):
        pair, a, b = linear.pairs[j], here[Z1, j], here[Z2, j]
        there[Z1, j] = factor * fma(pair.alpha, a, pair.turn * b)
        there[Z2, j] = factor * fma(pair.alpha, b, pair.back * a)
    if k == 0:
        for j in range(here.shape[1]):
            there[Z2, j] = fma(factor, linear.pairs[j].push, there[Z2, j])
    for row in range(linear.drives.size):
        drive = linear.drives[row]
        i, u, v = drive.driven, drive.kappa_real, drive.kappa_imaginary
        a, b = here[Z1, drive.driving], -here[Z2, drive.driving]
        if linear.pairs[drive.driving].back == 0.0:  # a load that does not turn
            there[Z1, i] = fma(factor, u * a, there[Z1, i])
            there[Z2, i] = fma(factor, v * a, there[Z2, i])
            continue
        if linear.pairs[i].back >= 0.0:  # a rigid body
            there[Z2, i] = fma(factor, u * a - v * b, there[Z2, i])
            continue
        there[Z1, i] = fma(factor, u * a - v * b, there[Z1, i])
        there[Z2, i] = fma(-factor, u * b + v * a, there[Z2, i])


@inline
def _pushed(
    limiters: Limiters, branches: Any, i: int, C: Floats, k: int, part: float, factor: float
) -> None:
    """Add what a limiter does to coefficients k + 1 of the state.

    Those of its coordinate do not wait for it: an impulse changes no displacement.
    """
    now, here, there = branches[i], C[k], C[k + 1]
    kicks = limiters.kicks[i]
    f = factor * coefficient(now, part, limiters.laws[i].exponent, limiters.laws[i].whole)
    now.next = factor * form(limiters.slopes, i, here)
    for j in range(here.shape[1]):
        there[Z1, j] = fma(f, kicks[Z1, j], there[Z1, j])
        there[Z2, j] = fma(f, kicks[Z2, j], there[Z2, j])


@inline
def _coefficients(
    linear: Linear, limiters: Limiters, work: _Work, z: Floats, order: int, h: float
) -> float:
    """Fill in the coefficients of the state and of the coordinates.

    Returns the size of the larger of the last two of the state.
    """
    branches, C, walls = work.branches, work.series, limiters.laws.size
    for j in range(z.shape[1]):
        C[FIRST, Z1, j], C[FIRST, Z2, j] = z[Z1, j], z[Z2, j]
    for k in range(order):
        part, factor = work.inverse[k], h * work.inverse[k + 1]
        _linear_part(linear, C, k, factor)
        if walls == 1:  # without the bookkeeping of a loop
            _pushed(limiters, branches, walls - 1, C, k, part, factor)
        else:
            for i in range(walls):
                _pushed(limiters, branches, i, C, k, part, factor)
    for i in range(limiters.laws.size):
        branches[i].powers[Q, order] = branches[i].next
    return max(_largest(linear.pairs, C[order - 1]), _largest(linear.pairs, C[order]))


@inline
def _agreed(limiters: Limiters, work: _Work, s: float, step: Step, hidden: bool) -> float:
    """Return the part of a step, up to s, at whose end forces agree with their series.

    Fills in the change of the state until then.
    """
    order = work.series.shape[0] - 1
    while True:
        _moved(work.series, order, s, work.end)
        worst = defect(limiters, work.branches, work.end, order, s, hidden)
        # Shorter ones than that end as too stiff.
        if worst * s * step.h <= _FORCES * step.allowed or not s > _SHORTEST:
            return s
        s *= _SHORTER


@inner
def _sampled(
    C: Floats, progress: Any, h: float, span: float, output_times: Floats, samples: Floats
) -> float:
    """Fill in the states at the output times within a step; return the next output time."""
    while progress.samples < output_times.size:
        due: float = output_times[progress.samples]
        t = (due - progress.time) - progress.lost
        if t > span:
            return due
        sample = samples[progress.samples]
        _moved(C, C.shape[0] - 1, t / h, sample)
        for j in range(C.shape[2]):
            sample[Z1, j] += C[FIRST, Z1, j]
            sample[Z2, j] += C[FIRST, Z2, j]
        progress.samples += 1
    return math.inf


@inline
def _added(value: float, lost: float, change: float) -> tuple[float, float]:
    """Return a sum and what rounding takes from it."""
    change += lost
    new = value + change
    back = new - value
    return new, (value - (new - back)) + (change - back)


@inline
def _update(linear: Linear, work: _Work, span: float, z: Floats, lost: Floats) -> None:
    """Move the state to the end of a step."""
    C, end = work.series, work.end
    for j in range(linear.pairs.size):
        # What rounding took from the frequency turns the state a little further.
        turn = linear.pairs[j].rest * span
        first = end[Z1, j] + turn * C[FIRST, Z2, j]
        second = end[Z2, j] - turn * C[FIRST, Z1, j]
        z[Z1, j], lost[Z1, j] = _added(z[Z1, j], lost[Z1, j], first)
        z[Z2, j], lost[Z2, j] = _added(z[Z2, j], lost[Z2, j], second)


@inner
def _heeded(
    limiters: Limiters, work: _Work, last: float, s: float, step: Step, heed: float
) -> None:
    """Take what forces miss at the end of a step from the last term of the state.

    Where it is more than the last two terms, whose size is last, and so little that it shortens no
    step of the finer run: otherwise the steps of both show it. The step has missed this impulse: to
    take more of it away makes its error larger, while to add it might cancel errors of others.
    """
    C, order = work.series, work.series.shape[0] - 1
    grown = raised(s, order)
    for i in range(limiters.laws.size):
        kicks, impulse = limiters.kicks[i], work.branches[i].missed * s * step.h
        size = limiters.laws[i].strength * abs(impulse)
        if not last * grown * order < size <= _FORCES * FINER * step.allowed:
            continue
        impulse *= -heed / order
        term = impulse / grown if grown > _LEAST else 0.0
        for side in range(2):
            for j in range(work.end.shape[1]):
                work.end[side, j] += impulse * kicks[side, j]
                C[order, side, j] += term * kicks[side, j]


@once
def _steps(
    linear: Linear,
    limiters: Limiters,
    work: _Work,
    error: float,
    output_times: Floats,
    progress: Any,
    z: Floats,
    lost: Floats,
    samples: Floats,
) -> int:
    """Take steps to the end of a motion; arguments as of `follow`."""
    branches, order, h = work.branches, work.series.shape[0] - 1, progress.step
    steepest = 1.0
    for i in range(branches.size):
        steepest = max(steepest, limiters.laws[i].exponent)
    spread, deepest, stop = rounding_spread(order, steepest), progress.deepest, 0
    phases, lasting = work.contacts.phases, work.contacts.lasting
    last_step = progress.steps + progress.most
    shortest = _SHORTEST * progress.end
    rest = (progress.end - progress.time) - progress.lost
    due = -math.inf  # the next output time, or earlier
    while rest > 0.0:
        if progress.steps >= last_step:
            stop = 1
            break
        if phases.size > 0 and phases.size - progress.phases < branches.size:
            stop = 3
            break
        scale = _largest(linear.pairs, z)
        if scale == 0.0:  # from rest at the zero of the state, by a constant load
            for j in range(linear.pairs.size):
                scale = max(scale, h * linear.pairs[j].weight * abs(linear.pairs[j].push))
        step = Step(h, scale, error * scale, spread)
        reach = begin(limiters, branches, z, order, step)
        last = _coefficients(linear, limiters, work, z, order, h)
        if not last < math.inf:
            h *= 2.0**-20
            for i in range(branches.size):
                clear(branches[i])
            if h > shortest:
                continue
            stop = 2
            break
        if phases.size > 0:
            time = progress.time + progress.lost
            progress.phases = note_switchings(
                limiters, branches, z, h, time, phases, lasting, progress.phases
            )
        s = min(abs(reach), rest / h)
        if last > 0.0:
            s = min(s, math.exp(math.log(step.allowed / last) * work.inverse[order]))
        s = sides_kept(limiters, branches, order, s)
        hidden = reach < 0.0 or could_hide(limiters, branches, order)
        s = _agreed(limiters, work, s, step, hidden)
        span = s * h
        final = span >= rest * (1.0 - 8.0 * _EPS)
        if final:
            span = rest
        if not (s > _SHORTEST and span > shortest):
            stop = 2
            break
        if progress.heed > 0.0:
            _heeded(limiters, work, last, s, step, progress.heed)
        cut = last * raised(s, order)
        progress.cut += cut * cut
        deepest = compression(limiters, branches, work.end, order, s, step, deepest)
        if phases.size > 0:
            sum_up(limiters, branches, order, s, h, phases, lasting)
        if (due - progress.time) - progress.lost <= span:
            due = _sampled(work.series, progress, h, span, output_times, samples)
        _update(linear, work, span, z, lost)
        progress.steps += 1
        progress.time, progress.lost = _added(progress.time, progress.lost, span)
        h = span
        rest = (progress.end - progress.time) - progress.lost
        if final:
            progress.time, progress.lost, rest = progress.end, 0.0, 0.0
    progress.step, progress.deepest = h, deepest
    return stop


@kernel
def follow(
    linear: Linear,
    limiters: Limiters,
    precision: tuple[int, float],
    output_times: Floats,
    progress: Any,
    z: Floats,
    lost: Floats,
    samples: Floats,
    contacts: Contacts,
) -> int:
    """Advance a motion to its end; return why it stopped, a `Stop`.

    Parameters
    ----------
    linear : Linear
    limiters : Limiters
    precision : tuple
        The order of the series, at least 4, and the error of a step, relative to the size of the
        state.
    output_times : array, shape (time,)
        Ascending times of the samples.
    progress : record of `PROGRESS`
    z, lost : array, shape (2, pair)
        The state, and what rounding took from it.
    samples : array, shape (time, 2, pair)
    contacts : Contacts
    """
    order, error = precision
    n, terms = z.shape[1], order + 1
    inverse = np.zeros(order + 2)
    for k in range(1, order + 2):
        inverse[k] = 1.0 / k
    branches = np.zeros(limiters.laws.size, BRANCH)
    work = _Work(np.zeros((terms, 2, n)), np.zeros((2, n)), inverse, branches, contacts)
    return _steps(linear, limiters, work, error, output_times, progress, z, lost, samples)
