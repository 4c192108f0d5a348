"""Integrals along periodic motions by Gauss' quadrature, panel by panel (`kernels.orbits`)."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.kernels.flow import Flow, two_sum
from vibroimpact_solvers.kernels.jit import inline, inner, kernel, product
from vibroimpact_solvers.kernels.orbit_peaks import raise_peaks
from vibroimpact_solvers.kernels.orbits import (
    TRENDS,
    Dissipation,
    Forms,
    Mesh,
    Motions,
    Room,
    Sums,
    multiply,
    set_basis,
    set_coordinates,
    set_moving,
    set_rows,
)
from vibroimpact_solvers.kernels.sums import scalar_product

LEAST: Final = 4.0
"""Panels of a free motion."""
TURN: Final = 3.5
"""Radians by which the fastest vibration turns in a panel of 12 nodes.

Gauss' formula is then off by 2e-18 of its square.
"""
PANELS: Final = 8
"""Panels that are evaluated at once."""
_WORK = 2e7  # products of numbers after which the kernel returns: about ten milliseconds
_SUM = 0
_LOST = 1  # rows of sums, and what rounding took from them
_WORK_OF_LOAD, _FLOW, _HEAT = range(3)  # columns of sums of energies
_DIAGONAL = 0  # row of damping that couples no modes
_NODE = 100  # of them that a node takes besides those of the coordinates


@product
def _drag(v: Floats, damping: Floats, out: Floats) -> None:
    """Fill in ``v @ damping``."""
    np.dot(v, damping, out)


@inline
def _add(total: Floats, place: int, value: float) -> None:
    """Add to a sum in place, whose second row is what rounding took from it."""
    total[_SUM, place], lost = two_sum(total[_SUM, place], value)
    total[_LOST, place] += lost


@inner
def _add_squares(dofs: int, n: int, squares: Floats, room: Room) -> None:
    """Add integrals of squares over n nodes."""
    x, total = room.x[: n * dofs].reshape(n, dofs), room.squares
    for d in range(dofs):
        total[d] = 0.0
    for i in range(n):
        w = room.weights[i]
        for d in range(dofs):
            total[d] += w * x[i, d] * x[i, d]
    for d in range(dofs):
        _add(squares, d, total[d])


@inner
def _add_energies(e: Dissipation, frequency: int, n: int, sums: Sums, room: Room) -> None:
    """Add work of the load and losses by damping over n nodes, whose basis is used up."""
    modes, waves, k = e.load.shape[1], e.load.shape[0], room.progress[0].solution
    v = room.v[: n * modes].reshape(n, modes)
    forces = room.forces[: n * modes].reshape(n, modes)
    dragged = room.dragged[: n * modes].reshape(n, modes)
    if waves > 0:
        rows = room.basis[TRENDS * n : (TRENDS + waves) * n].reshape(waves, n)
        for w in range(waves):
            for i in range(n):
                rows[w, i] *= e.factors[frequency, w]
        multiply(rows, e.load, forces)
    coupled = e.damping.shape[0] > 1
    if coupled:
        _drag(v, e.damping, dragged)
    work, flow, lost = 0.0, 0.0, 0.0
    for i in range(n if waves > 0 else 0):
        power = room.weights[i] * scalar_product(forces[i], v[i])
        work += power
        flow += abs(power)
    if e.damping.shape[0] > 0:
        heat, speeds = room.heat, sums.speeds[k]
        for j in range(modes):
            heat[j] = 0.0
        for i in range(n):
            w = room.weights[i]
            for j in range(modes):
                heat[j] += w * v[i, j] * (dragged[i, j] if coupled else v[i, j])
                speeds[j] += w * abs(v[i, j])
        for j in range(modes):
            lost += heat[j] if coupled else e.damping[_DIAGONAL, j] * heat[j]
    _add(sums.energy[k], _WORK_OF_LOAD, work)
    _add(sums.energy[k], _FLOW, flow)
    _add(sums.energy[k], _HEAT, lost)


@inner
def _panels(mesh: Mesh, load: float, segment: int, width: float, length: float) -> int:
    """Return the number of panels of a segment."""
    if segment < mesh.shared.size:
        return int(mesh.shared[segment])
    fastest = max(mesh.speeds[segment], load)
    panels: int = math.ceil(max(fastest * width / TURN, LEAST * width / length))
    return panels


@inner
def _set_nodes(
    mesh: Mesh, first: int, last: int, begin: float, width: float, room: Room, end: float
) -> int:
    """Fill in the nodes of some panels; return their number.

    The beginning of the free motion is one, too, and so is its end, where that is not infinite.
    """
    n = 0
    if begin == 0.0 and first == 0:
        room.times[n], room.weights[n] = 0.0, 0.0
        n += 1
    for panel in range(first, last):
        for q in range(mesh.places.size):
            room.times[n] = begin + (panel + mesh.places[q]) * width
            room.weights[n] = width * mesh.weights[q]
            n += 1
    if end < math.inf:
        room.times[n], room.weights[n], n = end, 0.0, n + 1
    return n


@kernel
def integrate(
    flow: Flow,
    x: Forms,
    v: Forms,
    e: Dissipation,
    m: Motions,
    mesh: Mesh,
    sums: Sums,
    room: Room,
) -> bool:
    """Integrate along motions, and find their extremes, from where the last call has left off.

    Parameters
    ----------
    flow : Flow
    x, v : Forms
        Of displacements and of modal velocities; of none that are not asked for.
    e : Dissipation
    m : Motions
    mesh : Mesh
    sums : Sums
        Filled in; peaks are infinite before, negative, and all else is zero.
    room : Room
        Its progress is zero before the first call.

    Returns
    -------
    bool
        Whether all of them are done.
    """
    dofs, modes, load, work = x.trend.shape[1], v.trend.shape[1], 0.0, 0.0
    progress = room.progress[0]
    for h in range(m.harmonics.size):
        load = max(load, m.harmonics[h])
    while progress.solution < m.of.size and work < _WORK:
        k, leg, segment, first = progress.solution, progress.leg, progress.segment, progress.panel
        length = m.length[k, leg]
        begin = min(mesh.ends[segment - 1], length) if segment > 0 else 0.0
        end, panels, node = min(mesh.ends[segment], length), 0, -1
        if end > begin:
            panels = _panels(mesh, load * m.Omega[m.of[k]], segment, end - begin, length)
            if first == 0:
                set_moving(m, mesh, begin, room)
                set_rows(x, m.of[k], room, room.x_rows)
                set_rows(v, m.of[k], room, room.v_rows)
                if segment == 0:
                    progress.before, progress.latest = -1.0, -1.0
            last = min(first + PANELS, panels)
            closes = length if last == panels and end >= length else math.inf
            n = _set_nodes(mesh, first, last, begin, (end - begin) / panels, room, closes)
            if segment < mesh.shared.size:
                node = progress.node
                progress.node += n
            rows = set_basis(flow, m, mesh, n, node, room)
            impulse = m.impulse[k, leg] if node >= 0 else 0.0
            set_coordinates(x, impulse, leg, rows, n, node, room, room.x, room.x_rows)
            set_coordinates(v, impulse, leg, rows, n, node, room, room.v, room.v_rows)
            _add_squares(dofs, n, sums.squares[k], room)
            raise_peaks(flow, x, m, mesh, n, sums, room)
            if modes > 0:
                _add_energies(e, m.of[k], n, sums, room)
            sums.nodes[k] += n
            work += n * (_NODE + rows * (dofs + modes))
            first = last
        progress.panel = first
        if first >= panels:
            progress.segment, progress.panel = segment + 1, 0
            if end >= length:
                progress.leg, progress.segment, progress.node = leg + 1, 0, 0
                if progress.leg == m.length.shape[1]:
                    progress.solution, progress.leg = k + 1, 0
    return bool(progress.solution == m.of.size)
