"""Normal form of the modal equations of a structure: pairs that move exactly (`kernels.flow`).

A basis belongs to a structure with the constrained DOFs in contact held fixed, or to the free one.
Modes that damping does not couple are a pair each; those that it couples are complex modes of
their first-order equations; loads are pairs of their own (`loads`). Everything else about the
structure is a linear form on the pairs: displacements, velocities, contact forces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroimpact_solvers.arrays import Booleans, Floats, Integers
from vibroimpact_solvers.kernels.flow import DRIVE, Flow
from vibroimpact_solvers.kernels.passages import LOW, ORDER
from vibroimpact_solvers.time_history.complex_modes import ComplexModes, complex_modes

COLUMNS: Final = 5
"""Deviations that are carried along where errors are estimated."""
_SLOW = 1e-2  # stiffness of a mode, the largest being about one, below which creeping counts whole
_NOISE = 16  # rows of signs that stand for rounding, half of them the others' negatives
_FEW = 4  # pairs up to which none are added
_REFINED = 128  # rows of a matrix of coupled modes up to which its inverse is refined
_LANES = 8  # numbers that a processor takes at a time: pairs are filled up to a multiple
_NEAR = 1e-3  # of its square, from a natural frequency, at which a load is in resonance
_ALWAYS = np.array([[1.0], [0.0]])  # a load that stays one
_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False, slots=True)
class Modes:
    """Modal equations ``q'' + damping q' + lambda q = load + cosine cos - sine sin``.

    Parameters
    ----------
    roots, rests : array, shape (mode,)
        Signed natural frequencies and what rounding took from them, relative to them.
    damping : array, shape (mode, mode), optional
        ``E^T C E``.
    load : array, shape (mode,)
        Constant load.
    frequencies : array, shape (load,)
    slow : array of bool, shape (load,)
        Those that turn by less than a radian until the end.
    cosine, sine : array, shape (mode, load)
        Harmonic loads.
    ramps : array, shape (mode, ramp)
        Directions of the sampled loads.
    ramp_start : array, shape (2, ramp)
        Their values and slopes at t = 0.
    shapes : array, shape (dof, mode)
        The modes as columns.
    base : array, shape (dof,)
        Displacement at which all modal coordinates are zero.
    weighted : array, shape (dof, mode)
        ``M E``, which takes displacements to modal coordinates.
    errors : array, shape (mode,)
        Absolute errors of the eigenvalues.
    damping_errors : array, shape (mode,)
        Absolute errors of the diagonal of the damping.
    shape_error : float
        Relative error of the shapes.
    neglected : float
        Largest part of a mode's motion that couplings by damping which are left out take to others.
    left_out : array, shape (mode, mode)
        Bounds of these couplings; (0, 0) without damping.
    kept : dict
        Complex modes that were computed of these equations or of the same with other loads.
    """

    roots: Floats
    rests: Floats
    damping: Floats | None
    load: Floats
    frequencies: Floats
    slow: Booleans
    cosine: Floats
    sine: Floats
    ramps: Floats
    ramp_start: Floats
    shapes: Floats
    base: Floats
    weighted: Floats
    errors: Floats
    damping_errors: Floats
    shape_error: float
    neglected: float
    left_out: Floats
    kept: dict[tuple[int, bool], tuple[tuple[Any, ...], ComplexModes]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, slots=True)
class _Pairs:
    """Rates of some pairs; kind is 0 for rotations, 1 hyperbolas, 2 parabolas."""

    kind: Integers
    alpha: Floats
    nu: Floats
    rest: Floats
    push: Floats


def _inverse(T: Floats) -> Floats:
    """Return the inverse of a matrix, whose small entries are as exact as the large ones.

    They are the velocities that a large deflection does not have; of long double products for as
    many rows as these take no time.
    """
    inverse = np.asarray(np.linalg.inv(T), dtype=np.float64)
    if len(T) <= _REFINED:
        residual = np.eye(len(T)) - T.astype(np.longdouble) @ inverse
        inverse += inverse @ residual.astype(np.float64)
    return inverse


class Basis:
    """Normal form of modal equations.

    Times are measured in units of ``2^-exponent`` and so are velocities, which keeps powers
    of frequencies within range and changes no digit.

    Parameters
    ----------
    modes : Modes
    exponent : int
    chains : bool
        Whether of complex modes that are almost equal one may drive the other, which keeps more
        digits; otherwise each moves by itself.

    Attributes
    ----------
    flow : Flow
        How the pairs move.
    condition : float
        Condition number of the complex modes; 1 where there are none.
    vector_error : float
        Their error, relative to their lengths.
    """

    def __init__(self, modes: Modes, exponent: int, *, chains: bool = True) -> None:
        self.modes, self.exponent, self._chained = modes, exponent, chains
        unit = math.ldexp(1.0, -exponent)
        self._roots = modes.roots * unit
        self._eigenvalues = self._roots * np.abs(self._roots)
        damping = np.zeros((0, 0)) if modes.damping is None else modes.damping * unit
        self.condition, self.vector_error = 1.0, 0.0
        self._mixing = np.zeros((2, 0, 0))
        self._single, self._coupled = _apart(damping, self._roots.size)
        self._omega = modes.frequencies * unit
        self._eigenvalue_errors = modes.errors * (unit**2 / _EPS)
        load = modes.load * unit**2
        pairs = [self._single_pairs(damping, load), self._coupled_pairs(damping)]
        self._follow_ramps(damping, modes.ramps * unit**2)
        pairs += self._load_pairs(damping, load, unit)
        pairs.append(_padding(sum(p.kind.size for p in pairs)))
        self._order = np.argsort(np.concatenate([p.kind for p in pairs]), kind="stable")
        self.alpha, self.nu, rest, self.push = (
            np.concatenate([getattr(p, name) for p in pairs])[self._order]
            for name in ("alpha", "nu", "rest", "push")
        )
        kinds = np.concatenate([p.kind for p in pairs])
        turning = int((kinds == 0).sum())
        self.flow = Flow(
            self.alpha,
            self.nu,
            rest,
            self.push,
            self._driven_pairs(),
            turning,
            int((kinds <= 1).sum()),
            bool(self.alpha.any()),
            float(self.alpha[:turning].max(initial=0.0)),
        )

    def _kept(self, compute: Callable[[], ComplexModes]) -> ComplexModes:
        """Return complex modes that were computed of the same equations, whatever the load was."""
        modes, key = self.modes, (self.exponent, self._chained)
        of = modes.roots, modes.damping, modes.errors, modes.damping_errors
        known = modes.kept.get(key)
        if known is None or any(a is not b for a, b in zip(known[0], of, strict=True)):
            known = modes.kept[key] = of, compute()
        return known[1]

    def without_chains(self) -> Basis:
        """Return the basis in which every complex mode moves by itself."""
        return Basis(self.modes, self.exponent, chains=False) if self._chains else self

    # -- construction of the pairs --

    def _single_pairs(self, damping: Floats, load: Floats) -> _Pairs:
        """Return the pairs of the modes that damping does not couple, in their order."""
        one = self._single
        delta = 0.5 * damping.diagonal()[one] if damping.size else np.zeros(one.size)
        self._delta: Floats = delta
        with np.errstate(divide="ignore", invalid="ignore"):
            self.still = np.where(self._eigenvalues != 0.0, load / self._eigenvalues, 0.0)
        # In the wider type where there is one, so that rounding nu costs no phase.
        roots = self._roots[one] * (1 + self.modes.rests[one].astype(np.longdouble))
        square = roots * np.abs(roots) - delta.astype(np.longdouble) ** 2
        kind = np.where(square > 0.0, 0, np.where(square < 0.0, 1, 2))
        exact = np.sqrt(np.abs(square))
        nu = exact.astype(np.float64)
        low = exact - nu
        # Of hyperbolas the slower rate, nu - delta, is what lasts: low makes their sum exact.
        apart = np.where(kind == 1, delta + exact, 1.0)
        low = np.where(kind == 1, -roots * np.abs(roots) / apart - (nu - delta), low)
        self._shares: Floats = np.where(
            kind == 1, np.abs(nu - delta) / np.where(nu > 0.0, nu, 1.0), 1.0
        )
        free = np.where((self._eigenvalues[one] == 0.0) & (delta == 0.0), load[one], 0.0)
        self._stretch: Floats = np.where(kind == 2, 1.0, nu)
        return _Pairs(kind, -delta, nu, low.astype(np.float64), free)

    def _coupled_pairs(self, damping: Floats) -> _Pairs:
        """Return the complex modes of the modes that damping couples."""
        some = self._coupled
        n, none = some.size, np.zeros(some.size)
        self._chains: list[tuple[int, int, complex]] = []
        if n == 0:
            self._T: Floats = np.zeros((0, 0))
            self._inverse, self._coupled_sizes = self._T, none
            return _Pairs(np.zeros(0, np.int64), none, none, none, none)
        A = np.block(
            [
                [np.zeros((n, n)), np.eye(n)],
                [-np.diag(self._eigenvalues[some]), -damping[np.ix_(some, some)]],
            ]
        )
        norm = np.concatenate([np.maximum(np.abs(self._eigenvalues[some]), 1e-8), np.ones(n)])
        doubt = np.zeros(A.shape)
        doubt[n:, :n] = np.diag(_EPS * self._eigenvalue_errors[some])
        of_damping = math.ldexp(1.0, -self.exponent) * self.modes.damping_errors[some]
        doubt[n:, n:] = np.sqrt(np.outer(of_damping, of_damping))
        modes = self._kept(lambda: complex_modes(A, np.sqrt(norm), doubt, chained=self._chained))
        sigma, vectors, upper, real = modes.rates, modes.vectors, modes.oscillating, modes.real
        self.condition, self.vector_error = modes.condition, modes.vector_error
        self._mixing = _of_both(modes)
        first = [vectors[:, upper].real]
        second = [vectors[:, upper].imag]
        # Real rates in pairs, from the slowest decay to the fastest.
        fast, slow = real[0::2], real[1::2]
        first.append(vectors[:, fast].real + vectors[:, slow].real)
        second.append(vectors[:, fast].real - vectors[:, slow].real)
        columns: Floats = np.stack([np.concatenate(first, axis=1), np.concatenate(second, axis=1)])
        lengths = np.sqrt((columns**2 * norm[:, np.newaxis]).sum(axis=(0, 1)) / 2.0)
        columns /= lengths
        # Displacements of free bodies that drag couples are small differences of long pairs, and
        # so are those of modes that creep: in the norm of energy they would hardly count.
        creeps = np.arange(n) >= upper.size
        soft = np.abs(self._eigenvalues[some])[:, np.newaxis] <= np.where(creeps, _SLOW, 0.0)
        whole = np.where(np.tile(soft, (2, 1)), 1.0, norm[:, np.newaxis])
        self._coupled_sizes = (columns**2 * whole).sum(axis=(0, 1)) / 2.0
        self._chains = [
            (i, k, kappa * complex(lengths[i] / lengths[k])) for i, k, kappa in modes.chains
        ]
        either = np.maximum(modes.errors[fast], modes.errors[slow])
        self._rate_errors = np.concatenate([modes.errors[upper], either])
        self._T = np.concatenate([columns[0], columns[1]], axis=1)
        self._inverse = _inverse(self._T)
        alpha = [sigma[upper].real, 0.5 * (sigma[fast] + sigma[slow]).real]
        nu = [sigma[upper].imag, 0.5 * (sigma[fast] - sigma[slow]).real]
        kind = [np.zeros(upper.size, np.int64), np.ones(fast.size, np.int64)]
        return _Pairs(
            np.concatenate(kind), np.concatenate(alpha), np.concatenate(nu), none, none.copy()
        )

    def _follow_ramps(self, damping: Floats, ramps: Floats) -> None:
        """Set what sampled loads (V, V') do: responses ``along V + behind V'``, or drives.

        Rigid-body modes have no such response, nor have modes that damping couples to them.
        """
        self._along: Floats = np.zeros(ramps.shape)
        self._behind: Floats = np.zeros(ramps.shape)
        self._pushed: list[tuple[int, int, float, float]] = []
        one, some, stiffness = self._single, self._coupled, self._eigenvalues[:, np.newaxis]
        elastic = one[self._eigenvalues[one] != 0.0]
        self._along[elastic] = ramps[elastic] / stiffness[elastic]
        slower = 2.0 * self._delta[self._eigenvalues[one] != 0.0, np.newaxis]
        self._behind[elastic] = -slower * self._along[elastic] / stiffness[elastic]
        for i, r in np.argwhere(
            (self._eigenvalues[one] == 0.0)[:, np.newaxis] & (ramps[one] != 0.0)
        ):
            self._pushed.append((int(i), int(r), 0.0, float(ramps[one[i], r])))
        if (self._eigenvalues[some] != 0.0).all():
            self._along[some] = ramps[some] / stiffness[some]
            drag = damping[np.ix_(some, some)] @ self._along[some] if some.size else ramps[some]
            self._behind[some] = -drag / stiffness[some]
            return
        pushes = (self._inverse[:, some.size :] @ ramps[some]).reshape(2, some.size, -1)
        for i, r in np.argwhere(pushes.any(axis=0)).tolist():
            self._pushed.append((one.size + i, r, float(pushes[0, i, r]), float(pushes[1, i, r])))

    def _load_pairs(self, damping: Floats, load: Floats, unit: float) -> list[_Pairs]:
        """Return the pairs of the loads; keep the responses to them, shape (mode, load)."""
        count, omega = self._omega.size, self._omega
        force = (self.modes.cosine + 1j * self.modes.sine) * unit**2
        self._response = np.zeros(force.shape, dtype=np.complex128)
        self._response_rate, self._response_doubt = self._response, np.zeros(force.shape)
        self._near = self._slow = np.zeros((self._single.size, count), dtype=bool)
        if count:
            one, some = self._single, self._coupled
            stiffness = self._eigenvalues[one, np.newaxis] - omega**2
            stiffness = stiffness + 2j * self._delta[:, np.newaxis] * omega
            swings = (self._stretch > 0.0) & (self._eigenvalues[one] > self._delta**2)
            self._near = (np.abs(stiffness) < _NEAR * omega**2) & (force[one] != 0.0)
            self._near &= swings[:, np.newaxis]
            # A rigid body has a steady response to a slow load that is larger than its motion.
            rigid = self._eigenvalues[one, np.newaxis] == 0.0
            self._slow = rigid & self.modes.slow & (force[one] != 0.0)
            none = self._near | self._slow | (force[one] == 0.0)
            # Divided by the load's frequency where the rest is driven, else by the stiffness.
            part = np.where(self._slow, 0.0, force[one]) / np.where(none, 1.0, stiffness)
            stretch = self._stretch[:, np.newaxis]
            half = -0.5j * force[one]
            half = half / (-self._delta[:, np.newaxis] - 1j * stretch - 1j * omega)
            self._response[one] = np.where(self._near, half / stretch, part)
            # Roundings of a stiffness are relative to the terms of which it is a difference.
            terms = np.abs(self._eigenvalues[one, np.newaxis]) + omega**2
            terms = 2.0 * terms + self._eigenvalue_errors[one, np.newaxis]
            rounded = 2.0 + np.where(none, 2.0, terms / np.where(none, 1.0, np.abs(stiffness)))
            self._response_doubt[one] = rounded * np.abs(self._response[one])
            self._couplings = np.where(self._near, -0.5j * force[one], force[one])
            for k in range(count if some.size else 0):
                matrix = np.diag(self._eigenvalues[some] - omega[k] ** 2)
                dynamic = matrix + 1j * omega[k] * damping[np.ix_(some, some)]
                self._response[some, k] = np.linalg.solve(dynamic, force[some, k])
                residual = np.abs(dynamic) @ np.abs(self._response[some, k])
                self._response_doubt[some, k] = 4.0 * np.abs(np.linalg.inv(dynamic)) @ residual
            self._response_rate = 1j * omega * self._response
            slope = (-1j - self._delta[:, np.newaxis] / stretch) * half
            self._response_rate[one] = np.where(self._near, slope, self._response_rate[one])
        none = np.zeros(count)
        pairs = [_Pairs(np.zeros(count, np.int64), none, omega, none, none)]
        if self._push_sliding_bodies(load):
            self._along, self._behind = (
                np.concatenate([part, np.zeros((load.size, 1))], axis=1)
                for part in (self._along, self._behind)
            )
        none = np.zeros(self._along.shape[1])
        pairs.append(_Pairs(np.full(none.size, 2), none, none, none, none))
        return pairs

    def _push_sliding_bodies(self, load: Floats) -> bool:
        """Let a constant load drive the rigid-body modes that damping slows.

        Return whether there are any. Their terminal velocity would do as well, but for the digits
        that go where drag is faint.
        """
        one, some, last = self._single, self._coupled, self._along.shape[1]
        slides = (self._eigenvalues[one] == 0.0) & (self._delta != 0.0) & (load[one] != 0.0)
        pushed = [(int(i), last, 0.0, float(load[one[i]])) for i in np.flatnonzero(slides)]
        rigid = np.where(self._eigenvalues[some] == 0.0, load[some], 0.0)
        if rigid.any():
            parts = (self._inverse[:, some.size :] @ rigid).reshape(2, some.size)
            pushed += [(one.size + i, last, float(a), float(b)) for i, (a, b) in enumerate(parts.T)]
        self._pushed += pushed
        return bool(pushed)

    def _driven_pairs(self) -> NDArray[np.void]:
        """Return the pairs that others drive."""
        first = self._single.size
        drives = [(first + i, first + k, kappa) for i, k, kappa in self._chains]
        for mode, load in np.argwhere(self._near | self._slow).tolist():
            start = first + self._coupled.size
            drives.append((mode, start + load, complex(self._couplings[mode, load])))
        place = np.argsort(self._order)
        rows = [(place[i], place[k], kappa.real, kappa.imag) for i, k, kappa in drives]
        ramp = first + self._coupled.size + self._omega.size
        rows += [(place[i], place[ramp + r], a, b) for i, r, a, b in self._pushed]
        return np.array(rows, DRIVE)

    def drives(self) -> Iterator[tuple[int, int, float, float]]:
        """Return the pair, the load's pair and kappa of every drive but those of ramps."""
        last = self.flow.hyperbolas_end
        yield from (drive for drive in self.flow.drives.tolist() if drive[1] < last)

    def pushes(self) -> Iterator[tuple[int, int, float, float]]:
        """Return the pair, the ramp's pair and kappa of every drive of a ramp."""
        last = self.flow.hyperbolas_end
        yield from (drive for drive in self.flow.drives.tolist() if drive[1] >= last)

    # -- arrays for the kernels --

    @property
    def pairs(self) -> int:
        """Their number."""
        return int(self.nu.size)

    @cached_property
    def own(self) -> Floats:
        """0 for the pairs of loads and 1 for the others, shape (2, pair)."""
        return np.tile(np.where(self._order < self._loads.start, 1.0, 0.0), (2, 1))

    @cached_property
    def grain(self) -> Floats:
        """What z1 is of a unit displacement of a mode that creeps, at most 1, shape (pair,).

        It is nu q: of faint drag, or of damping that is almost critical, much less than q. 1 of
        all others.
        """
        grain, one = np.ones(self.pairs), self._single.size
        creeps = self.flow.rotations <= self._places[:one]
        creeps &= self._places[:one] < self.flow.hyperbolas_end
        grain[:one] = np.where(creeps, np.minimum(1.0, self._stretch), 1.0)
        return grain[self._order]

    @cached_property
    def measure(self) -> Floats:
        """Weights of the squares of the pairs in the length of a deviation, shape (2, pair)."""
        measure = np.zeros(self.pairs)
        measure[: self._single.size] = 1.0
        measure[self._single.size : self._loads.start] = np.maximum(self._coupled_sizes, 1.0)
        measure = measure[self._order]
        return np.stack([measure / self.grain**2, measure])

    @cached_property
    def carried(self) -> Floats:
        """What constant loads and then each number of the pairs of loads make of the others.

        Shape (1 + 2 load, 2, pair); none where there are neither.
        """
        count = self._loads.stop - self._loads.start
        if count == 0 and not self.still.any():
            return np.zeros((0, 2, self.pairs))
        units = np.eye(2 * count).reshape(2 * count, count, 2).transpose(0, 2, 1)
        q, rate = self._carried(units)
        rows = [(self.still, np.zeros(self._roots.size)), *zip(q, rate, strict=True)]
        return np.array([self.pairs_of(*row) for row in rows])

    @cached_property
    def load_places(self) -> Integers:
        """The pairs of the loads that carry something, shape (load,)."""
        return self._places[self._loads].astype(np.int64)

    @cached_property
    def doubts(self) -> tuple[Floats, float]:
        """Errors of the loads by those of the responses, and of what constant loads carry.

        Relative, in units of 2^-52: shape (pair,), and a number.
        """
        size = np.abs(self._eigenvalues)
        rounded = 2.0 + self._eigenvalue_errors / np.where(size > 0.0, size, np.inf)
        stretch = self.stretch
        along = rounded[:, np.newaxis] * np.abs(self._along)

        def largest(errors: Floats, values: Any) -> Floats:
            errors, values = (
                (stretch[:, np.newaxis] * np.abs(part)).max(axis=0, initial=0.0)
                for part in (errors, values)
            )
            return np.where(values > 0.0, errors / np.where(values > 0.0, values, 1.0), 2.0)

        each = largest(self._response_doubt, self._response), largest(along, self._along)
        doubts = np.zeros(self.pairs)
        doubts[self._loads] = np.concatenate(each)
        still = self.still[:, np.newaxis]
        return doubts[self._order], float(largest(rounded[:, np.newaxis] * still, still)[0])

    def length(self, z: Floats) -> float:
        """Return the length of a whole deviation, shape (2, pair), with what loads carry of it."""
        return float(np.sqrt((self.measure * self.whole(z, level=0.0) ** 2).sum()))

    def whole(self, z: Floats, *, level: float) -> Floats:
        """Return states with what loads carry of them, shape (…, 2, pair), 0 for the loads' pairs.

        level is 1 for states and 0 for deviations, which constant loads do not act on.
        """
        whole = self.own * z
        if len(self.carried):
            numbers = np.swapaxes(z[..., self.load_places], -1, -2).reshape(*z.shape[:-2], -1)
            whole = whole + level * self.carried[0] + np.tensordot(numbers, self.carried[1:], 1)
        return np.asarray(whole)

    @cached_property
    def weights(self) -> Floats:
        """Weights of the pairs in the size of a state, shape (pair,): loads by their response."""
        moves = np.abs(self._response).max(axis=0, initial=0.0)
        moves *= float(np.abs(self._roots).max(initial=0.0))
        moves = np.maximum(moves, np.abs(self._response_rate).max(axis=0, initial=0.0))
        weights = np.zeros(self.pairs)
        weights[: self._loads.start] = 1.0
        along = np.maximum(np.abs(self._along), np.abs(self._behind)).max(axis=0, initial=0.0)
        weights[self._loads] = np.concatenate([moves, along])
        return weights[self._order]

    @cached_property
    def stretch(self) -> Floats:
        """Of every mode, z1 over its coordinate, shape (mode,); 1 where it is not one pair."""
        return self._of_modes(self._stretch, 1.0)

    @cached_property
    def delta(self) -> Floats:
        """Half the damping of every mode that is one pair, shape (mode,)."""
        return self._of_modes(self._delta, 0.0)

    @cached_property
    def place(self) -> Integers:
        """The pairs of the modes, shape (mode,); negative where it is not one pair."""
        return self._of_modes(self._places[: self._single.size], -1.0).astype(np.int64)

    @cached_property
    def others(self) -> Integers:
        """The pairs of loads and of modes that damping couples, shape (other,)."""
        return self._places[self._single.size : self._loads.stop].astype(np.int64)

    def made_by_others(self) -> Floats:
        """Return coordinates and rates that `others` make, shape (2 other, 2 mode)."""
        count = self.others.size
        if count == 0:
            return np.zeros((0, 2 * self._roots.size))
        units = np.zeros((2, count, 2, self.pairs))
        each = np.arange(count)
        for of in (0, 1):
            units[of, each, of, self.others] = 1.0
        return np.concatenate(self.coordinates(units.reshape(-1, 2, self.pairs)), axis=1)

    def start_of_others(self) -> Floats:
        """Return how `others` start, shape (2 other, 2 mode + 1).

        Of the coordinates and the rates that the loads leave to them, and of 1.
        """
        modes, count = self._roots.size, self.others.size
        start = np.zeros((2 * count, 2 * modes + 1))
        if count:
            some, first = self._coupled, slice(0, self._coupled.size)
            rows = start.reshape(2, count, 2 * modes + 1)
            inverse = self._inverse.reshape(2, some.size, 2 * some.size)
            rows[:, first, some] = inverse[..., : some.size]
            rows[:, first, modes + some] = inverse[..., some.size :]
            rows[:, some.size :, -1] = self.loads_at_start()[:, : count - some.size]
        return start

    def _of_modes(self, values: Any, otherwise: float) -> Floats:
        """Return values of the modes that are one pair, and others otherwise, shape (mode,)."""
        every = np.full(self._roots.size, otherwise)
        every[self._single] = values
        return every

    @cached_property
    def _places(self) -> Integers:
        """Where the pairs are, by their order of construction."""
        return np.argsort(self._order)

    @cached_property
    def structural(self) -> Integers:
        """The pairs that belong to modes, neither to loads nor to the padding, ascending."""
        return np.flatnonzero(self._order < self._loads.start).astype(np.int64)

    @property
    def mixing(self) -> Floats:
        """What errors of complex modes mix of pair p into k, ``[:, k, p]``, (2, pair, pair).

        Share of k in the vector of p, and how p drives k of nearly the same rate.
        """
        mixing = np.zeros((2, self.pairs, self.pairs))
        one, some = self._single.size, self._coupled.size
        mixing[:, one : one + some, one : one + some] = self._mixing
        return mixing[:, self._order[:, np.newaxis], self._order]

    @cached_property
    def signs(self) -> Floats:
        """Signs drawn at random, none on the average, shape (row, 2, pair)."""
        signs = np.random.default_rng(0).integers(0, 2, (_NOISE // 2, 2, self.pairs)) * 2.0 - 1.0
        return np.concatenate([signs, -signs])

    @cached_property
    def drifts(self) -> Floats:
        """Errors of the frequencies, in units of 2^-52, shape (column, pair), of random sign."""
        drifts = np.zeros((COLUMNS, self.pairs))
        one, some = self._single, self._coupled
        unit = math.ldexp(1.0, -2 * self.exponent)
        stretch = np.where(self._stretch > 0.0, self._stretch, 1.0)
        # A rate sqrt(|lambda - delta^2|) of a damped mode carries the error of delta too, the
        # slower one of an overdamped mode as little of it as it is slower.
        damping = math.ldexp(1.0, -self.exponent) * self.modes.damping_errors[one] / (2.0 * _EPS)
        error = unit * self.modes.errors[one] / (2.0 * stretch * _EPS)
        error += self._shares * (self._delta + damping)
        error += self._shares * stretch * float(np.finfo(np.longdouble).eps) / _EPS  # of the root
        drifts[:, : one.size] = error
        if some.size:
            drifts[:, one.size : one.size + some.size] = self._rate_errors / _EPS
        signs = np.random.default_rng(1).choice([-1.0, 1.0], drifts.shape)
        return np.ascontiguousarray((signs * drifts)[:, self._order])

    def form_errors(
        self, forms: Floats, slopes: Floats, kicks: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return errors of coordinates, velocities and kicks, each (column, row, 2, pair).

        In units of 2^-52. All are those of the same rows ``w E`` of the modes, so that the motion
        is that of another coordinate, whose mobility goes with its kick.
        """
        shape_error = 2.0 * (1.0 + (self.modes.shape_error + self.vector_error) / _EPS)
        signs = np.random.default_rng(2).choice([-1.0, 1.0], (COLUMNS, len(kicks), 1, self.pairs))
        errors = shape_error * signs
        own = (slopes * kicks).sum(axis=(1, 2))
        along = (errors * slopes * kicks).sum(axis=(2, 3)) / np.where(own == 0.0, 1.0, own)
        kick_errors = (errors - 2.0 * along[..., np.newaxis, np.newaxis]) * kicks
        return errors * forms, errors * slopes, kick_errors

    @cached_property
    def longest(self) -> float:
        """The longest time of the basis in which no pair grows more than e-fold."""
        hyperbolas = slice(self.flow.rotations, self.flow.hyperbolas_end)
        rates = np.concatenate([self.alpha, (self.alpha + self.nu)[hyperbolas]])
        growth = float(rates.max(initial=0.0))
        return 1.0 / growth if growth > 0.0 else math.inf

    # -- states --

    def loads_at_start(self) -> Floats:
        """Return the state of the loads at t = 0, and of a constant one, shape (2, load + 1)."""
        harmonic = np.array([np.ones(self._omega.size), np.zeros(self._omega.size)])
        return np.concatenate([harmonic, self._ramp_state(self.modes.ramp_start), _ALWAYS], axis=1)

    def loads_of(self, z: Floats) -> Floats:
        """Return the loads in a state, and a constant one, which not every basis needs."""
        start = self._loads.start
        loads = self._natural(z)[:, start : self._ramps.stop]
        return np.concatenate([loads, _ALWAYS], axis=1)

    def _ramp_state(self, values_and_slopes: Floats) -> Floats:
        """Return values and slopes of ramps, the latter by the basis' time."""
        values, slopes = values_and_slopes
        return np.stack([values, math.ldexp(1.0, -self.exponent) * slopes])

    def set_ramps(self, z: Floats, values_and_slopes: Floats) -> None:
        """Let other ramps act on a state, and on deviations that go with it, in place.

        Displacements and velocities stay what they are; deviations get the errors of the ramps
        and roundings of the change of the state. z has shape (1 + deviation, 2, pair).
        """
        new, ramps = self._ramp_state(values_and_slopes), self._ramps
        jump = 2.0 * np.abs(self._replace(z[0], ramps, new))
        for column, deviation in enumerate(z[1:], start=1):
            signs = self.signs[column % len(self.signs)]
            place = self._places[ramps]
            self._replace(deviation, ramps, self.doubts[0][place] * np.abs(new) * signs[:, place])
            deviation += jump * signs

    def doubt_loads(self, z: Floats) -> None:
        """Let the loads of deviations be unknown, in place; displacements and velocities stay."""
        place = self.load_places
        if len(z) == 1:
            return
        sizes = self.doubts[0][place] * np.hypot(*z[0][:, place])
        for column, deviation in enumerate(z[1:] if place.size else (), start=1):
            signs = self.signs[column % len(self.signs)]
            self._replace(deviation, self._loads, sizes * signs[:, place])

    def _replace(self, state: Floats, loads: slice, to: Floats) -> Floats:
        """Replace some loads of a state, in place; return the change of the other pairs."""
        place = self._places[loads]
        change = np.zeros((2, self._loads.stop - self._loads.start))
        first = self._loads.start
        change[:, loads.start - first : loads.stop - first] = to - state[:, place]
        moved, moving = self._carried(change)
        pairs = self.pairs_of(-moved, -moving)
        state += pairs
        state[:, place] = to
        return pairs

    @cached_property
    def _ramps(self) -> slice:
        start = self._loads.start + self._omega.size
        return slice(start, start + self.modes.ramps.shape[1])

    def pairs_of(self, q: Floats, rate: Floats, loads: Floats | None = None) -> Floats:
        """Return the state, shape (2, pair), of modal coordinates from the equilibrium.

        q and their rates, per unit of the basis' time, have shape (mode,); loads is the state of
        the loads and of a constant one, absent for a deviation, which does not depend on them.
        """
        state = np.zeros((2, self.pairs))
        if loads is not None:
            loads = loads[:, : self._loads.stop - self._loads.start]
            state[:, self._loads] = loads
            moved, moving = self._carried(loads)
            q, rate = q - moved, rate - moving
        one, some = self._single, self._coupled
        state[0, : one.size] = q[one] * self._stretch
        state[1, : one.size] = rate[one] + self._delta * q[one]
        if some.size:
            both = self._inverse @ np.concatenate([q[some], rate[some]])
            state[:, one.size : one.size + some.size] = both.reshape(2, some.size)
        return np.take(state, self._order, axis=1)

    def coordinates(self, z: Floats) -> tuple[Floats, Floats]:
        """Return modal coordinates from the equilibrium and their rates, each (…, mode)."""
        natural = self._natural(z)
        one, some = self._single, self._coupled
        q: Floats = np.zeros((*z.shape[:-2], self._roots.size))
        rate: Floats = np.zeros_like(q)
        place = natural[..., 0, : one.size] / self._stretch
        q[..., one] = place
        rate[..., one] = natural[..., 1, : one.size] - self._delta * place
        if some.size:
            pairs = natural[..., one.size : one.size + some.size]
            n = some.size
            first, second = self._T[:n], self._T[n:]
            q[..., some] = pairs[..., 0, :] @ first[:, :n].T + pairs[..., 1, :] @ first[:, n:].T
            rate[..., some] = (
                pairs[..., 0, :] @ second[:, :n].T + pairs[..., 1, :] @ second[:, n:].T
            )
        if self._loads.start < self._loads.stop:
            moved, moving = self._carried(natural[..., self._loads])
            q += moved
            rate += moving
        return q, rate

    def magnitudes(self, z: Floats) -> tuple[Floats, Floats]:
        """Return the sums of the magnitudes of what `coordinates` are made of, each (mode,)."""
        natural = self._natural(z)
        moved, moving = self._carried(natural[:, self._loads])
        q, rate = np.abs(moved) + np.abs(self.still), np.abs(moving)
        one, some = self._single, self._coupled
        place = np.abs(natural[0, : one.size] / self._stretch)
        q[one] += place
        rate[one] += np.abs(natural[1, : one.size]) + np.abs(self._delta) * place
        pairs = np.abs(natural[:, one.size : one.size + some.size]).ravel()
        first, second = np.abs(self._T[: some.size]), np.abs(self._T[some.size :])
        q[some] += first @ pairs
        rate[some] += second @ pairs
        return q, rate

    def rate(self, z: Floats) -> Floats:
        """Return the rate of a state, loads included."""
        rate = self.drift(z)
        rate[1] += self.push
        return rate

    @cached_property
    def _loads(self) -> slice:
        start = self._single.size + self._coupled.size
        return slice(start, start + self._omega.size + self._along.shape[1])

    def _natural(self, z: Floats) -> Floats:
        """Return pairs in their order of construction: modes, complex modes, loads."""
        return np.take(z, self._places, axis=-1)

    def _carried(self, loads: Floats) -> tuple[Floats, Floats]:
        """Return the response to the loads in modal coordinates and rates; loads (…, 2, load)."""
        H, count = self._response, self._omega.size
        a, b = loads[..., 0, :count], loads[..., 1, :count]
        q = a @ H.real.T + b @ H.imag.T
        rate = a @ self._response_rate.real.T + b @ self._response_rate.imag.T
        if not self._along.size:
            return q, rate
        value, slope = loads[..., 0, count:], loads[..., 1, count:]
        q = q + value @ self._along.T + slope @ self._behind.T
        return q, rate + slope @ self._along.T

    # -- linear forms --

    def displacement(self, rows: Floats) -> Floats:
        """Return the form of ``rows . q``, shape (row, 2, pair), of rows (row, mode)."""
        forms = np.zeros((rows.shape[0], 2, self.pairs))
        one, some = self._single.size, self._coupled.size
        forms[:, 0, :one] = rows[:, self._single] / self._stretch
        coupled = rows[:, self._coupled] @ self._T[:some]
        forms[:, :, one : one + some] = coupled.reshape(rows.shape[0], 2, some)
        H, count = self._response, self._omega.size
        forms[:, 0, one + some : one + some + count] = rows @ H.real
        forms[:, 1, one + some : one + some + count] = rows @ H.imag
        forms[:, 0, self._loads.start + count : self._loads.stop] = rows @ self._along
        forms[:, 1, self._loads.start + count : self._loads.stop] = rows @ self._behind
        return np.ascontiguousarray(forms[..., self._order])

    def velocity(self, rows: Floats) -> Floats:
        """Return the form of ``rows . q'`` per unit of the basis' time."""
        forms = np.zeros((rows.shape[0], 2, self.pairs))
        one, some = self._single.size, self._coupled.size
        forms[:, 0, :one] = -rows[:, self._single] * self._delta / self._stretch
        forms[:, 1, :one] = rows[:, self._single]
        coupled = rows[:, self._coupled] @ self._T[some:]
        forms[:, :, one : one + some] = coupled.reshape(rows.shape[0], 2, some)
        H, count = self._response_rate, self._omega.size
        forms[:, 0, one + some : one + some + count] = rows @ H.real
        forms[:, 1, one + some : one + some + count] = rows @ H.imag
        forms[:, 1, self._loads.start + count : self._loads.stop] = rows @ self._along
        return np.ascontiguousarray(forms[..., self._order])

    def load(self, cosine: Floats, sine: Floats, ramps: Floats) -> Floats:
        """Return the form of loads ``cosine cos(omega t) - sine sin(omega t) + ramps V``."""
        forms = np.zeros((cosine.shape[0], 2, self.pairs))
        start = self._single.size + self._coupled.size
        forms[:, 0, start : start + self._omega.size] = cosine
        forms[:, 1, start : start + self._omega.size] = sine
        forms[:, 0, self._ramps] = ramps
        return np.ascontiguousarray(forms[..., self._order])

    def kick(self, rows: Floats) -> Floats:
        """Return the change of state by unit impulses along rows, shape (row, 2, pair)."""
        kicks = np.zeros((rows.shape[0], 2, self.pairs))
        one, some = self._single.size, self._coupled.size
        kicks[:, 1, :one] = rows[:, self._single]
        coupled = rows[:, self._coupled] @ self._inverse[:, some:].T
        kicks[:, :, one : one + some] = coupled.reshape(rows.shape[0], 2, some)
        return np.ascontiguousarray(kicks[..., self._order])

    def level(self, rows: Floats) -> Floats:
        """Return ``rows . q`` at the zero of the state, shape (row,)."""
        return np.asarray(rows @ self.still)

    def drift(self, z: Floats) -> Floats:
        """Return the rates, without pushes, of states, shape (…, 2, pair)."""
        a, b = z[..., 0, :], z[..., 1, :]
        there, back = self._turns
        rate = np.stack([self.alpha * a + there * b, self.alpha * b + back * a], axis=-2)
        for j, k, real, imaginary in self.drives():
            if j >= self.flow.rotations:
                rate[..., 1, j] += real * z[..., 0, k] + imaginary * z[..., 1, k]
                continue
            rate[..., 0, j] += real * z[..., 0, k] + imaginary * z[..., 1, k]
            rate[..., 1, j] += real * z[..., 1, k] - imaginary * z[..., 0, k]
        for j, k, first, second in self.pushes():
            rate[..., 0, j] += first * z[..., 0, k]
            rate[..., 1, j] += second * z[..., 0, k]
        return rate

    def rates_of(self, forms: Floats) -> Floats:
        """Return the forms of the time derivatives of forms, pushes apart."""
        a, b = forms[..., 0, :], forms[..., 1, :]
        there, back = self._turns
        derived = np.stack([self.alpha * a + back * b, self.alpha * b + there * a], axis=-2)
        for j, k, real, imaginary in self.drives():
            if j >= self.flow.rotations:
                derived[..., 0, k] += real * forms[..., 1, j]
                derived[..., 1, k] += imaginary * forms[..., 1, j]
                continue
            derived[..., 0, k] += real * forms[..., 0, j] - imaginary * forms[..., 1, j]
            derived[..., 1, k] += imaginary * forms[..., 0, j] + real * forms[..., 1, j]
        for j, k, first, second in self.pushes():
            derived[..., 0, k] += first * forms[..., 0, j] + second * forms[..., 1, j]
        return derived

    @cached_property
    def _turns(self) -> tuple[Floats, Floats]:
        index = np.arange(self.pairs)
        there = np.where(index < self.flow.hyperbolas_end, self.nu, 1.0)
        back = np.where(
            index < self.flow.rotations,
            -self.nu,
            np.where(index < self.flow.hyperbolas_end, there, 0),
        )
        return there, back

    def weight(self, forms: Floats) -> Floats:
        """Return |row_j| rate_j^n of forms for n = ORDER, 0 and LOW, shape (3, row, pair)."""
        index = np.arange(self.pairs)
        rotates = index < self.flow.rotations
        apart = np.abs(self.alpha) + np.where(index < self.flow.hyperbolas_end, self.nu, 0.0)
        rate = np.where(rotates, np.hypot(self.alpha, self.nu), apart)
        size = np.where(rotates, np.hypot(forms[:, 0], forms[:, 1]), np.abs(forms).max(axis=1))
        return np.ascontiguousarray([size * rate**ORDER, size, size * rate**LOW])


def _apart(damping: Floats, n: int) -> tuple[Integers, Integers]:
    """Return the modes that damping does not couple to others, and those that it does."""
    everyone = np.arange(n)
    if damping.size == 0:
        return everyone, everyone[:0]
    coupled = (damping != np.diag(damping.diagonal())).any(axis=1)
    return everyone[~coupled], everyone[coupled]


def _of_both(modes: ComplexModes) -> Floats:
    """Return what modes mix, of both rates of each pair in the order of pairs, (2, pair, pair)."""
    fast, slow = modes.real[0::2], modes.real[1::2]
    both = np.stack([modes.far, modes.near])
    first = np.concatenate([modes.oscillating, fast])
    second = np.concatenate([modes.oscillating + 1, slow])  # their conjugates follow them
    into = both[:, first] + both[:, second]
    return np.maximum(into[:, :, first], into[:, :, second])


def _padding(pairs: int) -> _Pairs:
    """Return pairs that stay zero, which pad the loops of the kernels to whole vectors."""
    count = -pairs % _LANES if pairs > _FEW else 0
    none = np.zeros(count)
    return _Pairs(np.zeros(count, np.int64), none, none, none, none)


def exponent_of(rates: Floats, time: float) -> int:
    """Return the exponent of two by which times are scaled: near the largest rate."""
    largest = float(np.abs(rates).max(initial=0.0))
    scale = largest if largest > 0.0 else 1.0 / time
    return math.frexp(scale)[1] if 0.0 < scale < math.inf else 0
