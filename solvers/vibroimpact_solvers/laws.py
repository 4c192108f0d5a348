"""Laws of stops: what force or impulse a stop gives to the coordinate that it limits.

To add a law:

1. Write its class here: validated numbers, `name`, `rigid`, and the functions of `Compliant` if
   its force depends on the indentation.
2. Add it to `OFFERED` for the kinds that can compute it, which refuse all others by `require`.
3. Add its document to ``vibroimpact_schema.laws``, which `decode.law` turns into it.

A stop of finite stiffness is *open* while the coordinate has not reached the wall, *loaded* while
its force acts, and *released* while the coordinate is beyond the wall without a force.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Protocol

from vibroimpact_solvers import walls
from vibroimpact_solvers.errors import ModelError

LARGEST: Final = 1e100
"""Largest stiffness and damping: squares of their rates stay within double precision."""
STEEPEST: Final = 64.0
"""Largest exponent of a power law: up to there a series of whole powers is made by products."""
_STEPS: Final = 200  # halvings of an interval of damping ratios


class Law(Protocol):
    """What all laws have."""

    @property
    def name(self) -> str:
        """As in documents."""

    @property
    def rigid(self) -> bool:
        """Whether the coordinate never passes the wall, but for rounding."""

    @property
    def lossy(self) -> bool:
        """Whether contacts lose energy."""


@dataclass(frozen=True, slots=True)
class Rigid:
    """A wall with Newton's impact law.

    Parameters
    ----------
    restitution : float
        Newton's coefficient, 0 to 1.
    """

    name: ClassVar[str] = "rigid"
    rigid: ClassVar[bool] = True
    restitution: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.restitution <= 1.0:
            message = f"the coefficient of restitution is {self.restitution!r}, not in [0, 1]"
            raise ModelError(("restitution",), message, code="restitution_out_of_range")

    @property
    def lossy(self) -> bool:
        """Whether impacts lose energy."""
        return self.restitution < 1.0


ELASTIC: Final = Rigid()
"""A rigid stop that loses no energy."""


@dataclass(frozen=True, slots=True)
class Linear:
    """A spring and a dashpot in parallel that only push: ``F = max(0, k d + c d')`` for d > 0.

    d is the indentation, how far the coordinate is beyond the wall (Kelvin-Voigt contact without
    adhesion). Loaded and released, the stop is linear, and a form ``k d + c d'`` of the state
    tells both apart.

    Parameters
    ----------
    stiffness : float
        k, force per length, at least 0.
    damping : float, optional
        c, force per velocity, at least 0.
    restitution : float, optional
        Instead of the damping: the ratio of the speeds after and before the contact of a free mass,
        in (0, 1].
    """

    name: ClassVar[str] = "linear"
    rigid: ClassVar[bool] = False
    stiffness: float
    damping: float | None = None
    restitution: float | None = None

    def __post_init__(self) -> None:
        for field in ("stiffness", "damping"):
            value = getattr(self, field)
            if value is not None and not 0.0 <= value <= LARGEST:
                message = f"the {field} is {value!r}, not between 0 and {LARGEST}"
                raise ModelError((field,), message, code="out_of_range")
        if self.damping is not None and self.restitution is not None:
            message = "a linear stop has either a damping or a restitution, not both"
            raise ModelError(("restitution",), message, code="two_dampings")
        if self.restitution is not None and not 0.0 < self.restitution <= 1.0:
            message = (
                f"the restitution is {self.restitution!r}, not in (0, 1]: no damping of a linear "
                "stop brings a mass to rest in one contact"
            )
            raise ModelError(("restitution",), message, code="restitution_out_of_range")

    @property
    def lossy(self) -> bool:
        """Whether contacts lose energy."""
        return bool(self.damping) or (self.restitution or 1.0) < 1.0

    def damping_with(self, mass: float) -> float:
        """Return c for a stop that a coordinate with this effective mass strikes.

        The mass is ``1 / (w^T M^-1 w)``; only where the restitution is given it matters.
        """
        if self.damping is not None:
            return self.damping
        if self.restitution is None or self.restitution == 1.0:
            return 0.0
        return 2.0 * damping_ratio(self.restitution) * math.sqrt(self.stiffness * mass)


@dataclass(frozen=True, slots=True)
class Hertz:
    """An elastic contact of curved surfaces: ``F = k d^(3/2)`` for an indentation d > 0.

    Parameters
    ----------
    stiffness : float
        k, force per length^(3/2), at least 0.
    """

    name: ClassVar[str] = "hertz"
    rigid: ClassVar[bool] = False
    lossy: ClassVar[bool] = False
    exponent: ClassVar[float] = 1.5
    stiffness: float

    def __post_init__(self) -> None:
        _check_stiffness(self.stiffness)


@dataclass(frozen=True, slots=True)
class Power:
    """An elastic stop with the force ``F = k d^n`` for an indentation d > 0.

    Parameters
    ----------
    stiffness : float
        k, force per length^n, at least 0.
    exponent : float
        n, from 1 to `STEEPEST`.
    """

    name: ClassVar[str] = "power"
    rigid: ClassVar[bool] = False
    lossy: ClassVar[bool] = False
    stiffness: float
    exponent: float

    def __post_init__(self) -> None:
        _check_stiffness(self.stiffness)
        if not 1.0 <= self.exponent <= STEEPEST:
            message = f"the exponent is {self.exponent!r}, not between 1 and {STEEPEST:g}"
            raise ModelError(("exponent",), message, code="out_of_range")


def _check_stiffness(stiffness: float) -> None:
    if not 0.0 <= stiffness <= LARGEST:
        message = f"the stiffness is {stiffness!r}, not between 0 and {LARGEST}"
        raise ModelError(("stiffness",), message, code="out_of_range")


POWERS: Final = frozenset({Hertz.name, Power.name})
"""Names of the laws whose motions are not linear while a stop pushes."""


def restitution_of(ratio: float) -> float:
    """Return the restitution of a free mass at a linear stop with a damping ratio.

    ``m d'' + c d' + k d = 0`` from d = 0 until the force ``k d + c d' = -m d''`` is zero: with
    poles ``w e^(+-i (pi - a))``, cos a = ratio, that is after the phase 2 a, when
    ``d' = -d'(0) exp(-2 ratio a / (1 - ratio^2)^(1/2))``; of ratios above 1 a is imaginary.
    """
    less = 1.0 - ratio * ratio
    if abs(less) < 1e-6:  # acos(r)/(1 - r^2)^(1/2) = 1 + (1 - r)/3 + 2 (1 - r)^2/15 + ...
        apart = 1.0 - ratio
        angle = 1.0 + apart / 3.0 + 2.0 * apart * apart / 15.0
    elif less > 0.0:
        angle = math.acos(ratio) / math.sqrt(less)
    else:
        angle = math.acosh(ratio) / math.sqrt(-less)
    return math.exp(-2.0 * ratio * angle)


def damping_ratio(restitution: float) -> float:
    """Return the damping ratio ``c / (2 (k m)^(1/2))`` of a restitution in (0, 1]."""
    low, high = 0.0, 1.0
    while restitution_of(high) > restitution:
        high *= 2.0
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        low, high = (middle, high) if restitution_of(middle) > restitution else (low, middle)
    return 0.5 * (low + high)


OFFERED: Final[dict[str, frozenset[str]]] = {
    "time-history": frozenset({Rigid.name, Linear.name, *POWERS}),
    "ensemble": frozenset({Rigid.name, Linear.name, *POWERS}),
    "periodic-motions": frozenset({Rigid.name, Linear.name}),
    "branches": frozenset({Rigid.name, Linear.name}),
    "attractors": frozenset({Rigid.name, Linear.name}),
}
"""Kinds -> names of the laws that they compute; rigid stops where a kind is not listed."""


def require(kind: str, constraints: Sequence[Any]) -> None:
    """Refuse stops whose law a kind does not offer, and walls that move where they must not.

    Parameters
    ----------
    kind : str
    constraints : sequence of model.Constraint

    Raises
    ------
    ModelError
        Naming the law of the first of them.
    """
    if any(constraint.wall for constraint in constraints):
        walls.require(kind, constraints)
    offered = OFFERED.get(kind, frozenset({Rigid.name}))
    for index, constraint in enumerate(constraints):
        if constraint.law.name not in offered:
            others = [other for other in OFFERED if constraint.law.name in OFFERED[other]]
            message = (
                f"{kind} is computed with {_listed(offered)} stops; constraint "
                f"{index} has a {constraint.law.name} one, which is offered by {_listed(others)}"
            )
            pointer = ("system", "constraints", index, "law")
            raise ModelError(pointer, message, code="law_not_offered")


def _listed(names: Iterable[str]) -> str:
    """Return names as text; those of a set in their order."""
    *first, last = sorted(names) if isinstance(names, frozenset) else names
    return " and ".join([", ".join(first), last] if first else [last])
