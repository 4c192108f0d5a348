"""Natural frequencies and mode shapes, and what follows from them for constraints and bases."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final

from vibroimpact_solvers.arrays import Booleans, Floats, Group, Integers, Quantity
from vibroimpact_solvers.results.shared import (
    DERIVATIVES,
    WITHIN,
    Neglected,
    Parameters,
    ParameterUnits,
    Statement,
    derivative,
    derivative_error,
)

_MODE: Final = ("mode",)
_SHAPE: Final = ("mode", "dof")
_AT: Final = ("mode", "constraint")
_DIRECTION: Final = ("mode", "direction")
_FLEXIBILITY: Final = ("constraint", "other")
_OF_MODES: Final = "mass-0.5"
_UNKNOWN: Final = "the mode cannot be told from its neighbours"


@dataclass(frozen=True, eq=False)
class Result:
    """Natural frequencies and mode shapes, ascending; shapes have unit modal mass."""

    GROUPS: ClassVar[Mapping[str, Group]] = {
        "error": Group(
            "NaturalFrequenciesError", "Absolute errors of the outputs.", together=False
        ),
        **DERIVATIVES,
    }

    mode: Annotated[Integers, Quantity(_MODE, "1", "index of the mode, ascending", True)]
    Omega: Annotated[
        Floats,
        Quantity(
            _MODE,
            "time-1",
            "natural angular frequency",
            error="error/Omega",
            note="0 of a rigid-body mode, minus the rate of growth of an unstable one",
        ),
    ]
    shape: Annotated[
        Floats | None,
        Quantity(
            _SHAPE,
            _OF_MODES,
            "mode shape",
            error="error/shape",
            note="of unit modal mass, its largest entry positive",
        ),
    ]
    participation: Annotated[
        Floats | None,
        Quantity(
            _AT,
            _OF_MODES,
            "constrained coordinate of the mode shape",
            error="error/participation",
        ),
    ]
    effective_mass: Annotated[
        Floats | None,
        Quantity(
            _DIRECTION,
            "mass",
            "effective modal mass of a motion of the base",
            error="error/effective_mass",
        ),
    ]
    residual_flexibility: Annotated[
        Floats | None,
        Quantity(
            _FLEXIBILITY,
            "mass-1 time2",
            "static flexibility of all modes that are left out",
            error="error/residual_flexibility",
            note="of a free structure, of its elastic modes",
        ),
    ]
    error_statement: Statement
    neglected: Neglected
    cautions: Annotated[
        list[str] | None,
        Quantity(
            (),
            "1",
            "what of the structure is permitted but seldom meant, a sentence each",
            path="cautions",
            note="absent where there is nothing of that kind",
        ),
    ]
    error_Omega: Annotated[
        Floats,
        Quantity(_MODE, "time-1", "absolute error of Omega", path="error/Omega"),
    ]
    error_shape: Annotated[
        Floats | None,
        Quantity(
            _SHAPE,
            _OF_MODES,
            "absolute error of the mode shape",
            path="error/shape",
            missing=_UNKNOWN,
        ),
    ]
    error_participation: Annotated[
        Floats | None,
        Quantity(
            _AT,
            _OF_MODES,
            "absolute error of the participation",
            path="error/participation",
            missing=_UNKNOWN,
        ),
    ]
    error_effective_mass: Annotated[
        Floats | None,
        Quantity(
            _DIRECTION,
            "mass",
            "absolute error of the effective modal mass",
            path="error/effective_mass",
            missing=_UNKNOWN,
        ),
    ]
    error_residual_flexibility: Annotated[
        Floats | None,
        Quantity(
            _FLEXIBILITY,
            "mass-1 time2",
            "absolute error of the residual flexibility",
            path="error/residual_flexibility",
            missing=_UNKNOWN,
        ),
    ]
    within_tolerance: Annotated[
        Booleans | None,
        Quantity(
            _MODE,
            "1",
            "whether the relative error of Omega is within the requested tolerance",
            flags=WITHIN,
            path="error/within_tolerance",
        ),
    ]
    parameter: Parameters
    parameter_unit: ParameterUnits
    derivative_reason: Annotated[
        Integers | None,
        Quantity(
            ("mode", "parameter"),
            "1",
            "why there is no derivative, or ok",
            flags=("ok", "repeated", "rigid"),
            path="derivative/reason",
            note="of repeated frequencies, that of Omega is for a parameter that grows",
        ),
    ]
    derivative_distance: Annotated[
        Floats | None,
        Quantity(
            ("mode", "parameter"),
            "1",
            "change of the parameter to where there is no derivative, to first order",
            path="derivative/distance",
            missing="none is in sight",
            note="where a mode meets its neighbour, or its frequency is 0",
        ),
    ]
    derivative_Omega: Annotated[
        Floats | None, derivative(_MODE, "time-1", "natural angular frequency", "Omega")
    ]
    derivative_Omega_error: Annotated[
        Floats | None, derivative_error(_MODE, "time-1", "natural angular frequency", "Omega")
    ]
    derivative_shape: Annotated[Floats | None, derivative(_SHAPE, _OF_MODES, "mode shape", "shape")]
    derivative_shape_error: Annotated[
        Floats | None, derivative_error(_SHAPE, _OF_MODES, "mode shape", "shape")
    ]
    derivative_participation: Annotated[
        Floats | None,
        derivative(_AT, _OF_MODES, "constrained coordinate of the mode shape", "participation"),
    ]
    derivative_participation_error: Annotated[
        Floats | None,
        derivative_error(
            _AT, _OF_MODES, "constrained coordinate of the mode shape", "participation"
        ),
    ]
    derivative_effective_mass: Annotated[
        Floats | None, derivative(_DIRECTION, "mass", "effective modal mass", "effective_mass")
    ]
    derivative_effective_mass_error: Annotated[
        Floats | None,
        derivative_error(_DIRECTION, "mass", "effective modal mass", "effective_mass"),
    ]
    derivative_residual_flexibility: Annotated[
        Floats | None,
        derivative(
            _FLEXIBILITY,
            "mass-1 time2",
            "static flexibility of all modes that are left out",
            "residual_flexibility",
        ),
    ]
    derivative_residual_flexibility_error: Annotated[
        Floats | None,
        derivative_error(
            _FLEXIBILITY,
            "mass-1 time2",
            "static flexibility of all modes that are left out",
            "residual_flexibility",
        ),
    ]
