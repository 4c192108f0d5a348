"""A whole motion in one call: from displacements and velocities to impacts and histories.

The steps could be called one by one; in small structures, with ten impacts or so, the calls
would last longer than the motion. Made for many motions of one structure, in several threads.
"""

from __future__ import annotations

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.flight import begin, fly
from vibroimpact_solvers.kernels.jit import kernel
from vibroimpact_solvers.kernels.modal import motion_of, state_of

REFUSED = -1
"""What `launch` returns where an initial state is not finite or outside of its limits."""


@kernel
def launch(
    x: Floats,
    v: Floats,
    scale: float,
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
    wanted: Floats,
    Z: Floats,
    clock: Floats,
    counts: Integers,
    at: Floats,
    where: Integers,
    what: Floats,
    samples: Floats,
    xs: Floats,
    vs: Floats,
) -> int:
    """Follow a motion and return why it stopped, as `kernels.flight.fly` does, or `REFUSED`.

    Where it stops before its end, all that `fly` needs to go on is in its arguments.

    Parameters
    ----------
    x, v : array, shape (dof,)
        Initial displacements and velocities.
    scale : float
        What turns velocities in units of the pairs into those of x and v.
    weighted, normal, place, W, limits, shapes, dofs : array
        See `kernels.modal`.
    F, split, forms, sizes, walls, mobility, noise, drifts, bends, own, wanted : array
        See `kernels.flight.fly`.
    Z, clock, counts, at, where, what, samples : array
        See `kernels.flight.fly`; Z is zero, and so is what `fly` would find in the others but
        for the end and the limits of the run.
    xs, vs : array, shape (time, dof)
        The history at the wanted times, filled in at the end.
    """
    if not state_of(x, v, 1.0 / scale, weighted, normal, place, W, limits, Z):
        return REFUSED
    begin(Z, noise, own, clock)
    stop = fly(
        F, split, forms, sizes, walls, mobility, Z, noise, drifts, bends, own, clock, counts, at,
        where, what, wanted, samples,
    )  # fmt: skip
    if stop == 0 and wanted.size > 0:
        motion_of(samples[: wanted.size], scale, shapes, dofs, normal, place, xs, vs)
    return int(stop)
