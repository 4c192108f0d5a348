"""Derivatives of the outputs of impact modes, with their errors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import numpy as np

from vibroimpact_solvers.arrays import EPS, Booleans, Floats
from vibroimpact_solvers.impact_modes.derivatives.elimination import Solution, Unknowns, solve
from vibroimpact_solvers.impact_modes.derivatives.energies import energy_rates
from vibroimpact_solvers.impact_modes.derivatives.equations import (
    Component,
    ComponentRates,
    Frequency,
    add_pairs,
    averaged,
    component_rates,
    terms,
)
from vibroimpact_solvers.impact_modes.derivatives.functions import Profile, phases
from vibroimpact_solvers.impact_modes.derivatives.rates import rates_of
from vibroimpact_solvers.impact_modes.derivatives.sums import at_dofs
from vibroimpact_solvers.impact_modes.family import Impulses, Kind
from vibroimpact_solvers.impact_modes.modal import Amplitudes, ModalFamily, modal_load
from vibroimpact_solvers.impact_modes.problem import DISPLACEMENTS, Problem
from vibroimpact_solvers.meter import look

_BLOCK: Final = 2**16  # numbers of a block of frequencies, which stay in a cache
_ROUNDINGS: Final = 1.0
_BOUND: Final = 0.5  # part of the bound of the impulses' errors that is expected of them
_FLOOR: Final = 0.01  # of p', below which the amplitude of a mode does not come from the impulses


class Part(NamedTuple):
    """One component at some frequencies, and the rates of its data and of its amplitudes."""

    one: Component
    own: ComponentRates
    A: Floats  # (parameter, frequency, mode)
    A_error: Floats


Position = tuple[list[Profile], float | None, int]
"""Profiles of the components at a time, or of a harmonic where that is None, and its order."""


class Derivatives:
    """Derivatives of one family by the parameters of its problem."""

    def __init__(self, problem: Problem, of: ModalFamily) -> None:
        self._family, self._natural = of.family, of.spectrum
        self._rows, self._wrong = of.spectrum.participations(problem.struck)
        self._load, _ = modal_load(problem, of.spectrum)
        self._at = of.participating
        count = of.spectrum.roots.size
        known = of.spectrum.rounding
        self._rounding = np.zeros(count) if known is None else known
        self._relative = self._phase_errors()
        dofs = problem.output_dofs if problem.outputs & DISPLACEMENTS else problem.output_dofs[:0]
        self._shapes = of.spectrum.rows(dofs)
        self._shapes_wrong = np.zeros_like(self._shapes)
        if of.spectrum.angles is not None:
            reach = np.sqrt(np.square(self._shapes).sum(axis=1))
            self._shapes_wrong = np.outer(reach, of.spectrum.angles)
        look()
        self._rates = rates_of(problem, of.spectrum, self._rows, self._shapes)
        self.mirrored = self._family.kind is Kind.ANTISYMMETRIC and not self._rates.turning.any()

    def _phase_errors(self) -> Floats:
        """Return errors of the natural frequencies relative to them, (mode,)."""
        natural = self._natural
        squares = np.square(natural.roots)
        errors = np.zeros(squares.size) if natural.errors is None else natural.errors
        relative = np.divide(0.5 * errors, squares, np.zeros(squares.size), where=squares > 0.0)
        return relative + natural.norms + (EPS if natural.rounding is None else 0.0)

    def values(self, problem: Problem, impulses: Impulses, motion: Amplitudes) -> dict[str, Any]:
        """Return the derivatives at the frequencies of the problem by the names of their fields."""
        total, count = problem.omega.size, len(problem.parameters)
        step = max(1, _BLOCK // max(1, self._natural.roots.size * count))
        blocks: list[dict[str, Floats]] = []
        for start in range(0, total, step):
            look()
            some = slice(start, min(start + step, total))
            block = _Block(problem, impulses, motion, some)
            rates = [each.at(some).frequency for each in problem.parameters]
            rate = np.stack([np.broadcast_to(each, block.omega.shape) for each in rates])
            with np.errstate(all="ignore"):  # of singular solutions, which are left out
                blocks.append(self._of(block, Frequency(block.omega, rate * (2.0 / np.pi))))
        whole = {
            name: np.moveaxis(np.concatenate([one[name] for one in blocks], axis=1), 0, -1)
            for name in blocks[0]
        }
        whole = {name: np.ascontiguousarray(value) for name, value in whole.items()}
        whole["derivative_reason"] = whole["derivative_reason"].astype(np.int64)
        return whole

    def _of(self, block: _Block, at: Frequency) -> dict[str, Floats]:
        """Return the derivatives at some frequencies, each (parameter, frequency, …)."""
        outputs = block.problem.outputs
        parts, plus, minus, wrong, singular = self._solved(block, at)
        values: dict[str, Floats] = {}
        if "impulse" in outputs:
            sides = [("", block.plus, plus)]
            sides += [] if self.mirrored else [("_lower", block.minus, minus)]
            to_momentum = 2.0 / at.omega[:, np.newaxis]
            for side, p, change in sides:
                slowed = p * at.relative
                rounded = 2.0 * EPS * (np.abs(change) + np.abs(slowed))
                error = wrong + rounded + block.error * np.abs(at.relative)
                values[f"derivative_impulse{side}"] = change
                values[f"derivative_impulse{side}_error"] = wrong.copy()
                values[f"derivative_momentum{side}"] = to_momentum * (change - slowed)
                values[f"derivative_momentum{side}_error"] = to_momentum * error
        for name, positions in self._positions(block.problem, parts):
            x = [self._displaced(parts, at, *each) for each in positions]
            stacked = [np.stack(each, axis=2) for each in zip(*x, strict=True)]
            if name == "shape":
                stacked = [each[:, :, 0] for each in stacked]
            values[f"derivative_{name}"], values[f"derivative_{name}_error"] = stacked
        if "energy" in outputs:
            energy = energy_rates(
                [(part.one, part.own, part.A, part.A_error) for part in parts],
                self._natural.eigenvalues, self._rates, at,
            )  # fmt: skip
            values["derivative_energy"], values["derivative_energy_error"] = energy
        for name, value in values.items():
            value[:, singular] = np.inf if name.endswith("error") else np.nan
            if name.endswith("error"):
                value[np.isnan(value)] = np.inf
        values["derivative_reason"] = np.broadcast_to(
            singular.astype(np.float64), (len(plus), singular.size)
        )
        return values

    def _component(
        self, block: _Block, combine: Floats, symmetric: bool, share: float
    ) -> Component:
        """Return a component; `combine` makes rows of unknowns of those of constraints."""
        natural, count = self._natural, self._natural.roots.size
        given = block.U if symmetric else block.D
        A = np.zeros((block.omega.size, count))
        if given.shape[1]:
            A[:, self._at] = given
        where = phases(natural.roots, self._rounding, block.omega, block.omega_rounding, symmetric)
        uncertainty = where.gamma * self._relative + 0.5 * EPS
        rows = combine @ self._rows
        at_impact = where.at_impact()
        A_error = EPS * np.abs(A)
        if given.shape[1]:
            steep = np.maximum(where.gamma, EPS) if symmetric else 1.0
            speed = np.maximum(np.abs(at_impact[1].p) / steep, _FLOOR) * steep
            square = np.square(block.omega)[:, np.newaxis]
            pushed = share * block.error * np.abs(rows).sum(axis=0) / square
            A_error += (pushed + np.abs(A) * steep * uncertainty) / speed * (A != 0.0)
        load = self._load if symmetric else np.zeros(count)
        wrong = np.abs(combine) @ self._wrong
        return Component(where, rows, wrong, A, A_error, load, uncertainty, *at_impact)

    def _solved(
        self, block: _Block, at: Frequency
    ) -> tuple[list[Part], Floats, Floats, Floats, Booleans]:
        """Return the rates of amplitudes, of p+ and p- and their errors, and where none are."""
        eye = np.eye(self._family.count)
        z_error = np.broadcast_to(block.error, block.plus.shape)
        if self._family.kind is Kind.JOINT:
            return self._jointly(block, at, eye)
        upper, lower = self._rates.upper, self._rates.lower
        # Half of the sum drives one component, half of the difference the other.
        drives = [(0.5 * (block.plus + block.minus), 0.5 * (upper + lower))]
        if not self.mirrored:
            drives.append((0.5 * (block.plus - block.minus), 0.5 * (upper - lower)))
        solutions, parts = list[Solution](), list[Part]()
        for symmetric, (z, walls) in enumerate(drives):
            one = self._component(block, eye, bool(symmetric), 1.0)
            own = component_rates(one, self._rates, at, eye)
            given = Unknowns(z, z_error, walls, 1.0)
            solution = solve([one], [own], self._rates, at, given)
            parts.append(Part(one, own, solution.A[0], solution.A_error[0]))
            solutions.append(solution)
        singular = block.singular | np.logical_or.reduce([each.singular for each in solutions])
        if self.mirrored:
            return parts, solutions[0].z, solutions[0].z, solutions[0].z_error, singular
        total, difference = solutions
        wrong = total.z_error + difference.z_error
        return parts, total.z + difference.z, total.z - difference.z, wrong, singular

    def _jointly(
        self, block: _Block, at: Frequency, eye: Floats
    ) -> tuple[list[Part], Floats, Floats, Floats, Booleans]:
        """Return what `_solved` does where a constraint has one wall only."""
        family, rates = self._family, self._rates
        upper, lower = list(family.upper), list(family.lower)
        both = [np.concatenate([eye[upper], sign * eye[lower]]) for sign in (1.0, -1.0)]
        ones = [
            self._component(block, combine, symmetric, 0.5)
            for combine, symmetric in zip(both, (False, True), strict=True)
        ]
        own = [component_rates(*each) for each in ((ones[0], rates, at, both[0]),
                                                   (ones[1], rates, at, both[1]))]  # fmt: skip
        z = np.concatenate([block.plus[:, upper], block.minus[:, lower]], axis=1)
        walls = np.concatenate([rates.upper[:, upper], rates.lower[:, lower]], axis=1)
        given = Unknowns(z, np.broadcast_to(block.error, z.shape), walls, 0.5)
        solution = solve(ones, own, rates, at, given)
        parts = [Part(*each) for each in zip(ones, own, solution.A, solution.A_error, strict=True)]
        sides = []
        for values in (solution.z, solution.z_error):
            plus, minus = np.zeros((2, *values.shape[:2], family.count))
            plus[..., upper], minus[..., lower] = np.split(values, [len(upper)], axis=2)
            sides += [plus, minus]
        singular = block.singular | solution.singular
        return parts, sides[0], sides[1], np.maximum(sides[2], sides[3]), singular

    def _positions(
        self, problem: Problem, parts: list[Part]
    ) -> Iterator[tuple[str, list[Position]]]:
        """Yield the outputs that are displacements, and the profiles of all their positions."""
        where = [part.one.phases for part in parts]
        if "shape" in problem.outputs:
            yield "shape", [([part.one.place for part in parts], 1.0, 0)]
        if "waveform" in problem.outputs:
            times = [float(tau) for tau in problem.times]
            yield "waveform", [([each.at_time(tau) for each in where], tau, 0) for tau in times]
        if "harmonics" in problem.outputs:
            orders = [int(order) for order in self._family.orders(problem)]
            yield (
                "harmonics",
                [([each.of_harmonic(order) for each in where], None, order) for order in orders],
            )

    def _displaced(
        self,
        parts: list[Part],
        at: Frequency,
        profiles: list[Profile],
        tau: float | None,
        order: int,
    ) -> tuple[Floats, Floats]:
        """Return rates of displacements at a position, and errors: (parameter, frequency, dof)."""
        rates = self._rates
        q, q_error = np.zeros((2, at.omega.size, self._natural.roots.size))
        change, error = np.zeros((2, *parts[0].A.shape))
        for part, profile in zip(parts, profiles, strict=True):
            one = part.one
            q += profile.p * one.A + profile.s * (one.load / at.square)
            q_error += np.abs(profile.p) * one.A_error
            moved = terms(one, part.own, rates, at, profile)
            if rates.first.size:
                slopes = averaged(one.phases, rates, tau, order)
                add_pairs(moved, one, rates, at, (slopes[0], slopes[1]))
            grown = profile.p * part.A
            change += grown + moved.value
            error += np.abs(profile.p) * part.A_error + moved.error
            error += _ROUNDINGS * EPS * (np.abs(grown) + moved.size)
            wave = 1.0 if one.phases.symmetric else np.maximum(1.0, one.phases.gamma)
            error += np.abs(part.A) * (one.uncertainty / wave)
        shapes, turned = np.abs(self._shapes), np.abs(rates.shapes)
        x = at_dofs(change, self._shapes) + at_dofs(q, rates.shapes)
        wrong = at_dofs(error, shapes)
        wrong += at_dofs(np.abs(change), _ROUNDINGS * EPS * shapes + self._shapes_wrong)
        wrong += at_dofs(q_error + _ROUNDINGS * EPS * np.abs(q), turned)
        wrong += at_dofs(np.abs(q), rates.shape_errors)
        return x, wrong


class _Block:
    """What is known of the solutions at some frequencies."""

    def __init__(
        self, problem: Problem, impulses: Impulses, motion: Amplitudes, some: slice
    ) -> None:
        self.problem = problem
        self.omega = problem.omega[some]
        self.omega_rounding = problem.frequencies.rounding[some]
        self.plus, self.minus = impulses.plus[some], impulses.minus[some]
        self.singular = impulses.singular[some]
        largest = np.maximum(np.abs(self.plus), np.abs(self.minus)).max(axis=1)
        relative = np.where(self.singular, 0.0, impulses.error[some])
        self.error = (_BOUND * relative * largest)[:, np.newaxis]  # of impulses, (frequency, 1)
        self.D, self.U = motion.D[some], motion.U[some]
