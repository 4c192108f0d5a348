"""A whole motion with soft limiters in one call, from the initial state to the history.

The steps could be called one by one; for a short motion of a small structure the calls would last
longer than the motion.
"""

from __future__ import annotations

from typing import Any

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.jit import kernel
from vibroimpact_solvers.kernels.modal import displacements_of, modal_of, state_of
from vibroimpact_solvers.kernels.taylor import follow

REFUSED = -1
"""What `whole_soft_motion` returns where an initial state is not finite or not within range."""


@kernel
def whole_soft_motion(
    x: Floats,
    v: Floats,
    modes: Any,
    dofs: Integers,
    F: Floats,
    split: Integers,
    forms: Floats,
    levels: Floats,
    laws: Floats,
    weights: Floats,
    settings: Floats,
    output_times: Floats,
    z: Floats,
    clock: Floats,
    counts: Integers,
    samples: Floats,
    work: Floats,
    xs: Floats,
    vs: Floats,
) -> int:
    """Compute a motion; return why it stopped, as `kernels.taylor.follow` does, or `REFUSED`.

    Parameters
    ----------
    x, v : array, shape (dof,)
        Initial displacements and velocities.
    modes : tuple
        What `kernels.modal.modal_of` takes, with infinite limits: soft limiters may be passed.
    dofs : array of int
    F, split, forms, levels, laws, weights, settings, output_times : array
    clock, counts, samples, work : array
        See `kernels.taylor.follow`.
    z : array, shape (2, 2, pair)
        Zero; overwritten.
    xs, vs : array, shape (time, dof)
        The history at the first of the output times, filled in at the end.
    """
    modal = modal_of(modes)
    if not state_of(modal, x, v, z[0], samples[0]):
        return REFUSED
    stop = follow(
        F,
        split,
        forms,
        levels,
        laws,
        weights,
        settings,
        output_times,
        z,
        clock,
        counts,
        samples,
        work,
    )
    if stop == 0 and xs.shape[0] > 0:
        displacements_of(modal, samples[: xs.shape[0]], dofs, xs, vs, z[1])
    return stop
