"""What is answered: state and displacement along a slow flow, and how far it is from exact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from vibroimpact_solvers.arrays import Booleans, Floats, Integers, Quantity
from vibroimpact_solvers.slow_flow.motion import STAGES


@dataclass(frozen=True, eq=False)
class Result:
    """A motion by one of its descriptions; None stands for what was not asked or is not there."""

    t: Annotated[Floats, Quantity(("time",), "time", "time", True)]
    dof: Annotated[Integers | None, Quantity(("dof",), "1", "index of the degree of freedom", True)]
    impact: Annotated[
        Integers | None, Quantity(("impact",), "1", "number of the impact, from 1", True)
    ]
    stage: Annotated[Integers, Quantity(("time",), "1", "stage of the motion", flags=STAGES)]
    gamma: Annotated[
        Floats | None,
        Quantity(("time",), "1", "frequency ratio Omega0/omega (lambda of eq. 10.110)"),
    ]
    omega: Annotated[Floats | None, Quantity(("time",), "time-1", "triangle-wave frequency")]
    phi: Annotated[Floats | None, Quantity(("time",), "1", "phase of the triangle wave")]
    A: Annotated[Floats | None, Quantity(("time",), "length", "sine amplitude of the second mass")]
    B: Annotated[
        Floats | None, Quantity(("time",), "length", "cosine amplitude of the second mass")
    ]
    x: Annotated[Floats | None, Quantity(("time", "dof"), "length", "displacement")]
    v: Annotated[Floats | None, Quantity(("time", "dof"), "length time-1", "velocity")]
    impulse: Annotated[
        Floats | None, Quantity(("time",), "mass length time-2", "impulse parameter p")
    ]
    t_max: Annotated[Floats, Quantity((), "time", "end of the impacts by this variant")]
    t_max_exact: Annotated[Floats, Quantity((), "time", "end of the impacts of the exact motion")]
    exists: Annotated[
        Booleans | None,
        Quantity(
            (),
            "1",
            "whether the member is a real motion",
            flags=("phantom", "real"),
        ),
    ]
    impact_time: Annotated[
        Floats | None,
        Quantity(("impact",), "time", "time of the exact impact", path="impacts/time"),
    ]
    impact_velocity: Annotated[
        Floats | None,
        Quantity(
            ("impact",), "length time-1", "speed before the exact impact", path="impacts/velocity"
        ),
    ]
    error_x: Annotated[
        Floats | None,
        Quantity(
            ("time", "dof"), "length", "displacement less that of the exact motion", path="error/x"
        ),
    ]
    error_gamma: Annotated[
        Floats | None,
        Quantity(
            ("impact",),
            "1",
            "frequency ratio less that of the exact motion, at its impacts",
            path="error/gamma",
        ),
    ]
    error_phi: Annotated[
        Floats | None,
        Quantity(
            ("impact",),
            "1",
            "phase less that of the exact motion, at its impacts",
            path="error/phi",
        ),
    ]
    seconds: Annotated[
        Floats, Quantity((), "s", "time that this variant took", path="error/seconds")
    ]
    seconds_exact: Annotated[
        Floats | None,
        Quantity((), "s", "time that the exact motion took", path="error/seconds_exact"),
    ]
    within_tolerance: Annotated[
        Booleans | None,
        Quantity(
            (),
            "1",
            "whether the largest error of the displacement is within the tolerance asked for",
            flags=("beyond", "within"),
            path="error/within_tolerance",
        ),
    ]

    #: How the errors were obtained.
    error_statement: str
