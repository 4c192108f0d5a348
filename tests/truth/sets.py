"""The sets of random cases: how one is made, and how it is checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from tests.truth import (
    bands,
    blows,
    digits,
    elastic,
    falling,
    histories,
    impact_modes,
    periodic_motions,
    settling,
    soft,
    touching,
)
from tests.truth.verdicts import Case, Report


@dataclass(frozen=True, slots=True)
class Set:
    """A set of random cases."""

    number: int  # in the seeds of its cases
    make: Callable[[np.random.Generator], Case]
    check: Callable[[Case, Report], None]
    usual: int  # number of its cases

    def case(self, seed: int, index: int) -> Case:
        """Return one of its cases."""
        return self.make(np.random.default_rng([self.number, seed, index]))


SETS: Final = {
    "impact-modes": Set(0, impact_modes.case, impact_modes.check, 30_000),
    "bands": Set(1, bands.case, bands.check, 20_000),
    "histories": Set(2, histories.case, histories.check, 20_000),
    "digits": Set(3, digits.case, digits.check, 1_000),
    "soft": Set(4, soft.case, soft.check, 1_000),
    "periodic-motions": Set(5, periodic_motions.case, periodic_motions.check, 3_000),
    "large-periodic-motions": Set(6, periodic_motions.large_case, periodic_motions.check, 100),
    "spectra": Set(8, periodic_motions.spectral_case, periodic_motions.check, 2_000),
    "touching": Set(9, touching.case, touching.check, 20_000),
    "blows": Set(10, blows.case, blows.check, 10_000),
    "falling": Set(11, falling.case, falling.check, 1_000),
    "elastic": Set(12, elastic.case, elastic.check, 5_000),
    "settling": Set(7, settling.case, settling.check, 2_000),
}
