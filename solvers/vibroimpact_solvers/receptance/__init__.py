"""Receptances: responses at the constraints without all natural modes.

Examples
--------
>>> import numpy as np
>>> from vibroimpact_solvers.presets import chain
>>> from vibroimpact_solvers.receptance import DirectFrequencyResponse
>>> system = chain(1, [])
>>> response = DirectFrequencyResponse(system, np.eye(1), bound=2.0)
>>> round(float(response.receptance(2.0).value[0, 0]), 12)  # 1/(z M - K) with z = 4, K = 2
0.5
"""

from vibroimpact_solvers.receptance.coefficients import ENTRYWISE, IMPULSES, truncations
from vibroimpact_solvers.receptance.coordinates import Coordinates
from vibroimpact_solvers.receptance.frequency_response import DirectFrequencyResponse
from vibroimpact_solvers.receptance.partial_modes import (
    METHOD,
    MODES_PER_INTERVAL,
    ExpansionSize,
    PartialModalResponse,
    interval_count,
    interval_width,
)
from vibroimpact_solvers.receptance.series import FrequencyResponse, TriangleWaveResponse

__all__ = [
    "ENTRYWISE",
    "IMPULSES",
    "METHOD",
    "MODES_PER_INTERVAL",
    "Coordinates",
    "DirectFrequencyResponse",
    "ExpansionSize",
    "FrequencyResponse",
    "PartialModalResponse",
    "TriangleWaveResponse",
    "interval_count",
    "interval_width",
    "truncations",
]
