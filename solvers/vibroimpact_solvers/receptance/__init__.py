"""Responses to triangle-wave impulses without all natural modes."""

from vibroimpact_solvers.receptance.cells import METHOD, MODES, ModalWaves, Reach, size, touched
from vibroimpact_solvers.receptance.rows import Rows
from vibroimpact_solvers.receptance.series import ENTRYWISE, IMPULSES, Receptance, truncations
from vibroimpact_solvers.receptance.waves import FactorizedWaves, Waves

__all__ = [
    "ENTRYWISE",
    "IMPULSES",
    "METHOD",
    "MODES",
    "FactorizedWaves",
    "ModalWaves",
    "Reach",
    "Receptance",
    "Rows",
    "Waves",
    "size",
    "touched",
    "truncations",
]
