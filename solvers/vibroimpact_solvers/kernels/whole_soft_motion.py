"""A whole motion with soft limiters in one call, from the initial state to the history.

The steps could be called one by one; for a short motion of a small structure the calls would last
longer than the motion. A long one takes several calls, between which a stop signal is seen.
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
from vibroimpact_solvers.kernels.taylor import Contacts, Linear, follow

REFUSED, _END, _BUDGET = -1, 0, 1
"""What `whole_soft_motion` returns where an initial state is not finite or not within range, and as
`kernels.taylor.Stop` says."""


@kernel
def whole_soft_motion(
    modes: Any,
    linear: Linear,
    limiters: Limiters,
    precision: tuple[int, float],
    output_times: Floats,
    progress: Any,
    start: tuple[Floats, Floats],
    work: tuple[Floats, Floats, Floats, Contacts],
    history: tuple[Floats, Floats],
) -> int:
    """Compute a motion; return why it stopped, as `kernels.taylor.follow` does, or `REFUSED`.

    Where that was for the steps of one call, or for the rows of the history, another one goes on.

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
    work : tuple
        z, lost, samples and contacts of `kernels.taylor.follow`.
    history : tuple of array, each of shape (time, dof)
        Displacements and velocities at the first of the output times, filled in at the end.
    """
    (x, v), (xs, vs), (z, lost, samples, contacts) = start, history, work
    modal = modal_of(modes)
    if progress.steps == 0:
        if not state_of(modal, x, v, z, lost):
            return REFUSED
        lost[:] = 0.0
    stop = follow(linear, limiters, precision, output_times, progress, z, lost, samples, contacts)
    block, sums = np.empty((2 * SAMPLES, modal.place.size)), np.empty(2 * SAMPLES * xs.shape[1])
    if stop != _END:
        return stop
    rate, last = np.empty_like(z), min(xs.shape[0], progress.written + progress.rows)
    first = progress.written
    for place in range(first, last):
        coordinates_of(modal, samples[place], rate)
        keep_coordinates(rate, block, 2 * (place - first), True, True)
        if place + 1 - first == SAMPLES or place + 1 == last:
            some = slice(first, place + 1)
            count = place + 1 - first
            displacements_of(modal, block, sums, count, xs[some], vs[some], xs[:0])
            first = place + 1
    progress.written = last
    return _END if last == xs.shape[0] else _BUDGET
