"""Impact modes: the solutions of a family, admissible or phantom, with their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Annotated, Any, ClassVar, Final

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats, Group, Integers, Quantity, along
from vibroimpact_solvers.results.shared import (
    DERIVATIVES,
    EXISTS,
    NO_YES,
    ONE,
    WITHIN,
    Dofs,
    Neglected,
    Parameters,
    ParameterUnits,
    Statement,
    derivative,
    derivative_error,
)


class Reason(IntEnum):
    """Whether a solution of the family is a motion of the structure, and why not."""

    OK = 0
    NEGATIVE_IMPULSE = 1
    WRONG_VELOCITY = 2
    PENETRATION = 3
    SINGULAR = 4

    @property
    def sentence(self) -> str:
        """The reason as a sentence."""
        return _SENTENCES[self]


_SENTENCES: Final = {
    Reason.OK: "the solution is a motion of the structure",
    Reason.NEGATIVE_IMPULSE: "a wall would have to pull",
    Reason.WRONG_VELOCITY: "a constrained coordinate would leave its wall before the impact",
    Reason.PENETRATION: "a limit is exceeded between the impacts",
    Reason.SINGULAR: "no impulse brings the structure to its walls at this frequency",
}
REASONS: Final = tuple(reason.name.lower() for reason in Reason)

_FREQUENCY: Final = ("frequency",)
_AT_WALLS: Final = ("frequency", "constraint")
_OF_DOFS: Final = ("frequency", "dof")
_OF_ALL: Final = ("frequency", ONE, "dof")


def _error(
    dims: tuple[str, ...],
    unit: str,
    of: str,
    output: str,
    missing: str = "unbounded",
    note: str = "",
) -> Quantity:
    """Return the declaration of the absolute error of an output."""
    path = f"error/{output}"
    return Quantity(dims, unit, f"error of the {of}", path=path, missing=missing, note=note)


@dataclass(frozen=True, eq=False)
class Result:
    """Solutions of a family of impact modes; outputs that were not requested are absent.

    Where the equations are singular to the last bit, the impulse and all else is 0.
    """

    GROUPS: ClassVar[Mapping[str, Group]] = {
        "frequency": Group("FrequencyAxis", "The frequencies, as Omega and as omega."),
        "error": Group("ImpulseError", "Errors of the outputs."),
        **DERIVATIVES,
    }

    Omega: Annotated[
        Floats,
        Quantity(
            _FREQUENCY, "time-1", "fundamental angular frequency", True, path="frequency/Omega"
        ),
    ]
    omega: Annotated[
        Floats,
        Quantity(
            _FREQUENCY,
            "time-1",
            "triangle-wave frequency",
            True,
            path="frequency/omega",
            note="(2/pi) Omega",
        ),
    ]
    constraint: Annotated[
        Integers, Quantity(("constraint",), "1", "index of the active constraint", True)
    ]
    dof: Dofs
    tau: Annotated[Floats | None, Quantity(("tau",), "1", "triangle-wave time", True)]
    harmonic: Annotated[Integers | None, Quantity(("harmonic",), "1", "multiple of Omega", True)]
    impulse: Annotated[
        Floats | None,
        Quantity(
            _AT_WALLS,
            "mass length time-2",
            "impulse parameter p, upper wall",
            note="0 where there is no such wall",
            error="error/impulse",
        ),
    ]
    impulse_lower: Annotated[
        Floats | None,
        Quantity(
            _AT_WALLS,
            "mass length time-2",
            "impulse parameter p, lower wall",
            note="absent where both walls are alike",
            error="error/impulse_lower",
        ),
    ]
    momentum: Annotated[
        Floats | None,
        Quantity(
            _AT_WALLS,
            "mass length time-1",
            "momentum exchanged at each impact, upper wall",
            note="2 p/omega",
            error="error/momentum",
        ),
    ]
    momentum_lower: Annotated[
        Floats | None,
        Quantity(
            _AT_WALLS,
            "mass length time-1",
            "momentum exchanged at each impact, lower wall",
            note="absent where both walls are alike",
            error="error/momentum_lower",
        ),
    ]
    exists: Annotated[
        Booleans | None,
        Quantity(_FREQUENCY, "1", "whether the solution is admissible", flags=EXISTS),
    ]
    reason: Annotated[
        Integers | None,
        Quantity(_FREQUENCY, "1", "why the solution is a phantom, or ok", flags=REASONS),
    ]
    certified: Annotated[
        Booleans | None,
        Quantity(
            _FREQUENCY,
            "1",
            "whether that is proved, errors included",
            flags=("undecided", "proved"),
        ),
    ]
    extended: Annotated[
        Booleans | None,
        Quantity(
            _FREQUENCY,
            "1",
            "whether ball arithmetic proved it, where double precision could not",
            flags=("double", "ball"),
        ),
    ]
    witness: Annotated[
        Floats | None,
        Quantity(
            _FREQUENCY, "1", "triangle-wave time at which a limit is passed", missing="none is"
        ),
    ]
    shape: Annotated[
        Floats | None,
        Quantity(_OF_DOFS, "length", "displacement at tau = 1", error="error/shape"),
    ]
    waveform: Annotated[
        Floats | None,
        Quantity(("frequency", "tau", "dof"), "length", "displacement", error="error/waveform"),
    ]
    energy: Annotated[
        Floats | None,
        Quantity(_FREQUENCY, "mass length2 time-2", "total energy", error="error/energy"),
    ]
    stability: Annotated[
        Floats | None,
        Quantity(
            _FREQUENCY,
            "1",
            "spectral radius of the half-period map",
            missing="the order of simultaneous impacts decides, or the solution is a phantom",
            error="error/stability",
        ),
    ]
    neutral: Annotated[
        Booleans | None,
        Quantity(
            _FREQUENCY,
            "1",
            "whether the spectral radius is 1 within its error: deviations neither grow, as far "
            "as is known, nor decay, as nothing is lost",
            flags=NO_YES,
        ),
    ]
    harmonics: Annotated[
        Floats | None,
        Quantity(
            ("frequency", "harmonic", "dof"),
            "length",
            "Fourier amplitude, of sin(n Omega t) for odd and cos(n Omega t) for even multiples n",
            error="error/harmonics",
        ),
    ]
    impulse_error: Annotated[
        Floats,
        _error(
            _AT_WALLS,
            "mass length time-2",
            "impulse parameter p, upper wall",
            "impulse",
            note="the same at all walls of a solution",
        ),
    ]
    impulse_lower_error: Annotated[
        Floats | None,
        _error(_AT_WALLS, "mass length time-2", "impulse parameter p, lower wall", "impulse_lower"),
    ]
    momentum_error: Annotated[
        Floats | None,
        _error(
            _AT_WALLS,
            "mass length time-1",
            "momentum exchanged at each impact, upper wall",
            "momentum",
        ),
    ]
    momentum_lower_error: Annotated[
        Floats | None,
        _error(
            _AT_WALLS,
            "mass length time-1",
            "momentum exchanged at each impact, lower wall",
            "momentum_lower",
        ),
    ]
    relative_error: Annotated[
        Floats,
        Quantity(
            _FREQUENCY,
            "1",
            "error of the impulses relative to the largest of them, at most 1",
            path="error/relative",
            missing="unknown",
        ),
    ]
    condition: Annotated[
        Floats,
        Quantity(
            _FREQUENCY,
            "1",
            "magnification of relative rounding errors in the impulses",
            path="error/condition",
            missing="unbounded",
        ),
    ]
    stability_error: Annotated[
        Floats | None,
        _error(
            _FREQUENCY,
            "1",
            "spectral radius",
            "stability",
            missing="there is none, or it is unbounded",
        ),
    ]
    shape_error: Annotated[Floats | None, _error(_OF_DOFS, "length", "shape", "shape")]
    waveform_error: Annotated[
        Floats | None, _error(_OF_ALL, "length", "waveform at all times", "waveform")
    ]
    energy_error: Annotated[
        Floats | None, _error(_FREQUENCY, "mass length2 time-2", "total energy", "energy")
    ]
    harmonics_error: Annotated[
        Floats | None, _error(_OF_ALL, "length", "Fourier amplitudes of all orders", "harmonics")
    ]
    within_tolerance: Annotated[
        Booleans | None,
        Quantity(
            _FREQUENCY,
            "1",
            "whether the relative error of the impulses is within the requested tolerance",
            flags=WITHIN,
            path="error/within_tolerance",
        ),
    ]
    error_statement: Statement
    neglected: Neglected
    parameter: Parameters
    parameter_unit: ParameterUnits
    derivative_reason: Annotated[
        Integers | None,
        Quantity(
            ("frequency", "parameter"),
            "1",
            "why there is no derivative, or ok",
            flags=("ok", "singular"),
            path="derivative/reason",
        ),
    ]
    derivative_impulse: Annotated[
        Floats | None,
        derivative(_AT_WALLS, "mass length time-2", "impulse parameter p, upper wall", "impulse"),
    ]
    derivative_impulse_error: Annotated[
        Floats | None,
        derivative_error(
            _AT_WALLS, "mass length time-2", "impulse parameter p, upper wall", "impulse"
        ),
    ]
    derivative_impulse_lower: Annotated[
        Floats | None,
        derivative(
            _AT_WALLS, "mass length time-2", "impulse parameter p, lower wall", "impulse_lower"
        ),
    ]
    derivative_impulse_lower_error: Annotated[
        Floats | None,
        derivative_error(
            _AT_WALLS, "mass length time-2", "impulse parameter p, lower wall", "impulse_lower"
        ),
    ]
    derivative_momentum: Annotated[
        Floats | None,
        derivative(
            _AT_WALLS,
            "mass length time-1",
            "momentum exchanged at each impact, upper wall",
            "momentum",
        ),
    ]
    derivative_momentum_error: Annotated[
        Floats | None,
        derivative_error(
            _AT_WALLS,
            "mass length time-1",
            "momentum exchanged at each impact, upper wall",
            "momentum",
        ),
    ]
    derivative_momentum_lower: Annotated[
        Floats | None,
        derivative(
            _AT_WALLS,
            "mass length time-1",
            "momentum exchanged at each impact, lower wall",
            "momentum_lower",
        ),
    ]
    derivative_momentum_lower_error: Annotated[
        Floats | None,
        derivative_error(
            _AT_WALLS,
            "mass length time-1",
            "momentum exchanged at each impact, lower wall",
            "momentum_lower",
        ),
    ]
    derivative_shape: Annotated[
        Floats | None, derivative(_OF_DOFS, "length", "displacement at tau = 1", "shape")
    ]
    derivative_shape_error: Annotated[
        Floats | None, derivative_error(_OF_DOFS, "length", "displacement at tau = 1", "shape")
    ]
    derivative_waveform: Annotated[
        Floats | None, derivative(("frequency", "tau", "dof"), "length", "displacement", "waveform")
    ]
    derivative_waveform_error: Annotated[
        Floats | None,
        derivative_error(("frequency", "tau", "dof"), "length", "displacement", "waveform"),
    ]
    derivative_energy: Annotated[
        Floats | None, derivative(_FREQUENCY, "mass length2 time-2", "total energy", "energy")
    ]
    derivative_energy_error: Annotated[
        Floats | None, derivative_error(_FREQUENCY, "mass length2 time-2", "total energy", "energy")
    ]
    derivative_harmonics: Annotated[
        Floats | None,
        derivative(("frequency", "harmonic", "dof"), "length", "Fourier amplitude", "harmonics"),
    ]
    derivative_harmonics_error: Annotated[
        Floats | None,
        derivative_error(
            ("frequency", "harmonic", "dof"), "length", "Fourier amplitude", "harmonics"
        ),
    ]


_AXIS_FIELDS: Final = along(Result, "frequency")


def concatenate(results: Sequence[Result]) -> Result:
    """Concatenate results of consecutive frequencies."""
    if len(results) == 1:
        return results[0]
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(result, name) for result in results])
        for name in _AXIS_FIELDS
        if getattr(results[0], name) is not None
    }
    return replace(results[0], **joined)


def part(result: Result, start: int, stop: int) -> Result:
    """Return a result at some of its frequencies."""
    some = {name: getattr(result, name) for name in _AXIS_FIELDS}
    return replace(result, **{n: v[start:stop] for n, v in some.items() if v is not None})
