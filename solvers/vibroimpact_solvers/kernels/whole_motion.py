"""A whole motion in one call, from initial displacements and velocities to impacts and history.

The steps could be called one by one; in small structures, with ten impacts or so, the calls
would last longer than the motion. Made for many motions of one structure, in several threads.
"""

from __future__ import annotations

import math

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.free_motion import advance, estimated_error, start_deviations
from vibroimpact_solvers.kernels.jit import kernel
from vibroimpact_solvers.kernels.modal import motion_of, state_of

REFUSED = -1
"""What `whole_motion` returns where an initial state is not finite or outside of its limits."""


@kernel
def whole_motion(
    x: Floats,
    v: Floats,
    xs: Floats,
    vs: Floats,
    settings: Floats,
    weighted: Floats,
    normal: Floats,
    place: Integers,
    W: Floats,
    limits: Floats,
    shapes: Floats,
    dofs: Integers,
    F: Floats,
    split: Integers,
    forms: Floats,
    sizes: Floats,
    walls: Floats,
    mobility: Floats,
    noise: Floats,
    drifts: Floats,
    bends: Floats,
    own: Floats,
    output_times: Floats,
    Z: Floats,
    clock: Floats,
    counts: Integers,
    at: Floats,
    where: Integers,
    what: Floats,
    samples: Floats,
    room: Floats,
    search: Floats,
    levels: Floats,
    marks: Integers,
    square: Floats,
    numbers: Floats,
    places: Integers,
) -> tuple[int, int, int, int, float, float]:
    """Compute a motion; return why the loop stopped, and counts and errors of the motion.

    Where it stops before its end, its arguments are those from which `advance` continues.

    Parameters
    ----------
    x, v : array, shape (dof,)
        Initial displacements and velocities.
    xs, vs : array, shape (time, dof)
        The history at the output times, filled in at the end.
    settings : array, shape (5,)
        Factor from velocities in units of the pairs to those of x and v; then the end, the
        longest expansion, the shortest time of chatter and the most expansions (`advance`).
    weighted, normal, place, W, limits, shapes, dofs : array
        See `kernels.modal`.
    F, split, forms, sizes, walls, mobility, noise, drifts, bends, own, output_times : array
        See `kernels.free_motion.advance`.
    Z, clock, counts, at, where, what, samples, room, search, levels, marks, square : array
        See `kernels.free_motion.advance`; what they hold before does not matter.
    numbers : array, shape (4, row)
        Filled in at the end, of every impact: time, velocity before it, impulse, deviations, nan
        where there are none.
    places : array of int, shape (2, row)
        The same: constraint and side.

    Returns
    -------
    stop : int
        As of `kernels.free_motion.advance`, or `REFUSED`.
    rows, grazings, expansions : int
    penetration, growth : float
        Largest distance between a wall and the place of an impact at it; the largest of the
        deviations, at least 1.
    """
    scale = settings[0]
    Z[:] = 0.0
    clock[:] = 0.0
    clock[2], clock[3], clock[4] = settings[1], settings[2], settings[3]
    counts[:] = 0
    counts[3] = int(settings[4])
    if not state_of(x, v, 1.0 / scale, weighted, normal, place, W, limits, Z, room[0]):
        return REFUSED, 0, 0, 0, 0.0, 0.0
    start_deviations(Z, noise, own, clock)
    stop = advance(
        F, split, forms, sizes, walls, mobility, Z, noise, drifts, bends, own, clock, counts, at,
        where, what, output_times, samples, room, search, levels, marks, square,
    )  # fmt: skip
    rows, growth = counts[0], 1.0
    if stop == 0:
        if output_times.size > 0:
            some = samples[: output_times.size]
            motion_of(some, scale, shapes, dofs, normal, place, xs, vs, room[0])
        growth = max(growth, estimated_error(Z, own, clock[7]))
        for row in range(rows):
            numbers[0, row] = (at[row, 0] + at[row, 1]) / scale
            numbers[1, row], numbers[2, row] = what[row, 0] * scale, what[row, 1] * scale
            numbers[3, row] = what[row, 2] if Z.shape[0] > 1 else math.nan
            places[0, row], places[1, row] = where[row, 0], where[row, 1]
            if not what[row, 2] <= growth:
                growth = what[row, 2]
    return stop, rows, counts[8], counts[2], clock[6], growth
