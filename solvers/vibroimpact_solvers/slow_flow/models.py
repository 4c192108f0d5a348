"""The table of models by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from vibroimpact_solvers.slow_flow.bouncing_ball import BouncingBall
from vibroimpact_solvers.slow_flow.damped import Damped
from vibroimpact_solvers.slow_flow.motion import Model
from vibroimpact_solvers.slow_flow.oscillator import Oscillator
from vibroimpact_solvers.slow_flow.restitution import Restitution
from vibroimpact_solvers.slow_flow.two_oscillator import TwoOscillator

MODELS: Final[Mapping[str, type[Model]]] = MappingProxyType(
    {
        "oscillator": Oscillator,
        "damped": Damped,
        "two_oscillator": TwoOscillator,
        "restitution": Restitution,
        "bouncing_ball": BouncingBall,
    }
)
