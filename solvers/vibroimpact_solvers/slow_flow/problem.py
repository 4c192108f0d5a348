"""The problem: a motion with slowly changing impacts, by one variant of a model, at given times."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from types import MappingProxyType
from typing import Final

import numpy as np

from vibroimpact_solvers.arrays import Floats
from vibroimpact_solvers.checks import check_outputs, check_tolerance
from vibroimpact_solvers.errors import ModelError
from vibroimpact_solvers.laws import require
from vibroimpact_solvers.model import RANGE, System, within_range
from vibroimpact_solvers.slow_flow.bouncing_ball import BouncingBall
from vibroimpact_solvers.slow_flow.damped import Damped
from vibroimpact_solvers.slow_flow.motion import Initial, Model
from vibroimpact_solvers.slow_flow.oscillator import Oscillator
from vibroimpact_solvers.slow_flow.restitution import Restitution
from vibroimpact_solvers.slow_flow.two_oscillator import TwoOscillator

KIND: Final = "slow-flow"
OUTPUTS: Final = ("state", "x", "v", "impulse", "error")
MODELS: Final[Mapping[str, type[Model]]] = MappingProxyType(
    {
        "oscillator": Oscillator,
        "damped": Damped,
        "two_oscillator": TwoOscillator,
        "restitution": Restitution,
        "bouncing_ball": BouncingBall,
    }
)


@dataclass(frozen=True, eq=False)
class Problem:
    """A motion by one variant of a model, at given times.

    Parameters
    ----------
    system : System
        The structure with its limiter; it must fit the model.
    model : str
        Out of `MODELS`.
    variant : str
        Description of the motion, out of the model's variants.
    initial : Initial
        Initial values.
    t : array, shape (time,)
        Times, not negative.
    outputs : frozenset of str
        Names of outputs, out of `OUTPUTS`.
    tolerance : float, optional
        Largest error of displacements, relative to the largest of these: the variant is compared
        with the exact motion, and the result says whether it is within.
    """

    system: System
    model: str
    variant: str
    initial: Initial
    t: Floats
    outputs: frozenset[str] = frozenset(OUTPUTS)
    tolerance: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", np.ascontiguousarray(self.t, dtype=np.float64))
        object.__setattr__(self, "outputs", frozenset(self.outputs))
        if self.system.massless.size:
            message = "slow flows take structures in which every degree of freedom has mass"
            raise ModelError(("system", "M"), message, code="not_of_this_model")
        if self.t.ndim != 1 or self.t.size == 0:
            raise ModelError(("t",), "there is no time", code="empty_grid")
        if not (np.isfinite(self.t) & (self.t >= 0.0)).all():
            message = "a time is negative or not finite"
            raise ModelError(("t",), message, code="negative_time")
        check_outputs(self.outputs, OUTPUTS)
        require(KIND, self.system.constraints)
        check_tolerance(self.tolerance)
        if self.model not in MODELS:
            message = f"models are {', '.join(MODELS)}"
            raise ModelError(("model",), message, code="unknown_model")
        variants = MODELS[self.model].VARIANTS
        if self.variant not in variants:
            message = f"variants of {self.model} are {', '.join(variants)}"
            raise ModelError(("variant",), message, code="unknown_variant")
        self._check_initial(MODELS[self.model])
        _ = self.moving  # refuses a system that does not fit the model

    def _check_initial(self, model: type[Model]) -> None:
        for field in fields(self.initial):
            value = getattr(self.initial, field.name)
            if value is None:
                continue
            if field.name not in model.INITIAL:
                message = f"{self.model} starts from {', '.join(model.INITIAL)}"
                raise ModelError(("initial", field.name), message, code="not_of_this_model")
            if not math.isfinite(value):
                message = f"{field.name} is not finite"
                raise ModelError(("initial", field.name), message, code="not_finite")
            if value and not within_range(np.array([value])):
                message = f"{value!r} is neither zero nor between {RANGE[0]} and {RANGE[1]}"
                raise ModelError(("initial", field.name), message, code="out_of_range")

    @property
    def compares(self) -> bool:
        """Whether the variant is compared with the exact motion."""
        return "error" in self.outputs or self.tolerance is not None

    @cached_property
    def moving(self) -> Model:
        """The model with its parameters."""
        until = float(self.t.max())
        return MODELS[self.model].of(self.system, self.initial, self.variant, until)
