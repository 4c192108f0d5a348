"""Random motions computed with more digits than doubles have."""

from __future__ import annotations

import numpy as np

from tests.truth import histories
from tests.truth.verdicts import Case, Report

MAKERS = ("plain", "damped", "pressed", "grazing", "small_gaps", "free", "simultaneous", "loaded")
REFUSALS = (
    *histories.REFUSALS, "followed in double precision only", "in which order",
    "digits do not tell",
)  # fmt: skip
"""Part of the messages of refusals that the documentation names."""


def case(rng: np.random.Generator) -> Case:
    """Return a random motion, long enough to lose digits."""
    name = str(rng.choice(MAKERS))
    document = histories.MAKERS[name](rng)
    T = float(10.0 ** rng.uniform(0.3, 1.6)) * 2.0 / histories.top_frequency(document)
    document["t"] = np.sort(rng.uniform(0.0, T, int(rng.choice([1, 4])))).tolist()
    document["t_end"] = T
    document["digits"] = int(rng.choice([20, 30, 40]))
    document["tolerance"] = float(10.0 ** -rng.uniform(10, 15))
    return Case(f"{name}, {document['digits']} digits", document)


def check(case: Case, report: Report) -> None:
    """Compare the motion of a case with its reference."""
    document = case.document
    histories.check(
        case, report, REFUSALS, digits=document["digits"], tolerance=document["tolerance"]
    )
