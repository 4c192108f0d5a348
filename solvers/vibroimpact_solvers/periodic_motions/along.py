"""Integrals and extremes along all solutions: what their kernel takes (`kernels.orbit_sums`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.kernels.orbit_sums import LEAST, PANELS, TURN, integrate
from vibroimpact_solvers.kernels.orbits import (
    DEAD,
    PROGRESS,
    TRENDS,
    Dissipation,
    Forms,
    Mesh,
    Motions,
    Room,
    Sums,
)
from vibroimpact_solvers.meter import look
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.fast import Fast, Shares
from vibroimpact_solvers.periodic_motions.outputs import Outputs
from vibroimpact_solvers.periodic_motions.peaks import Peaks
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions
from vibroimpact_solvers.periodic_motions.waveform import displacements

_NODES: Final = 12
_PLACES: Final = 0.5 * (np.polynomial.legendre.leggauss(_NODES)[0] + 1.0)
_WEIGHTS: Final = 0.5 * np.polynomial.legendre.leggauss(_NODES)[1]
_RATIO: Final = 1.5
"""Ratio of the ends of segments that follow one another; from 1.2 to 2 nodes differ by 10 %."""
_FIRST: Final = 0.25
"""End of the first segment over the time after which the first vibration is dead."""
_DEGREE: Final = 24.0
"""Power of the turn of a panel, twice the number of its nodes, to which Gauss' formula is off."""
_TABLE: Final = 2**24
"""Numbers of a table at most."""
_FEW: Final = 6
"""Solutions from which on a table is quicker than as many evaluations of all pairs, measured."""
_PIECE: Final = 2**20
"""Numbers that are there at once while a table is made."""
QUICKER: Final = 4.0
"""Times the rate of the load from which on vibrations may be fast."""
TURNED: Final = 60.0
"""Radians by which they turn in a free motion."""
_APART: Final = 0.5
"""Half the distance of both rates of overdamped vibrations, relative to their mean."""
PAYS: Final = 1.0
"""Operations of the quadrature for one of closed forms from which on these pay."""
SEARCH: Final = 6e6
SEARCHED: Final = 3e3
"""Operations for extremes of a free motion: of all, and of a form of a mode, measured."""
PRODUCT: Final = 2e3
"""And for its energies, of a product of two modes."""
_NODE: Final = 15.0
"""Operations of a coordinate at a node, besides those of the pairs."""
_LOOKS: Final = 64
"""Times in a free motion at which displacements are evaluated before their peaks are sought."""
_BELOW: Final = 1e-9
"""Part of their range by which what is known of extremes is lowered."""


@dataclass(frozen=True, eq=False, slots=True)
class Along:
    """What is evaluated along solutions, in the basis' units.

    Parameters
    ----------
    squares : array, shape (solution, dof)
        Integrals of the squares of displacements over a cell.
    sizes : array, shape (solution, dof)
        Bounds of the root mean squares of what was squared in closed form, of its moduli.
    peaks : array, shape (solution, 2, dof)
        The highest displacements, and minus the lowest ones.
    work, flow, dissipated : array, shape (solution,)
        Work of the load in a cell, a bound of the integral of the modulus of its power, losses by
        damping.
    speeds : array, shape (solution, mode)
        Bounds of the integrals of the moduli of modal velocities.
    nodes : array, shape (solution,)
    """

    squares: Floats
    sizes: Floats
    peaks: Floats
    work: Floats
    flow: Floats
    dissipated: Floats
    speeds: Floats
    nodes: Integers

    @classmethod
    def of(
        cls, problem: Problem, driven: Driven, outputs: Outputs, cells: Cells, solved: Solutions
    ) -> Along:
        """Integrate along solutions, whose responses are all bounded."""
        wanted = "extremes" in problem.outputs, "energy" in problem.outputs
        none = np.zeros((0, *outputs.x.shape[1:]))
        forms = [
            form if here else none
            for form, here in zip((outputs.x, outputs.rates), wanted, strict=True)
        ]
        fast, mesh = _divided(driven, cells, solved, len(forms[0]), len(forms[1]))
        struck = [impact.constraint for impact in problem.impacts][: solved.length.shape[1]]
        mesh, tables = _tables(driven, forms, mesh, struck)
        x, v = (_forms(driven, cells, *each) for each in zip(forms, tables, strict=True))
        x.trend[0] += outputs.still[: len(forms[0])]
        left = replace(solved, state=np.where(fast, 0.0, solved.state)) if fast.any() else solved
        motions = _motions(driven, cells, left)
        damping = np.zeros((0, outputs.load.shape[1]))
        if outputs.damping is not None:
            diagonal = np.diag(outputs.damping)
            apart = outputs.damping - np.diag(diagonal)
            damping = outputs.damping if apart.any() else diagonal[np.newaxis]
        change = Dissipation(
            outputs.load.copy(), damping.copy(), np.repeat(cells.amplification, 2, axis=1)
        )
        n, dofs, modes = solved.index.size, x.trend.shape[1], v.trend.shape[1]
        peaks = np.full((n, 2, dofs), -np.inf)
        if fast.any():
            peaks[:] = np.inf  # none are sought beside nodes
        elif dofs and mesh.ends[0] < solved.length.min():
            peaks = _reached(driven, outputs, cells, solved)
        sums = Sums(
            np.zeros((n, 2, dofs)), peaks, np.zeros((n, 2, 3)),
            np.zeros((n, modes)), np.zeros(n, dtype=np.int64),
        )  # fmt: skip
        room = _room(driven, dofs, modes)
        while not integrate(driven.pairs.flow, x, v, change, motions, mesh, sums, room):
            look()
        work, flow, dissipated = sums.energy.sum(axis=1).T
        along = cls(
            sums.squares.sum(axis=1), np.zeros((n, dofs)), sums.peaks, work, flow, dissipated,
            sums.speeds, sums.nodes,
        )  # fmt: skip
        if fast.any():
            shares = Fast(driven, fast, cells, x, v, change).shares(solved)
            peaks = Peaks(driven, cells, x).of(solved) if dofs else peaks
            return along.completed(shares, peaks)
        return along

    def completed(self, shares: Shares, peaks: Floats) -> Along:
        """Return these with what fast vibrations add, and with the extremes of all."""
        return Along(
            self.squares + shares.squares, shares.sizes, peaks, self.work + shares.work,
            self.flow + shares.flow, self.dissipated + shares.dissipated,
            self.speeds + shares.speeds, self.nodes,
        )  # fmt: skip


def _divided(
    driven: Driven, cells: Cells, solved: Solutions, dofs: int, modes: int
) -> tuple[Booleans, Mesh]:
    """Return which pairs are fast, those that cost less in closed form, and a mesh for the others.

    dofs and modes are the numbers of displacements and of modal velocities.
    """
    pairs, columns = driven.pairs, dofs + modes
    none = np.zeros(pairs.alpha.size, dtype=bool)
    mesh, fast = _mesh(driven, none, cells, solved, columns), none.copy()
    if not solved.phase.size:
        return none, mesh
    load = float(cells.Omega[solved.index].max() * driven.harmonics.max(initial=0.0))
    slowest = max(QUICKER * load, TURNED / float(solved.length.max()))
    fast[pairs.moving] = pairs.speed[pairs.moving] > slowest
    # Nearly critical ones are differences of exponentials that are almost equal.
    overdamped = (-pairs.growth > slowest) & (pairs.nu > _APART * np.abs(pairs.alpha))
    fast[pairs.hyperbolas] &= overdamped[pairs.hyperbolas]
    fast[pairs.parabolas] = False
    count = float(pairs.moving.size)
    closed = (SEARCH + SEARCHED * dofs * count) * (dofs > 0) + PRODUCT * count**2 * (modes > 0)
    closed *= solved.length.size
    followed = _operations(driven, mesh, solved, load, columns)
    if not fast.any() or not PAYS * closed < followed:
        return none, mesh
    slow = _mesh(driven, fast, cells, solved, columns)
    closed += _operations(driven, slow, solved, load, columns)
    return (fast, slow) if PAYS * closed < followed else (none, mesh)


def _operations(driven: Driven, mesh: Mesh, solved: Solutions, load: float, columns: int) -> float:
    """Return about how many operations the quadrature takes."""
    legs, impacts, length = solved.length.size, solved.length.shape[1], float(solved.length.max())
    begins = np.concatenate([[0.0], mesh.ends[:-1]])
    widths = np.minimum(mesh.ends, length) - np.minimum(begins, length)
    nodes = _NODES * np.maximum(np.maximum(mesh.speeds, load) / TURN, LEAST / length) * widths
    growth: Floats = driven.pairs.growth[driven.pairs.moving]
    alive = (growth * begins[:, np.newaxis] > -DEAD).sum(axis=1)
    shared, dies = int(mesh.shared.size), int(mesh.dies.sum())
    alive[:shared] = max(growth.size - dies, 0)
    table = 2.0 * dies * impacts * float(nodes[:shared].sum())
    each = float((nodes * (_NODE + 2.0 * alive)).sum())
    return float(columns * (table + legs * each))


def _mesh(driven: Driven, fast: Booleans, cells: Cells, solved: Solutions, columns: int) -> Mesh:
    """Return how the free motions of solutions are divided; columns are those of a table."""
    pairs = driven.pairs
    dies: Booleans = np.zeros(pairs.alpha.size, dtype=bool)
    ends, speeds = [math.inf], [0.0]
    shared: list[int] = []
    if solved.phase.size:
        ends, speeds = _segments(*pairs.rates(~fast))
        shortest = float(solved.length.min())
        load = float(cells.Omega[solved.index].max() * driven.harmonics.max(initial=0.0))
        begin = 0.0
        for end, speed in zip(ends, speeds, strict=True):
            if not end < shortest or solved.index.size < _FEW:
                break
            width = end - begin
            panels = math.ceil(max(max(speed, load) * width / TURN, LEAST * width / shortest))
            nodes = (1 + _NODES * (sum(shared) + panels)) * solved.length.shape[1]
            if nodes * columns > _TABLE:
                break
            shared.append(panels)
            begin = end
        some = slice(0, pairs.hyperbolas.stop)
        dies[some] = (~fast & (-pairs.growth * begin >= DEAD * (1.0 - 1e-9)))[some]
        if not dies.any():
            shared = []
    return Mesh(
        np.array(ends), np.array(speeds), np.array(shared, dtype=np.int64), pairs.growth, dies,
        np.zeros(dies.size, dtype=np.int64), np.zeros((0, 2, 0)), _PLACES, _WEIGHTS,
    )  # fmt: skip


def _segments(decays: Floats, moduli: Floats) -> tuple[list[float], list[float]]:
    """Return the ends of segments of free motions, and the rates that tell how long panels are.

    Gauss' formula is off by a power of the angle by which a product of vibrations turns in a
    panel, times their amplitudes. A vibration that is decayed to a = e^-d may thus turn by
    e^(d / 24) times as much, as (x_1 + x_2) / 2 <= (a_1 a_2)^(-1/24) if x_i <= a_i^(-1/24).
    """
    lasts = np.full(decays.size, np.inf)
    np.divide(DEAD, decays, out=lasts, where=decays > 0.0)
    finite = lasts[lasts < math.inf]
    ends = [_FIRST * float(finite.min())] if finite.size else []
    while ends and ends[-1] < finite.max():
        ends.append(_RATIO * ends[-1])
    begins = np.array([0.0, *ends])[:, np.newaxis]
    slowed = moduli * np.exp(-np.maximum(decays, 0.0) * begins / _DEGREE)
    speeds = np.where(lasts > begins, slowed, 0.0).max(axis=1, initial=0.0)
    return [*ends, math.inf], speeds.tolist()


def _times(mesh: Mesh) -> Floats:
    """Return the times of the nodes that all free motions share."""
    parts, begin = [np.zeros(min(1, mesh.shared.size))], 0.0
    for end, panels in zip(mesh.ends.tolist(), mesh.shared.tolist(), strict=False):
        width = (end - begin) / panels
        parts.append((begin + (np.arange(panels)[:, np.newaxis] + _PLACES) * width).ravel())
        begin = end
    return np.concatenate(parts)


def _tables(
    driven: Driven, forms: list[Floats], mesh: Mesh, struck: list[int]
) -> tuple[Mesh, tuple[Floats, Floats]]:
    """Return what unit impulses make of forms by the pairs that die, (impact, node, form) each.

    Also the mesh with the propagators of the other pairs at the same nodes.
    """
    pairs, times, dies = driven.pairs, _times(mesh), np.flatnonzero(mesh.dies)
    last = np.flatnonzero(~mesh.dies) if times.size else np.zeros(0, dtype=np.int64)
    lasting = np.empty((last.size, 2, times.size))
    flat = np.concatenate(forms)[:, :, dies].reshape(sum(map(len, forms)), 2 * dies.size).T
    table = np.zeros((len(struck), times.size, flat.shape[1]))
    step = max(1, _PIECE // (2 * pairs.alpha.size))
    back = np.where(dies < pairs.rotations.stop, -1.0, 1.0)
    moved = np.empty((min(step, times.size), 2, dies.size))
    for first in range(0, times.size, step):
        look()
        some = slice(first, min(first + step, times.size))
        propagators = pairs.propagators(times[some])
        lasting[..., some] = propagators[..., last].transpose(2, 1, 0)
        even, odd = propagators[..., dies].swapaxes(0, 1)
        here = moved[: len(even)]
        for impact, constraint in enumerate(struck):
            a, b = driven.kick[constraint][:, dies]
            here[:, 0] = even * a + odd * b
            here[:, 1] = even * b + odd * (back * a)
            table[impact, some] = here.reshape(len(here), 2 * dies.size) @ flat
    row = np.zeros(mesh.dies.size, dtype=np.int64)
    row[last] = np.arange(last.size)
    first = len(forms[0])
    return mesh._replace(row=row, lasting=lasting), (
        np.ascontiguousarray(table[..., :first]),
        np.ascontiguousarray(table[..., first:]),
    )


def _reached(driven: Driven, outputs: Outputs, cells: Cells, solved: Solutions) -> Floats:
    """Return extremes at a few times of each motion, the highest and minus the lowest ones.

    Peaks are sought beside nodes that are not below these values alone. Without them, a motion
    that grows from panel to panel would have peaks sought in each. Shape (solution, 2, dof).
    """
    parts = (np.arange(_LOOKS) + 0.5) / _LOOKS
    legs = np.repeat(np.arange(solved.length.shape[1]), _LOOKS)
    step = max(1, _PIECE // (legs.size * 2 * driven.pairs.alpha.size))
    peaks = np.empty((solved.index.size, 2, len(outputs.x)))
    for first in range(0, solved.index.size, step):
        look()
        rows = slice(first, min(first + step, solved.index.size))
        some = solved.at(np.arange(rows.start, rows.stop))
        times = (some.length[..., np.newaxis] * parts).reshape(-1, legs.size)
        x = displacements(driven, outputs, cells, some, np.tile(legs, (len(times), 1)), times)
        highest, lowest = x.max(axis=1) + outputs.still, x.min(axis=1) + outputs.still
        # Extremes themselves are those of the quadrature, whose roundings are others.
        below = _BELOW * (highest - lowest)
        peaks[rows, 0], peaks[rows, 1] = highest - below, -lowest - below
    return peaks


def _forms(driven: Driven, cells: Cells, form: Floats, table: Floats) -> Forms:
    """Return coordinates as sums over what moves."""
    shape = cells.Omega.size, 2 * driven.harmonics.size, len(form)
    amplitudes = np.tensordot(cells.steady, form, ((2, 3), (1, 2)))
    steady = np.stack([amplitudes.real, -amplitudes.imag], axis=2)
    return Forms(
        np.ascontiguousarray(form.transpose(2, 1, 0)), driven.balance.along(form),
        np.ascontiguousarray(steady.reshape(shape)), table,
    )  # fmt: skip


def _motions(driven: Driven, cells: Cells, solved: Solutions) -> Motions:
    """Return solutions as their kernel takes them."""
    n, legs = solved.length.shape
    moves = solved.phase.size > 0
    none = np.zeros((n, legs))
    return Motions(
        solved.index, np.ascontiguousarray(solved.phase) if moves else none,
        np.ascontiguousarray(solved.length), np.ascontiguousarray(solved.state),
        np.ascontiguousarray(solved.impulse) if moves else none, cells.Omega, driven.harmonics,
    )  # fmt: skip


def _room(driven: Driven, dofs: int, modes: int) -> Room:
    """Return room for the kernel's scratch."""
    pairs, nodes = driven.pairs.alpha.size, PANELS * _NODES + 2
    rows = TRENDS + 2 * driven.harmonics.size + 2 * pairs
    return Room(
        progress=np.zeros(1, PROGRESS),
        moving=np.zeros(pairs, dtype=np.int64),
        times=np.empty(nodes),
        weights=np.empty(nodes),
        basis=np.empty(rows * nodes),
        x_rows=np.empty(rows * dofs),
        v_rows=np.empty(rows * modes),
        x=np.empty(nodes * dofs),
        v=np.empty(nodes * modes),
        forces=np.empty(nodes * modes),
        dragged=np.empty(nodes * modes),
        squares=np.empty(dofs),
        least=np.empty(dofs),
        largest=np.empty(dofs),
        heat=np.empty(modes),
        last=np.empty((2, dofs)),
    )
