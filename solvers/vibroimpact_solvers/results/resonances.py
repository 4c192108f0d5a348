"""Internal resonances: frequencies, harmonics and the natural frequencies that they meet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final

from vibroimpact_solvers.arrays import Booleans, Floats, Group, Integers, Quantity
from vibroimpact_solvers.results.shared import WITHIN, Neglected, Statement

_RESONANCE: Final = ("resonance",)


@dataclass(frozen=True, eq=False)
class Result:
    """Internal resonances by ascending frequency."""

    GROUPS: ClassVar[Mapping[str, Group]] = {
        "error": Group("ResonanceError", "Errors of the natural frequencies."),
    }

    Omega: Annotated[
        Floats | None,
        Quantity(
            _RESONANCE, "time-1", "fundamental frequency of the impact mode", error="error/Omega"
        ),
    ]
    harmonic: Annotated[
        Integers | None, Quantity(_RESONANCE, "1", "odd multiple of Omega that resonates")
    ]
    part: Annotated[
        Integers | None,
        Quantity(
            _RESONANCE,
            "1",
            "part of the structure with the constrained coordinate held fixed",
            note="parts are counted from the lowest degree of freedom",
        ),
    ]
    natural: Annotated[
        Floats,
        Quantity(
            _RESONANCE,
            "time-1",
            "natural frequency of the structure with the constrained coordinate held fixed",
            error="error/natural",
        ),
    ]
    error_statement: Statement
    neglected: Neglected
    error_natural: Annotated[
        Floats,
        Quantity(
            _RESONANCE, "time-1", "absolute error of the natural frequency", path="error/natural"
        ),
    ]
    error_relative: Annotated[
        Floats,
        Quantity(_RESONANCE, "1", "relative error of the natural frequency", path="error/relative"),
    ]
    error_Omega: Annotated[
        Floats | None,
        Quantity(_RESONANCE, "time-1", "absolute error of Omega", path="error/Omega"),
    ]
    within_tolerance: Annotated[
        Booleans | None,
        Quantity(
            _RESONANCE,
            "1",
            "whether the relative error is within the requested tolerance",
            flags=WITHIN,
            path="error/within_tolerance",
        ),
    ]
