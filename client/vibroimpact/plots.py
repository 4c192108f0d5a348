"""All plots of results; `style` is theirs, and `sweep_plots` has those of sweeps."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

from vibroimpact.attractor_plots import bifurcation, section
from vibroimpact.driven_plots import branches, response
from vibroimpact.hysteresis_plots import hysteresis
from vibroimpact.mode_plots import (
    bands,
    existence,
    frequency_energy,
    harmonics,
    impulse,
    mode_plot,
    momentum,
    resonances,
    shape,
    stability,
    waveform,
)
from vibroimpact.motion_plots import basins, displacement, history, phase_plane
from vibroimpact.style import ADMISSIBLE, PHANTOM, WALL

__all__ = [
    "ADMISSIBLE",
    "PHANTOM",
    "WALL",
    "bands",
    "basins",
    "bifurcation",
    "branches",
    "displacement",
    "existence",
    "frequency_energy",
    "harmonics",
    "history",
    "hysteresis",
    "impulse",
    "mode_plot",
    "momentum",
    "phase_plane",
    "resonances",
    "response",
    "section",
    "shape",
    "stability",
    "waveform",
]


if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Return the colour of admissible solutions by its name in 0.1.0."""
        if name != "REAL":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        message = f"{__name__}.REAL is now {__name__}.ADMISSIBLE"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return ADMISSIBLE
