"""Equations of periodic motions with several impacts (`periodic_motions.sequences`)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.flow import Z1, Z2, Flow, product, propagate, set_propagator
from vibroimpact_solvers.kernels.jit import bare, inner

Complexes = NDArray[np.complex128]


class Impacts(NamedTuple):
    """The impacts of a cell."""

    position: Floats  # (m, 2, pair): forms of the coordinates
    velocity: Floats  # (m, 2, pair)
    acceleration: Floats  # (m, 2, pair): without load
    wall: Floats  # (m,)
    inertia: Floats  # (m,)


class Cells(NamedTuple):
    """One cell of all rows, or one for each."""

    length: Floats  # (cell,)
    rates: Floats  # (cell, harmonic)
    steady: Complexes  # (cell, harmonic, 2, pair): amplitudes of the response to the load
    after: Floats  # (cell, m, 2, pair): responses to one unit impulse per cell, after it
    before: Floats  # (cell, m, 2, pair): and before the next one


class Equations(NamedTuple):
    """The equations at rows of times and impulses: m about places, m of Newton's law."""

    residual: Floats  # (row, 2 m)
    jacobian: Floats  # (row, 2 m, 2 m): by impulses and times
    size: Floats  # (row, 2 m): sums of the moduli of their terms


class Room(NamedTuple):
    """Room for one response."""

    propagator: Floats  # (2, pair)
    z: Floats  # (2, pair)


@inner
def _set_load(impacts: Impacts, c: Cells, k: int, i: int, t: float, row: int, e: Equations) -> None:
    """Fill in what the load contributes to the equations of impact i, and its derivatives by t."""
    m = impacts.wall.size
    form = impacts.position[i]
    place, law, bend = 0.0, 0.0, 0.0
    place_size, law_size = abs(impacts.wall[i]), 0.0
    for h in range(c.rates.shape[1]):
        steady, rate = c.steady[k, h], c.rates[k, h]
        Y = complex(0.0, 0.0)
        for j in range(form.shape[1]):
            Y += form[Z1, j] * steady[Z1, j] + form[Z2, j] * steady[Z2, j]
        turned = Y * complex(math.cos(rate * t), math.sin(rate * t))
        place += turned.real
        law -= rate * turned.imag
        bend -= rate * rate * turned.real
        place_size += abs(Y)
        law_size += rate * abs(Y)
    e.residual[row, i], e.residual[row, m + i] = place - impacts.wall[i], law
    e.jacobian[row, i, m + i], e.jacobian[row, m + i, m + i] = law, bend
    e.size[row, i], e.size[row, m + i] = place_size, law_size


@bare
def set_equations(
    flow: Flow, impacts: Impacts, c: Cells, times: Floats, p: Floats, e: Equations, room: Room
) -> None:
    """Fill in the equations at times and impulses, both (row, m)."""
    m = impacts.wall.size
    for row in range(times.shape[0]):
        k = min(row, c.length.size - 1)
        residual, jacobian, size = e.residual[row], e.jacobian[row], e.size[row]
        for i in range(m):
            form, slope, t = impacts.position[i], impacts.velocity[i], times[row, i]
            _set_load(impacts, c, k, i, t, row, e)
            for j in range(m):
                if i == j:
                    g = product(form, c.after[k, i])
                    rate = product(slope, c.before[k, i])
                    jacobian[m + i, i] = rate + impacts.inertia[i]
                else:
                    apart = (t - times[row, j]) % c.length[k]
                    set_propagator(flow, apart, 0.0, room.propagator)
                    propagate(flow, room.propagator, apart, c.after[k, j], room.z)
                    g, rate = product(form, room.z), product(slope, room.z)
                    bend = product(impacts.acceleration[i], room.z)
                    jacobian[m + i, j] = rate
                    jacobian[i, m + j], jacobian[m + i, m + j] = (
                        -rate * p[row, j],
                        -bend * p[row, j],
                    )
                    jacobian[i, m + i] += rate * p[row, j]
                    jacobian[m + i, m + i] += bend * p[row, j]
                jacobian[i, j] = g
                residual[i] += g * p[row, j]
                residual[m + i] += rate * p[row, j]
                size[i] += abs(g * p[row, j])
                size[m + i] += abs(rate * p[row, j])
            residual[m + i] += impacts.inertia[i] * p[row, i]
            size[m + i] += impacts.inertia[i] * abs(p[row, i])
