"""Parameters of a model taken from a structure; structures that do not fit are refused."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.model import Constraint, System
from vibroimpact_solvers.slow_flow.motion import Initial


@dataclass(frozen=True, slots=True)
class Single:
    """One degree of freedom and its limiter."""

    # Entries of M, K, C and of the load
    mass: float
    stiffness: float
    damping: float
    force: float
    limiter: Constraint

    @property
    def Omega(self) -> float:
        """Natural frequency, 1/time."""
        return math.sqrt(self.stiffness / self.mass)


def refuse(pointer: tuple[str | int, ...], message: str) -> ModelError:
    """Return the error of a structure that does not fit the model."""
    return ModelError(pointer, message, code="not_of_this_model")


def single(system: System, *, loaded: bool = False, damped: bool = False) -> Single:
    """Return the only degree of freedom of a structure and its only limiter.

    Loads and damping are refused unless the model has them.
    """
    if system.n != 1:
        raise refuse(("system",), f"the model has 1 degree of freedom, the system has {system.n}")
    stiffness = float(system.K.to_dense()[0, 0])
    if stiffness < 0.0:
        raise refuse(("system", "K"), "the model has no negative stiffness")
    damping = 0.0 if system.C is None else float(system.C.to_dense()[0, 0])
    force = 0.0 if system.force is None else float(system.force[0])
    one = Single(float(system.M.to_dense()[0, 0]), stiffness, damping, force, limiter(system, 0))
    if force != 0.0 and not loaded:
        raise refuse(("system", "force"), "the model has no load")
    if damping != 0.0 and not damped:
        raise refuse(("system", "C"), "the model has no damping between the impacts")
    return one


def limiter(system: System, dof: int) -> Constraint:
    """Return the only limiter of a structure, of the given degree of freedom."""
    if len(system.constraints) != 1:
        message = f"the model has one limiter, the system has {len(system.constraints)}"
        raise refuse(("system", "constraints"), message)
    constraint = system.constraints[0]
    if constraint.coordinate != ((dof, 1.0),):
        message = f"the model limits degree of freedom {dof}"
        raise refuse(("system", "constraints", 0), message)
    return constraint


def distance(limiter: Constraint) -> float:
    """Return the equal distance of both walls, which is positive."""
    if not limiter.symmetric:
        message = "the model has walls at both sides, equally far"
        raise refuse(("system", "constraints", 0, "gap"), message)
    assert limiter.upper is not None
    return limiter.upper


def elastic(limiter: Constraint) -> None:
    """Refuse losses at the limiter."""
    if limiter.restitution != 1.0:
        message = "the impacts of the model are elastic: restitution is 1"
        raise refuse(("system", "constraints", 0, "restitution"), message)


def given(initial: Initial, name: str) -> float:
    """Return an initial value, which is required."""
    value: float | None = getattr(initial, name)
    if value is None:
        raise ModelError(("initial", name), f"{name} is missing", code="missing")
    return value


def outside(name: str, message: str) -> ModelError:
    """Return the error of an initial value outside the range of the model."""
    return ModelError(("initial", name), message, code="out_of_range")
