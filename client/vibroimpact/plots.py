"""All plots of results; `style` is theirs, and `sweep_plots` has those of sweeps."""

from __future__ import annotations

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
