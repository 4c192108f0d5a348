"""A whole motion with soft limiters in one call, from the initial state to the history.

The steps could be called one by one; for a short motion of a small structure the calls would last
longer than the motion.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.jit import kernel
from vibroimpact_solvers.kernels.modal import (
    SAMPLES,
    coordinates_of,
    displacements_of,
    keep_coordinates,
    modal_of,
    state_of,
)
from vibroimpact_solvers.kernels.soft_forces import Limiters
from vibroimpact_solvers.kernels.taylor import Linear, follow

REFUSED = -1
"""What `whole_soft_motion` returns where an initial state is not finite or not within range."""


@kernel
def whole_soft_motion(
    modes: Any,
    linear: Linear,
    limiters: Limiters,
    precision: tuple[int, float],
    output_times: Floats,
    progress: Any,
    start: tuple[Floats, Floats],
    history: tuple[Floats, Floats],
) -> int:
    """Compute a motion; return why it stopped, as `kernels.taylor.follow` does, or `REFUSED`.

    Parameters
    ----------
    modes : tuple
        What `kernels.modal.modal_of` takes, with infinite limits: soft limiters may be passed.
    linear, limiters, output_times, progress
        See `kernels.taylor.follow`.
    precision : tuple
        The order of the series, and the error of a step.
    start : tuple of array, each of shape (dof,)
        Initial displacements and velocities.
    history : tuple of array, each of shape (time, dof)
        Displacements and velocities at the first of the output times, filled in at the end.
    """
    (x, v), (xs, vs), (order, error) = start, history, precision
    modal, pairs = modal_of(modes), linear.pairs.size
    z, lost = np.zeros((2, pairs)), np.zeros((2, pairs))
    if not state_of(modal, x, v, z, np.zeros((2, pairs))):
        return REFUSED
    samples = np.empty((output_times.size, 2, pairs))
    stop = follow(linear, limiters, order, error, output_times, progress, z, lost, samples)
    block, sums = np.empty((2 * SAMPLES, modal.place.size)), np.empty(2 * SAMPLES * xs.shape[1])
    first = 0
    for place in range(xs.shape[0] if stop == 0 else 0):
        coordinates_of(modal, samples[place], lost)
        keep_coordinates(lost, block, place - first, True, True)
        if place + 1 - first == SAMPLES or place + 1 == xs.shape[0]:
            some = slice(first, place + 1)
            displacements_of(modal, block, sums, place + 1 - first, xs[some], vs[some])
            first = place + 1
    return stop
