"""Columns of contact phases that periodic motions and attractors have alike."""

from __future__ import annotations

from typing import Annotated, Any

from vibroimpact_solvers.arrays import Floats, Integers, Quantity


def contact(column: str, unit: str, long_name: str, **rest: Any) -> Quantity:
    """Return the declaration of a column of the table of contact phases."""
    return Quantity(("contact",), unit, long_name, path=f"contact/{column}", **rest)


ContactConstraint = Annotated[
    Integers | None, contact("constraint", "1", "index of the constraint")
]
ContactSide = Annotated[
    Integers | None,
    contact("side", "1", "wall: 1 the upper, -1 the lower one", integers=(1, -1)),
]
ContactPhase = Annotated[
    Floats | None,
    contact(
        "phase", "1", "phase of the drive at its beginning, Omega t modulo 2 pi",
        note="0 where the stop is loaded throughout", error="error/contact/phase",
    ),
]  # fmt: skip
ContactDuration = Annotated[
    Floats | None,
    contact(
        "duration", "time", "how long the stop pushes",
        note="the period where it is loaded throughout", error="error/contact/duration",
    ),
]  # fmt: skip
ContactVelocity = Annotated[
    Floats | None,
    contact(
        "velocity", "length time-1", "velocity of the coordinate at its beginning",
        error="error/contact/velocity", missing="the stop is loaded throughout",
    ),
]  # fmt: skip
