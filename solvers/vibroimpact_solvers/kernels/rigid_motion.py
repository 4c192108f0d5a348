"""Motion of a structure with rigid limiters, from impact to impact, in one compiled loop.

Between impacts the motion is exact; the next impact is found by certified expansions
(`kernels.next_impact`) and applied by Newton's law (`kernels.impact_law`), while sampled
deviations keep account of rounding (`kernels.deviations`). The loop returns to Python where the
equations change: contacts begin and end.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.deviations import (
    add_rounding,
    estimated_error,
    random_row,
    start_deviations,
)
from vibroimpact_solvers.kernels.flow import (
    Z1,
    Z2,
    flow_of,
    propagate,
    propagate_state,
    set_propagator,
    watched_of,
)
from vibroimpact_solvers.kernels.impact_law import strike
from vibroimpact_solvers.kernels.jit import bare, once
from vibroimpact_solvers.kernels.modal import displacements_of, modal_of, state_of
from vibroimpact_solvers.kernels.next_impact import (
    AT_END,
    UNDECIDED,
    find_reach,
    has_one_undamped_mode,
    next_crossing,
    next_event,
    two_sum,
)
from vibroimpact_solvers.kernels.rigid_state import (
    Errors,
    Motion,
    Scratch,
    Structure,
    scratch_of,
)


class Stop(IntEnum):
    """Why the loop returned."""

    REFUSED = -1  # the initial state is not finite, out of range, or outside of its limits
    END = 0  # the end of the time was reached
    TABLE = 1  # the table of impacts is full
    SAMPLES = 2  # the buffer of samples is full; the state has not moved
    PAUSE = 3  # the number of expansions agreed on was spent
    CONTACT = 4  # a constraint came to rest at its wall, after its impulse
    RELEASE = 5  # a contact force vanished
    IMPACT_IN_CONTACT = 6  # a wall is reached while others are in contact: no impulse as yet


_REFUSED, _END, _TABLE, _SAMPLES, _PAUSE, _CONTACT, _RELEASE, _IMPACT_IN_CONTACT = range(-1, 7)


@once
def _take_samples(structure: Structure, motion: Motion, scratch: Scratch, until: float) -> bool:
    """Take the samples of a free motion; return whether the buffer had room for them."""
    flow, times, samples = structure.flow, motion.output_times, motion.samples
    now = motion.progress[0]
    while now.samples < times.size and times[now.samples] <= until:
        place = now.samples - now.first_sample
        if place == samples.shape[0]:
            return False
        since, lost = two_sum(times[now.samples], -now.time)
        lost -= now.time_rest
        set_propagator(flow, since, lost, scratch.propagator)
        propagate_state(flow, scratch.propagator, since + lost, motion.z, samples[place])
        now.samples += 1
    return True


@once
def _move(structure: Structure, motion: Motion, scratch: Scratch, s: float, ds: float) -> None:
    """Advance the state, its deviations and the time to the end of a free motion."""
    flow, z, deviations, moved = structure.flow, motion.z, motion.deviations, scratch.z
    now, signs = motion.progress[0], structure.errors.signs
    set_propagator(flow, s, ds, scratch.propagator)
    propagate_state(flow, scratch.propagator, s + ds, z, moved)
    for j in range(z.shape[1]):
        z[Z1, j], z[Z2, j] = moved[Z1, j], moved[Z2, j]
    for c in range(deviations.shape[0]):
        propagate(flow, scratch.propagator, s + ds, deviations[c], moved)
        for j in range(z.shape[1]):
            deviations[c, Z1, j], deviations[c, Z2, j] = moved[Z1, j], moved[Z2, j]
    now.time, lost = two_sum(now.time, s)
    now.time_rest += lost + ds
    now.released = -1
    if deviations.shape[0] > 0:
        row = random_row(now.impacts + 1, signs.shape[0])
        add_rounding(flow, motion, structure.errors, row, s)


@once
def _advance(structure: Structure, motion: Motion, scratch: Scratch) -> int:
    """Advance a motion to its end, or to an event that the caller has to handle (`Stop`)."""
    walls, now = structure.walls, motion.progress[0]
    circular = has_one_undamped_mode(structure)
    while True:
        if now.rows + walls.size > motion.impacts.size:
            return _TABLE
        if now.expansions >= now.budget:
            return _PAUSE  # however short the free motions are: the caller checks for progress
        find_reach(structure, motion, scratch)
        s, ds, who, side = 0.0, 0.0, UNDECIDED, 0
        if circular:
            s, ds, who, side = next_crossing(structure, motion, scratch)
        if who == UNDECIDED:
            s, ds, who, side = next_event(structure, motion, scratch)
        until = np.inf if who == AT_END else (now.time + s) + (now.time_rest + ds)
        if not _take_samples(structure, motion, scratch, until):
            return _SAMPLES
        _move(structure, motion, scratch, s, ds)
        if who < 0:
            return _END if who == AT_END else _PAUSE
        now.coordinate, now.side = who, side
        if walls[who].restitution < 0.0:
            return _RELEASE
        if now.stops_at_impacts:
            return _IMPACT_IN_CONTACT
        if strike(structure, motion, scratch):
            return _CONTACT


@bare
def follow(
    structure: Any, motion: Any, work: Any, modal: Any, x: Floats, v: Floats, history: Any
) -> tuple[int, int, int, int, float, float]:
    """Follow a motion from its present state, or from displacements and velocities, to its end.

    NamedTuples arrive as plain tuples of few arrays: numba looks at each at every call.

    Parameters
    ----------
    structure : tuple
        `Structure`, as `flow_of` and `watched_of` take it.
    motion : tuple
        `Motion`; what it refers to is changed.
    work : tuple
        Of `rigid_state.workspace`.
    modal : tuple
        `Modal`, used where x is not empty.
    x, v : array, shape (dof,)
        Initial displacements and velocities, of a structure without loads' pairs and with a
        progress that is new; empty: the motion goes on from its state.
    history : tuple
        Degrees of freedom, and displacements and velocities (time, dof) there, which are filled
        in at the end where a motion begins with x and reaches its end; impacts are then given in
        the units of x.

    Returns
    -------
    stop : int
        A `Stop`; where it is not the end, another call goes on from there.
    rows, grazings, expansions : int
        Impacts in the table, and counts of the whole motion.
    penetration, growth : float
        Largest distance between a wall and the place of an impact at it; the largest of the
        deviations in units of 2^-52, at least 1, where the motion began with x and reached its end.
    """
    rates, drives, kinds, forms, sizes, walls, mobility, errors = structure
    flow, watched = flow_of(rates, drives, kinds), watched_of(forms, sizes)
    named = Structure(flow, watched, walls, mobility, Errors(*errors))
    current, conversion, scratch = Motion(*motion), modal_of(modal), scratch_of(work)
    dofs, xs, vs = history
    now, z = current.progress[0], current.z
    begins = x.size > 0
    if begins:
        for j in range(z.shape[1]):
            z[Z1, j] = z[Z2, j] = 0.0
        if not state_of(conversion, x, v, z, scratch.rate):
            return _REFUSED, 0, 0, 0, 0.0, 0.0
    if not now.begun:
        start_deviations(current, named.errors)
        now.begun = 1
    stop, growth = _advance(named, current, scratch), 1.0
    if begins and stop == _END:
        some = current.samples[: xs.shape[0]]
        displacements_of(conversion, some, dofs, xs, vs, scratch.rate)
        growth = max(
            growth, estimated_error(current.deviations, named.errors.own, current.progress)
        )
        for place in range(now.rows):
            row = current.impacts[place]
            row.time = (row.time + row.time_rest) / conversion.scale
            row.velocity *= conversion.scale
            row.impulse *= conversion.scale
            if not row.deviation <= growth:
                growth = row.deviation
    return stop, now.rows, now.grazings, now.expansions, now.penetration, growth
