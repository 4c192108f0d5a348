"""Periodic motions at the nodes of Gauss' quadrature, for integrals and extremes along them.

Each free motion is divided into panels, so short that the fastest vibration that is left turns by a
few radians in each: integrals of products of two coordinates are then exact to rounding. At each
node a coordinate is a sum over

    1, t, t^2/2,   cos(h phi), sin(h phi),   z1_j(t), z2_j(t),

which are constant loads, the steady response to the load at its phase phi, and the pairs j that
the last impact has set in motion (`kernels.flow`). The values of all of these at many nodes are one
matrix, the factors of all coordinates are another one, and the coordinates their product.

Pairs that die within the shortest free motion are the same after every impact but for its impulse.
They are evaluated once, in a table at the nodes of the first panels, which all free motions share,
as are the propagators of the other pairs.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.kernels.flow import EVEN, ODD, Z1, Z2, Flow
from vibroimpact_solvers.kernels.jit import fma, inline, inner, product, record
from vibroimpact_solvers.kernels.phases import sine_cosine

DEAD: Final = 45.0
"""Exponent of its decay after which nothing is left of a vibration."""
LEVEL: Final = 0
RATE: Final = 1
BEND: Final = 2
TRENDS: Final = 3
"""Rows of what constant loads do, factors of 1, t and t^2/2, and their number."""

PROGRESS: Final = record(
    [
        ("solution", "i8"), ("leg", "i8"), ("segment", "i8"), ("panel", "i8"), ("node", "i8"),
        ("lasting", "i8"), ("moving", "i8"), ("before", "f8"), ("latest", "f8"),
    ]
)  # fmt: skip
"""What is evaluated next: the panel of a segment of a free motion, and a node of the table; how
many pairs move without and with those of the table; times of the two nodes before, -1 for none."""


class Forms(NamedTuple):
    """Coordinates as sums over what moves."""

    pairs: Floats  # (pair, 2, coordinate)
    trend: Floats  # (3, coordinate)
    steady: Floats  # (frequency, 2 harmonic, coordinate): factors of cosines and sines in turn
    table: Floats  # (free motion, node, coordinate): what dies, after unit impulses


class Dissipation(NamedTuple):
    """What the energy of a motion changes by."""

    load: Floats  # (2 harmonic, mode): modal forces, factors of cosines and sines in turn
    damping: Floats  # (mode, mode), or one row of its diagonal; no rows where there is none
    factors: Floats  # (frequency, 2 harmonic): of the modal forces


class Motions(NamedTuple):
    """Solutions with as many free motions each."""

    of: Integers  # (solution,): their frequencies
    phase: Floats  # (solution, free motion): of the drive, at the beginning
    length: Floats  # (solution, free motion)
    state: Floats  # (solution, free motion, 2, pair): response to the impulses at the beginning
    impulse: Floats  # (solution, free motion)
    Omega: Floats  # (frequency,)
    harmonics: Floats  # (harmonic,)


class Mesh(NamedTuple):
    """How free motions are divided: into segments, and these into panels."""

    ends: Floats  # (segment,), ascending, the last one infinite
    speeds: Floats  # (segment,): the fastest rate that is left, less where it is decayed
    shared: Integers  # (shared segment,): numbers of panels of those that all free motions share
    growth: Floats  # (pair,)
    dies: Booleans  # (pair,): whether it is in the table
    row: Integers  # (pair,): of those that are not, in `lasting`
    lasting: Floats  # (row, 2, node): their even and odd propagators at the table's nodes
    places: Floats  # (node,): nodes of a panel from 0 to 1
    weights: Floats  # (node,)


class Sums(NamedTuple):
    """What is found along solutions; integrals are a sum and what rounding took from it."""

    squares: Floats  # (solution, 2, dof): integrals of the squares of displacements
    peaks: Floats  # (solution, 2, dof): the highest displacements, and minus the lowest ones
    energy: Floats  # (solution, 2, 3): work of the load, its modulus, losses by damping
    speeds: Floats  # (solution, mode): integrals of the moduli of modal velocities
    nodes: Integers  # (solution,)


class Room(NamedTuple):
    """Room for scratch, kept from call to call."""

    progress: NDArray[np.void]  # (1,), of `PROGRESS`
    moving: Integers  # (pair,): indices of the pairs that move, those of the table last
    times: Floats  # (node,)
    weights: Floats  # (node,)
    basis: Floats  # (row node,)
    x_rows: Floats  # (row dof,): factors of displacements
    v_rows: Floats  # (row mode,): those of modal velocities
    x: Floats  # (node dof,)
    v: Floats  # (node mode,)
    forces: Floats  # (node mode,)
    dragged: Floats  # (node mode,)
    squares: Floats  # (dof,)
    least: Floats  # (dof,): displacements at the nodes that are there, and at the two before
    largest: Floats  # (dof,)
    heat: Floats  # (mode,)
    last: Floats  # (2, dof): displacements at the two nodes before


@product
def multiply(rows: Floats, columns: Floats, out: Floats) -> None:
    """Fill in ``rows^T @ columns``."""
    np.dot(rows.T, columns, out)


@inner
def set_moving(m: Motions, mesh: Mesh, begin: float, room: Room) -> None:
    """List the pairs that move at a time, those of the table last."""
    progress = room.progress[0]
    count, z = 0, m.state[progress.solution, progress.leg]
    for later in range(2):
        for j in range(mesh.growth.size):
            alive = mesh.growth[j] * begin > -DEAD and (z[Z1, j] != 0.0 or z[Z2, j] != 0.0)
            if alive and mesh.dies[j] == (later == 1):
                room.moving[count] = j
                count += 1
        if later == 0:
            progress.lasting = count
    progress.moving = count


@inner
def set_rows(forms: Forms, f: int, room: Room, flat: Floats) -> None:
    """Fill in the factors of coordinates for what moves."""
    coordinates, waves = forms.trend.shape[1], forms.steady.shape[1]
    place = 0
    for i in range(TRENDS):
        for c in range(coordinates):
            flat[place + c] = forms.trend[i, c]
        place += coordinates
    for i in range(waves):
        for c in range(coordinates):
            flat[place + c] = forms.steady[f, i, c]
        place += coordinates
    for i in range(room.progress[0].lasting):
        for number in range(2):
            for c in range(coordinates):
                flat[place + c] = forms.pairs[room.moving[i], number, c]
            place += coordinates


@inline
def _set_pair(
    flow: Flow, j: int, z1: float, z2: float, times: Floats, first: Floats, second: Floats
) -> None:
    """Fill in both numbers of a pair at times."""
    alpha, nu, rest = flow.alpha[j], flow.nu[j], flow.rest[j]
    if j < flow.rotations:
        for k in range(times.size):
            phase = nu * times[k]
            lost = fma(nu, times[k], -phase)
            sine, cosine = sine_cosine(phase, fma(rest, times[k], lost))
            first[k], second[k] = cosine * z1 + sine * z2, cosine * z2 - sine * z1
        if alpha != 0.0:
            for k in range(times.size):
                decay = math.exp(alpha * times[k])
                first[k] *= decay
                second[k] *= decay
    elif j < flow.hyperbolas_end:
        for k in range(times.size):
            larger = math.exp(((alpha + nu) + rest) * times[k])
            odd = -0.5 * larger * math.expm1(-2.0 * nu * times[k])
            even = larger - odd
            first[k], second[k] = even * z1 + odd * z2, even * z2 + odd * z1
    else:
        for k in range(times.size):
            decay = math.exp(alpha * times[k])
            first[k], second[k] = decay * (z1 + times[k] * z2), decay * z2


@inline
def _move_pair(
    flow: Flow, j: int, z1: float, z2: float, propagator: Floats, first: Floats, second: Floats
) -> None:
    """Fill in both numbers of a pair by its propagators at times, (2, time)."""
    back = z1
    if j < flow.rotations:
        back = -z1
    elif j >= flow.hyperbolas_end:
        back = 0.0
    even, odd = propagator[EVEN], propagator[ODD]
    for k in range(first.size):
        first[k], second[k] = even[k] * z1 + odd[k] * z2, even[k] * z2 + odd[k] * back


@inner
def set_basis(flow: Flow, m: Motions, mesh: Mesh, n: int, node: int, room: Room) -> int:
    """Fill in what coordinates are sums over at n nodes, (row, n); return the number of rows.

    The first node has a place in the table, or -1.
    """
    times, basis, place = room.times[:n], room.basis, TRENDS * n
    k, leg = room.progress[0].solution, room.progress[0].leg
    for i in range(n):
        basis[i], basis[n + i], basis[2 * n + i] = 1.0, times[i], 0.5 * times[i] * times[i]
    start, Omega = m.phase[k, leg], m.Omega[m.of[k]]
    for h in range(m.harmonics.size):
        for i in range(n):
            turned = m.harmonics[h] * (start + Omega * times[i])
            basis[place + n + i], basis[place + i] = sine_cosine(turned, 0.0)
        place += 2 * n
    z = m.state[k, leg]
    for i in range(room.progress[0].lasting):
        j, end = room.moving[i], place + 2 * n
        first, second = basis[place : place + n], basis[place + n : end]
        if node >= 0:
            propagator = mesh.lasting[mesh.row[j], :, node : node + n]
            _move_pair(flow, j, z[Z1, j], z[Z2, j], propagator, first, second)
        else:
            _set_pair(flow, j, z[Z1, j], z[Z2, j], times, first, second)
        place = end
    return place // n


@inner
def set_coordinates(
    forms: Forms, impulse: float, leg: int, rows: int, n: int, node: int, room: Room, at: Floats,
    flat: Floats,
) -> None:  # fmt: skip
    """Fill in coordinates at n nodes, of which the first has a place in the table, or -1."""
    count = forms.trend.shape[1]
    if count == 0:
        return
    out = at[: n * count].reshape(n, count)
    multiply(
        room.basis[: rows * n].reshape(rows, n), flat[: rows * count].reshape(rows, count), out
    )
    if node >= 0:
        for i in range(n):
            for c in range(count):
                out[i, c] += impulse * forms.table[leg, node + i, c]
