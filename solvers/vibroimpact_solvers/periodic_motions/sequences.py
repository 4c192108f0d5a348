r"""Motions with several impacts per period, by Newton's method on phases and impulses.

The coordinate at the i-th impact and the law of Newton are

    level + y_F(t_i) + sum_j p_j g_ij(t_i - t_j) = wall_i,
    mu_i p_i / (1 + k_i) + y_F'(t_i) + sum_j p_j g_ij'(t_i - t_j) = 0,

g_ij being the response at i to one unit impulse per period at j, before the impact where i = j.
However many modes there are, these are 2 m equations for m times and m impulses. Without load
the motion may begin at any time: the first impact is at 0, and least squares take the equation
that is then left over by conservation of energy.
"""

from __future__ import annotations

import numpy as np

from vibroimpact_solvers.arrays import EPS, Floats
from vibroimpact_solvers.periodic_motions.drive import Driven
from vibroimpact_solvers.periodic_motions.pairs import ImpulseResponse
from vibroimpact_solvers.periodic_motions.problem import Problem
from vibroimpact_solvers.periodic_motions.solutions import Cells, Solutions

_STARTS = 48  # random sequences of phases at each frequency
_STEPS = 40
_CLOSE = 1e-13  # residual, relative to its terms, of a solution
_SAME = 1e-6  # difference of phases of equal solutions, rad
_LONGEST = 0.5  # of the period: largest change of a time in one step


def solutions(driven: Driven, cells: Cells, problem: Problem) -> Solutions:
    """Return the solutions that are reached from the starts, shape (solution, impact) each."""
    m = len(problem.impacts)
    parts = []
    before = np.empty((0, m))
    for k in range(cells.Omega.size):
        search = Search(driven, cells, problem, k)
        starts = np.concatenate([search.starts(), before])
        part = search.solutions(starts)
        before = part.phase
        parts.append(part)
    names = Solutions.__dataclass_fields__
    return Solutions(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


class Search:
    """The search at one frequency; one impact may be that of a symmetric motion.

    Parameters
    ----------
    driven : Driven
    cells : Cells
    problem : Problem
    k : int
        The frequency.
    """

    def __init__(self, driven: Driven, cells: Cells, problem: Problem, k: int) -> None:
        self.driven, self.problem, self.index = driven, problem, k
        self.cells = cells.at(np.array([k]))
        self.Omega, self.length = float(cells.Omega[k]), float(cells.length[k])
        impacts = problem.impacts
        self.struck = np.array([impact.constraint for impact in impacts])
        self.m = self.struck.size
        sides = np.array([impact.side for impact in impacts])
        self.walls = driven.walls[(sides > 0).astype(int), self.struck] - driven.level[self.struck]
        constraints = driven.structure.system.constraints
        k_of = np.array([constraints[a].restitution for a in self.struck])
        self.inertia = driven.mobility[self.struck, self.struck] / (1.0 + k_of)
        self.responses: list[ImpulseResponse] = [
            driven.pairs.impulse_response(
                self.cells.length, self.cells.rest, cells.sign, driven.kick[a]
            )
            for a in self.struck
        ]
        self.after = np.concatenate([r.after for r in self.responses])
        self.before = np.concatenate([r.before for r in self.responses])
        self.inexact = np.concatenate([r.error for r in self.responses]).max(axis=0)
        self.inexact = self.inexact + 2.0 * driven.shape_error
        self.forms = driven.position[self.struck], driven.velocity[self.struck]
        self.bend = driven.rates_of(self.forms[1])
        self.Y = np.einsum("isj,hsj->ih", self.forms[0], self.cells.steady[0])
        self.autonomous = driven.harmonics.size == 0

    def starts(self) -> Floats:
        """Return times of impacts to begin with, those of the request or random ones."""
        if self.problem.phases is not None:
            return np.asarray(self.problem.phases) / self.Omega
        rng = np.random.default_rng(self.m)
        times = np.sort(rng.random((_STARTS, self.m)), axis=1) * self.length
        return times - times[:, :1] if self.autonomous else times

    def solutions(self, times: Floats) -> Solutions:
        """Return the different solutions that Newton's method reaches."""
        impulses = np.zeros(times.shape)
        good = np.isfinite(self.after).all()
        if not good or times.shape[0] == 0:
            return self.collected(times[:0], impulses[:0])
        impulses = self._first_impulses(times)
        for _ in range(_STEPS):
            residual, jacobian, _ = self.equations(times, impulses)
            if self.autonomous:
                jacobian = np.delete(jacobian, self.m, axis=2)
                step = -np.einsum("sij,sj->si", np.linalg.pinv(jacobian), residual)
                step = np.insert(step, self.m, 0.0, axis=1)
            else:
                singular = ~np.isfinite(jacobian).all(axis=(1, 2))
                jacobian[singular] = np.eye(2 * self.m)
                step = -np.einsum("sij,sj->si", np.linalg.pinv(jacobian), residual)
            longest = np.abs(step[:, self.m :]).max(axis=1) / (_LONGEST * self.length / self.m)
            step /= np.maximum(1.0, longest)[:, np.newaxis]
            impulses, times = impulses + step[:, : self.m], times + step[:, self.m :]
        residual, _, size = self.equations(times, impulses)
        solved = (np.abs(residual) <= _CLOSE * size).all(axis=1)
        return self.collected(*self._different(times[solved], impulses[solved]))

    def _first_impulses(self, times: Floats) -> Floats:
        """Return the impulses that Newton's law gives for these times."""
        residual, jacobian, _ = self.equations(times, np.zeros(times.shape))
        if self.autonomous:
            laws, value = jacobian[:, : self.m, : self.m], residual[:, : self.m]
        else:
            laws, value = jacobian[:, self.m :, : self.m], residual[:, self.m :]
        return np.asarray(-np.einsum("sij,sj->si", np.linalg.pinv(laws), value))

    def equations(self, times: Floats, p: Floats) -> tuple[Floats, Floats, Floats]:
        """Return residuals, derivatives by impulses and times, and the sizes of their terms."""
        m, count = self.m, times.shape[0]
        apart = np.mod(times[:, :, np.newaxis] - times[:, np.newaxis, :], self.length)
        flows = self.driven.pairs.propagators(np.ascontiguousarray(apart.ravel()))
        flows = flows.reshape(count, m, m, *self.after.shape[1:])
        z = self.driven.pairs.move(flows, self.after[np.newaxis, np.newaxis])
        own = np.arange(m)
        g = np.einsum("isj,nimsj->nim", self.forms[0], z)
        g[:, own, own] = np.einsum("isj,isj->i", self.forms[0], self.after)
        rate = np.einsum("isj,nimsj->nim", self.forms[1], z)
        across = rate * (1.0 - np.eye(m))
        rate[:, own, own] = np.einsum("isj,isj->i", self.forms[1], self.before)
        bend = np.einsum("isj,nimsj->nim", self.bend, z) * (1.0 - np.eye(m))
        turning = self.Omega * self.driven.harmonics
        turned = self.Y * np.exp(1j * turning * times[..., np.newaxis])
        y, v, a = ((turned * (1j * turning) ** order).real.sum(axis=-1) for order in range(3))
        place = y + np.einsum("nij,nj->ni", g, p) - self.walls
        law = self.inertia * p + v + np.einsum("nij,nj->ni", rate, p)
        residual = np.concatenate([place, law], axis=1)
        jacobian = np.empty((count, 2 * m, 2 * m))
        jacobian[:, :m, :m] = g
        jacobian[:, m:, :m] = rate
        jacobian[:, m + own, own] += self.inertia
        for rows, change, along in ((slice(0, m), v, across), (slice(m, None), a, bend)):
            block = -along * p[:, np.newaxis, :]
            block[:, own, own] = change + np.einsum("nij,nj->ni", along, p)
            jacobian[:, rows, m:] = block
        size = np.concatenate(
            [
                np.abs(self.walls) + np.abs(self.Y).sum(axis=-1)
                + np.einsum("nij,nj->ni", np.abs(g), np.abs(p)),
                np.abs(self.Y) @ turning + np.einsum("nij,nj->ni", np.abs(rate), np.abs(p))
                + self.inertia * np.abs(p),
            ],
            axis=1,
        )  # fmt: skip
        return residual, jacobian, size

    def _different(self, times: Floats, impulses: Floats) -> tuple[Floats, Floats]:
        """Return each solution once, impacts in order, the first in the drive's first period."""
        drive = 2.0 * np.pi / self.Omega
        times = times - np.floor(times[:, :1] / drive) * drive
        after = times[:, :1] + np.mod(times - times[:, :1], self.length)
        ordered = (np.diff(after, axis=1) > 0.0).all(axis=1)
        times, impulses = after[ordered], impulses[ordered]
        kept: list[int] = []
        for row in range(times.shape[0]):
            apart = np.abs(times[kept] - times[row])
            if not (np.minimum(apart, self.length - apart) * self.Omega < _SAME).all(axis=1).any():
                kept.append(row)
        order = [kept[place] for place in np.argsort(times[kept, 0], kind="stable")]
        return times[order], impulses[order]

    def collected(self, times: Floats, p: Floats) -> Solutions:
        """Return the solutions with their states, and errors to first order."""
        count, m = times.shape
        residual, jacobian, size = self.equations(times, p)
        if self.autonomous:
            jacobian[:, :, m] = 0.0
        relative = float(self.inexact.max(initial=0.0)) + 16.0 * EPS
        doubt = np.abs(residual) + size * relative
        errors = np.einsum("nij,nj->ni", np.abs(np.linalg.pinv(jacobian)), doubt)
        lengths = np.diff(np.concatenate([times, times[:, :1] + self.length], axis=1), axis=1)
        apart = np.mod(times[:, :, np.newaxis] - times[:, np.newaxis, :], self.length)
        flows = self.driven.pairs.propagators(np.ascontiguousarray(apart.ravel()))
        z = self.driven.pairs.move(flows.reshape(count, m, m, *self.after.shape[1:]), self.after)
        z[:, np.arange(m), np.arange(m)] = self.after
        state = np.einsum("nimsj,nm->nisj", z, p)
        velocity = -self.inertia * p
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = (errors[:, :m] / np.abs(p)).max(axis=1, initial=0.0)
        speeds = self.driven.pairs.speed
        late = errors[:, m:].max(axis=1, initial=0.0)[:, np.newaxis] * speeds
        return Solutions(
            np.full(count, self.index), times * self.Omega, p, velocity, state, lengths,
            errors[:, m:] * self.Omega, errors[:, :m],
            errors[:, :m] * self.inertia, self.inexact + moved[:, np.newaxis] + late,
            np.zeros(count),
        )  # fmt: skip
