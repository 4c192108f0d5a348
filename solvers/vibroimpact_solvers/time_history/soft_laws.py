"""Forces that grow with a power of a coordinate: soft limiters, and stops behind their gaps.

Of an indentation d > 0 beyond its wall a stop makes the force ``k d^n`` (`vibroimpact_solvers.laws`
has Hertz's law, n = 3/2, the power law, and the linear one, n = 1). A soft limiter acts from y = 0
on, with one law for all (`limiters.Power`).
"""

from __future__ import annotations

import math
from typing import Final, Protocol

import numpy as np

from vibroimpact_solvers.arrays import Floats, Integers
from vibroimpact_solvers.kernels.soft_forces import LARGEST, LAW, Limiters
from vibroimpact_solvers.laws import Hertz, Linear, Power
from vibroimpact_solvers.model import System
from vibroimpact_solvers.time_history import limiters
from vibroimpact_solvers.time_history.problem import Problem
from vibroimpact_solvers.time_history.structure import Configuration, Structure

_EPS: Final = 2.0**-52


class SoftLaws(Protocol):
    """The forces and energies of all limiters, and what kernels know of them."""

    def forces(self, y: Floats) -> Floats:
        """Return the forces on coordinates, shape (…, constraint)."""

    def potential(self, y: Floats) -> Floats:
        """Return the energy stored in all limiters, shape (…,)."""

    def kernel(self, structure: Structure, scene: Configuration, *, off: bool) -> Limiters:
        """Return the limiters for `kernels.taylor.follow`; off: by the roundings of their kicks."""


class SoftLimiters:
    """Soft limiters of a structure.

    Parameters
    ----------
    law : limiters.Power
    system : System
    """

    def __init__(self, law: limiters.Power, system: System) -> None:
        self._law, self._sizes = law, law.sizes(system)

    def forces(self, y: Floats) -> Floats:
        """Return the forces on coordinates, shape (…, constraint)."""
        return self._law.forces(y, self._sizes)

    def potential(self, y: Floats) -> Floats:
        """Return the energy stored in all limiters, shape (…,)."""
        return self._law.potential(y, self._sizes)

    def kernel(self, structure: Structure, scene: Configuration, *, off: bool) -> Limiters:
        """Return the limiters for `kernels.taylor.follow`; off: by the roundings of their kicks."""
        forms, slopes, kicks = scene.kernel.watched[:3]
        law, sizes = self._law, self._sizes
        unit = sizes.min(axis=0, initial=np.inf)
        forms, slopes = (part / unit[:, np.newaxis, np.newaxis] for part in (forms, slopes))
        stiffness = law.stiffness * math.ldexp(1.0, -2 * structure.exponent)
        ratios = unit / sizes
        laws = np.zeros(unit.size, LAW)
        laws["level"] = structure.level(scene) / unit
        laws["below"], laws["above"] = stiffness * np.array([[1.0], [-1.0]]) * ratios**law.exponent
        laws["low"], laws["high"] = ratios
        _set_powers(laws, np.full(unit.size, law.exponent))
        return _felt(scene, forms, slopes, kicks, laws, _kick_errors(scene) if off else None)


class PowerStops:
    """Stops whose force is a power of the indentation, each with a law of its own.

    Parameters
    ----------
    system : System
        Whose stops have one of these laws.

    Attributes
    ----------
    constraint, side : array of int, shape (wall,)
        What each wall limits: 1 the upper side, -1 the lower one.
    """

    def __init__(self, system: System) -> None:
        each = [
            (a, side, wall)
            for a, c in enumerate(system.constraints)
            for side, wall in ((1, c.upper), (-1, c.lower))
            if wall is not None
        ]
        self.constraint: Integers = np.array([a for a, _, _ in each], dtype=np.int64)
        self.side: Integers = np.array([side for _, side, _ in each], dtype=np.int64)
        self._walls = np.array([wall for _, _, wall in each], dtype=np.float64)
        numbers = [_stiffness_and_exponent(system.constraints[a].law) for a, _, _ in each]
        self.stiffness, self.exponent = np.array(numbers, dtype=np.float64).reshape(-1, 2).T
        self._count = len(system.constraints)

    def indentations(self, y: Floats) -> Floats:
        """Return how far coordinates are beyond walls, negative before them, shape (…, wall)."""
        return np.asarray(self.side * y[..., self.constraint] - self._walls)

    def pushes(self, indentations: Floats) -> Floats:
        """Return the sizes of the forces of walls, shape (…, wall)."""
        return np.asarray(self.stiffness * np.maximum(indentations, 0.0) ** self.exponent)

    def of_constraints(self, walls: Floats) -> Floats:
        """Return sums over the walls of each constraint, shape (…, constraint)."""
        sums = np.zeros((*walls.shape[:-1], self._count))
        for wall, a in enumerate(self.constraint.tolist()):
            sums[..., a] += walls[..., wall]
        return sums

    def forces(self, y: Floats) -> Floats:
        """Return the forces on coordinates, shape (…, constraint)."""
        return self.of_constraints(-self.side * self.pushes(self.indentations(y)))

    def potential(self, y: Floats) -> Floats:
        """Return the energy stored in all stops, shape (…,)."""
        deep = np.maximum(self.indentations(y), 0.0)
        return np.asarray((self.pushes(deep) * deep / (self.exponent + 1.0)).sum(axis=-1))

    def kernel(self, structure: Structure, scene: Configuration, *, off: bool) -> Limiters:
        """Return the walls for `kernels.taylor.follow`; off: by the roundings of their kicks."""
        turned = self.side[:, np.newaxis, np.newaxis]
        forms, slopes, kicks = (turned * part[self.constraint] for part in scene.kernel.watched[:3])
        laws = np.zeros(self.side.size, LAW)
        laws["level"] = self.indentations(structure.level(scene))
        laws["above"] = -self.stiffness * math.ldexp(1.0, -2 * structure.exponent)
        _set_powers(laws, self.exponent)
        errors = turned * _kick_errors(scene)[self.constraint] if off else None
        return _felt(scene, forms, slopes, kicks, laws, errors)


def of(problem: Problem) -> SoftLaws:
    """Return the laws of the limiters or stops of a motion that Taylor series follow."""
    if problem.limiter is not None:
        return SoftLimiters(problem.limiter, problem.system)
    return PowerStops(problem.system)


def _stiffness_and_exponent(law: object) -> tuple[float, float]:
    assert isinstance(law, Linear | Hertz | Power)
    return law.stiffness, 1.0 if isinstance(law, Linear) else law.exponent


def _set_powers(laws: np.ndarray, exponents: Floats) -> None:
    """Set the exponents of limiters, and which of them are whole."""
    whole = (exponents == np.floor(exponents)) & (exponents <= LARGEST)
    laws["exponent"], laws["whole"] = exponents, np.where(whole, exponents, 0.0)


def _felt(
    scene: Configuration, forms: Floats, slopes: Floats, kicks: Floats, laws: np.ndarray,
    errors: Floats | None,
) -> Limiters:  # fmt: skip
    """Return limiters with what states feel of them, and with their roundings where given."""
    weights = scene.basis.weights
    felt = weights > 0.0
    laws["strength"] = (weights * np.abs(kicks)).max(axis=(1, 2), initial=0.0)
    laws["grain"] = (np.abs(forms)[..., felt] / weights[felt]).sum(axis=(1, 2))
    if errors is not None:
        kicks = kicks + _EPS * errors
    forms, slopes, kicks = map(np.ascontiguousarray, (forms, slopes, kicks))
    return Limiters(forms, slopes, kicks, laws)


def _kick_errors(scene: Configuration) -> Floats:
    """Return errors of kicks that leave the mobility of the limiters what it is."""
    errors, watched = scene.kernel.errors.kicks[0], scene.kernel.watched
    own, along = ((watched.velocity * part).sum(axis=(1, 2)) for part in (watched.kick, errors))
    share = along / np.where(own == 0.0, 1.0, own)
    return np.asarray(errors - share[:, np.newaxis, np.newaxis] * watched.kick)
