"""Natural modes of a structure, by the method that its matrices allow, computed once."""

from vibroimpact_solvers.spectrum.bounds import largest_frequency
from vibroimpact_solvers.spectrum.cache import CACHE, Cache
from vibroimpact_solvers.spectrum.inertia import Count, Counter
from vibroimpact_solvers.spectrum.methods import (
    MEMORY,
    REASONS,
    Method,
    choose,
    flops,
    is_known,
    key,
    nbytes,
    spectrum,
    step,
)
from vibroimpact_solvers.spectrum.natural import Spectrum
from vibroimpact_solvers.spectrum.window import Window, window

__all__ = [
    "CACHE",
    "MEMORY",
    "REASONS",
    "Cache",
    "Count",
    "Counter",
    "Method",
    "Spectrum",
    "Window",
    "choose",
    "flops",
    "is_known",
    "key",
    "largest_frequency",
    "nbytes",
    "spectrum",
    "step",
    "window",
]
