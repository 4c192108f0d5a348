"""Natural modes of a structure, computed once by the cheapest method its matrices allow.

Examples
--------
>>> from vibroimpact_solvers import spectrum
>>> from vibroimpact_solvers.presets import chain
>>> system = chain(2, [])
>>> spectrum.choose(system).value
'closed form'
>>> spectrum.spectrum(system).eigenvalues.round(12)
array([1., 3.])
"""

from vibroimpact_solvers.spectrum.bounds import largest_frequency
from vibroimpact_solvers.spectrum.cache import CACHE, Cache, held_bytes
from vibroimpact_solvers.spectrum.inertia import EigenvalueCount, EigenvalueCounter
from vibroimpact_solvers.spectrum.lowest import (
    LowestModes,
    count_below,
    lowest_modes,
    moving_part,
)
from vibroimpact_solvers.spectrum.methods import (
    MEMORY,
    Method,
    choose,
    factor_flops,
    flops,
    nbytes,
    sensitivity,
    solve_flops,
    spectrum,
    step,
)
from vibroimpact_solvers.spectrum.modes import Spectrum
from vibroimpact_solvers.spectrum.slicing import SpectrumSlice, modes_between
from vibroimpact_solvers.spectrum.stiffened import Stiffened, stiffened

__all__ = [
    "CACHE",
    "MEMORY",
    "Cache",
    "EigenvalueCount",
    "EigenvalueCounter",
    "LowestModes",
    "Method",
    "Spectrum",
    "SpectrumSlice",
    "Stiffened",
    "choose",
    "count_below",
    "factor_flops",
    "flops",
    "held_bytes",
    "largest_frequency",
    "lowest_modes",
    "modes_between",
    "moving_part",
    "nbytes",
    "sensitivity",
    "solve_flops",
    "spectrum",
    "step",
    "stiffened",
]
