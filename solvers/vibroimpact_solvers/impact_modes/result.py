"""What is answered: members of a family, real or phantom, and how far the numbers hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from typing import Annotated, Any, Final

import numpy as np

from vibroimpact_solvers.arrays import Booleans, Floats, Integers, Quantity, quantities


class Reason(IntEnum):
    """Whether a member of the family is a motion of the structure, and why not."""

    OK = 0
    NEGATIVE_IMPULSE = 1
    WRONG_VELOCITY = 2
    PENETRATION = 3
    SINGULAR = 4

    @property
    def sentence(self) -> str:
        """The reason in words."""
        return _SENTENCES[self]


_SENTENCES: Final = {
    Reason.OK: "the member is a motion of the structure",
    Reason.NEGATIVE_IMPULSE: "a wall would have to pull",
    Reason.WRONG_VELOCITY: "a constrained coordinate would leave its wall before the impact",
    Reason.PENETRATION: "a limit is passed between the impacts",
    Reason.SINGULAR: "no impulse brings the structure to its walls at this frequency",
}
REASONS: Final = tuple(reason.name.lower() for reason in Reason)


@dataclass(frozen=True, eq=False)
class Result:
    """Members of the family; None stands for what was not asked.

    A member that is singular to the last bit has impulse 0 and everything else 0.
    """

    Omega: Annotated[
        Floats,
        Quantity(
            ("frequency",), "time-1", "fundamental angular frequency", True, path="frequency/Omega"
        ),
    ]
    omega: Annotated[
        Floats,
        Quantity(("frequency",), "time-1", "triangle-wave frequency", True, path="frequency/omega"),
    ]
    constraint: Annotated[
        Integers, Quantity(("constraint",), "1", "index of the active constraint", True)
    ]
    dof: Annotated[Integers | None, Quantity(("dof",), "1", "index of the degree of freedom", True)]
    tau: Annotated[Floats | None, Quantity(("tau",), "1", "triangle-wave time", True)]
    harmonic: Annotated[Integers | None, Quantity(("harmonic",), "1", "multiple of Omega", True)]
    impulse: Annotated[
        Floats | None,
        Quantity(
            ("frequency", "constraint"), "mass length time-2", "impulse parameter p, upper wall"
        ),
    ]
    impulse_lower: Annotated[
        Floats | None,
        Quantity(
            ("frequency", "constraint"), "mass length time-2", "impulse parameter p, lower wall"
        ),
    ]
    exists: Annotated[
        Booleans | None,
        Quantity(
            ("frequency",),
            "1",
            "whether the member is a real motion",
            flags=("phantom", "real"),
        ),
    ]
    reason: Annotated[
        Integers | None,
        Quantity(("frequency",), "1", "why the member is a phantom", flags=REASONS),
    ]
    certified: Annotated[
        Booleans | None,
        Quantity(
            ("frequency",),
            "1",
            "whether existence is proved, apart from rounding",
            flags=("undecided", "proved"),
        ),
    ]
    witness: Annotated[
        Floats | None,
        Quantity(("frequency",), "1", "triangle-wave time at which a limit is passed"),
    ]
    shape: Annotated[
        Floats | None, Quantity(("frequency", "dof"), "length", "displacement at tau = 1")
    ]
    waveform: Annotated[
        Floats | None, Quantity(("frequency", "tau", "dof"), "length", "displacement")
    ]
    energy: Annotated[
        Floats | None, Quantity(("frequency",), "mass length2 time-2", "total energy")
    ]
    stability: Annotated[
        Floats | None,
        Quantity(("frequency",), "1", "spectral radius of the half-period map"),
    ]
    harmonics: Annotated[
        Floats | None,
        Quantity(
            ("frequency", "harmonic", "dof"),
            "length",
            "Fourier amplitude, of the sine for odd and of the cosine for even multiples",
        ),
    ]
    impulse_error: Annotated[
        Floats,
        Quantity(
            ("frequency",), "1", "estimated relative error of the impulse", path="error/impulse"
        ),
    ]
    condition: Annotated[
        Floats,
        Quantity(
            ("frequency",),
            "1",
            "magnification of relative rounding errors in the impulse",
            path="error/condition",
        ),
    ]
    stability_error: Annotated[
        Floats | None,
        Quantity(
            ("frequency",),
            "1",
            "estimated relative error of the spectral radius",
            path="error/stability",
        ),
    ]
    within_tolerance: Annotated[
        Booleans | None,
        Quantity(
            ("frequency",),
            "1",
            "whether the stated error of the impulse is within the tolerance asked for",
            flags=("beyond", "within"),
            path="error/within_tolerance",
        ),
    ]

    #: How the errors were obtained.
    error_statement: str


_ALONG: Final = tuple(
    name for name, quantity in quantities(Result).items() if quantity.dims[0] == "frequency"
)


def concatenate(results: Sequence[Result]) -> Result:
    """Put results of consecutive frequencies together."""
    if len(results) == 1:
        return results[0]
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(result, name) for result in results])
        for name in _ALONG
        if getattr(results[0], name) is not None
    }
    return replace(results[0], **joined)


def part(result: Result, start: int, stop: int) -> Result:
    """Return a result at some of its frequencies."""
    some = {name: getattr(result, name) for name in _ALONG}
    return replace(result, **{n: v[start:stop] for n, v in some.items() if v is not None})


def empty() -> dict[str, Any]:
    """Return all fields of a result as not asked."""
    return dict.fromkeys(field.name for field in fields(Result))
