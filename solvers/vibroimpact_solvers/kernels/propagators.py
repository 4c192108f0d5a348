"""Propagators of the pairs of a structure (`kernels.flow`) by many times."""

from __future__ import annotations

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.flow import Flow, set_propagator
from vibroimpact_solvers.kernels.jit import bare


@bare
def propagators(flow: Flow, times: Floats, rests: Floats, out: Floats) -> None:
    """Fill in the propagators, shape (time, 2, pair), by times and what rounding took from them."""
    for k in range(times.size):
        set_propagator(flow, times[k], rests[k], out[k])
